#include <rubato/report/space_time_map.hpp>

#include <algorithm>
#include <cmath>

namespace rubato::report {

namespace {

constexpr std::size_t value_bytes = 2, time_bytes = 2 * sizeof(double), padding = 8;
constexpr std::size_t least_rows = 8, least_columns = 16;

/// Arrays of blocks: a map that is not thinned is its own profile; thinned along time only, profiles of whole cells are
/// one array more each; of blocks of cells two, the smallest and the largest.
std::size_t whole_arrays(const MapCounts& counts) {
  return counts.fields + 2 * counts.exact + counts.residuals;
}
std::size_t whole_cell_arrays(const MapCounts& counts) {
  return 2 * counts.fields + 2 * counts.exact + counts.residuals;
}
std::size_t block_arrays(const MapCounts& counts) {
  return 3 * counts.fields + 3 * counts.exact + counts.residuals;
}

std::size_t row_bytes(std::size_t arrays, std::size_t columns) {
  return arrays * columns * value_bytes + time_bytes;
}

}  // namespace

Demand SpaceTimeMap::demand(const record::DatasetInfo& field, const Contents& contents) {
  const MapCounts counts(contents);
  const std::size_t levels = field.shape[0], cells = field.shape[1];
  const auto bytes = [&](std::size_t rows, std::size_t arrays, std::size_t columns) {
    return counts.frames + packed_size(rows * row_bytes(arrays, columns)) + padding * (arrays + 2);
  };
  const std::size_t whole = bytes(levels, whole_arrays(counts), cells);
  return {std::min(whole, bytes(std::min(levels, least_rows), block_arrays(counts), std::min(cells, least_columns))),
          whole};
}

SpaceTimeMap::Plan SpaceTimeMap::plan(const record::DatasetInfo& field, const Contents& contents, std::size_t bytes) {
  const std::size_t levels = field.shape[0], cells = field.shape[1];
  if (bytes >= demand(field, contents).whole) {
    return {{levels, levels}, {cells, cells}, contents.field_times};
  }
  const MapCounts counts(contents);
  const std::size_t room = (bytes - counts.frames - padding * (block_arrays(counts) + 2)) / 4 * 3;
  constexpr std::size_t enough_rows = 256;
  if (const std::size_t rows = room / row_bytes(whole_cell_arrays(counts), cells); rows >= enough_rows) {
    return {{levels, rows}, {cells, cells}, contents.field_times};
  }
  const std::size_t blocks = room / (block_arrays(counts) * value_bytes);
  const auto side = static_cast<std::size_t>(std::sqrt(static_cast<double>(blocks)));
  const std::size_t columns = std::min(cells, std::max({side, blocks / levels, least_columns}));
  return {{levels, std::max<std::size_t>(1, room / row_bytes(block_arrays(counts), columns))},
          {cells, columns},
          contents.field_times};
}

void SpaceTimeMap::write_times(Json& json, std::string_view key, const record::Reader& reader, const Plan& plan) {
  const std::vector<double> t = reader.read(plan.times);
  std::vector<double> first, last;
  for (std::size_t part = 0; part < plan.levels.parts(); ++part) {
    first.push_back(t[plan.levels.begin(part)]);
    last.push_back(t[plan.levels.end(part) - 1]);
  }
  json.key(key).begin_object().key("first");
  write_f64(json, first);
  json.key("last");
  write_f64(json, last);
  json.end_object();
}

SpaceTimeMap::SpaceTimeMap(Drawing drawing, const Plan& plan)
    : drawing_(std::move(drawing)),
      blocks_(plan.levels, plan.cells),
      profiles_({plan.levels.parts(), plan.levels.parts()}, plan.cells) {}

void SpaceTimeMap::add(std::size_t level, std::span<const double> values) {
  if (is_before_start(drawing_, level, values)) {
    blocks_.skip_row();
  } else {
    census_.add(values);
    blocks_.add_row(values);
  }
  const Partition& levels = blocks_.rows();
  if (has_profiles() && levels.begin(levels.part_of(level)) == level) {
    profiles_.add_row(values);
  }
}

void SpaceTimeMap::write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const {
  const Partition &levels = blocks_.rows(), &cells = blocks_.columns();
  json.begin_object();
  write_drawing(json, drawing_, census_);
  json.entry("shape", "space-time");
  json.entry("thinned", !blocks_.is_whole());
  json.key("levels").begin_object().entry("count", levels.places()).entry("parts", levels.parts()).end_object();
  write_axis(json, "x", reader, dimensions.front(), cells);
  // Of an exact solution only profiles are drawn.
  const bool is_profile = drawing_.group == "exact";
  if (!is_profile) {
    write_blocks(json, drawing_, blocks_.low(), blocks_.high());
  }
  if (has_profiles() && (is_profile || !blocks_.is_whole())) {
    Extremes extremes;
    extremes.add(profiles_.low());
    extremes.add(profiles_.high());
    json.key("profile").begin_object().key("high");
    const double low = extremes.is_empty() ? 0.0 : extremes.low, high = extremes.is_empty() ? 0.0 : extremes.high;
    write_u16(json, profiles_.high(), low, high);
    if (!cells.is_whole()) {
      json.key("low");
      write_u16(json, profiles_.low(), low, high);
    }
    json.end_object();
  }
  json.end_object();
}

}  // namespace rubato::report
