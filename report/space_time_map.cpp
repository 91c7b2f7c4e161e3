#include <rubato/report/space_time_map.hpp>

#include <algorithm>
#include <cmath>

namespace rubato::report {

namespace {

constexpr std::size_t value_bytes = 2;

}  // namespace

SpaceTimeMap::Plan SpaceTimeMap::plan(const record::DatasetInfo& field, const Contents& contents, std::size_t bytes) {
  const std::size_t levels = field.shape[0], cells = field.shape[1];
  const std::size_t fields = contents.fields.size(), exact = contents.exact.size();
  const std::size_t residuals = contents.residual_fields.size();
  const std::size_t values = bytes / value_bytes;

  // A map that is not thinned is its own profile.
  const std::size_t whole_arrays = fields + 2 * exact + residuals;
  if (levels * cells <= values / whole_arrays) {
    return {{levels, levels}, {cells, cells}};
  }
  // Profiles of whole cells are one array each; of blocks of cells two, the smallest and the largest.
  constexpr std::size_t enough_rows = 256;
  const std::size_t whole_cell_rows = values / (2 * fields + 2 * exact + residuals) / cells;
  if (whole_cell_rows >= enough_rows) {
    return {{levels, whole_cell_rows}, {cells, cells}};
  }
  const std::size_t blocks = std::max<std::size_t>(16, values / (3 * fields + 3 * exact + residuals));
  const auto side = static_cast<std::size_t>(std::sqrt(static_cast<double>(blocks)));
  const std::size_t columns = std::min(cells, std::max(side, blocks / levels));
  return {{levels, blocks / columns}, {cells, columns}};
}

SpaceTimeMap::SpaceTimeMap(Drawing drawing, const Plan& plan)
    : drawing_(std::move(drawing)),
      blocks_(plan.levels, plan.cells),
      profiles_({plan.levels.parts(), plan.levels.parts()}, plan.cells) {}

void SpaceTimeMap::add(std::size_t level, std::span<const double> values) {
  blocks_.add_row(values);
  const Partition& levels = blocks_.rows();
  if (has_profiles() && levels.begin(levels.part_of(level)) == level) {
    profiles_.add_row(values);
  }
}

void SpaceTimeMap::write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const {
  const Partition &levels = blocks_.rows(), &cells = blocks_.columns();
  const std::vector<double> t = reader.read("/states/t");
  std::vector<double> first, last;
  for (std::size_t part = 0; part < levels.parts(); ++part) {
    first.push_back(t[levels.begin(part)]);
    last.push_back(t[levels.end(part) - 1]);
  }
  json.begin_object().entry("name", drawing_.name).entry("group", drawing_.group).entry("shape", "space-time");
  json.entry("thinned", !blocks_.is_whole());
  json.key("levels").begin_object().entry("count", levels.places()).entry("parts", levels.parts()).end_object();
  write_axis(json, "x", reader, dimensions.front(), cells);
  json.key("t_first");
  write_f64(json, first);
  json.key("t_last");
  write_f64(json, last);
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
    write_u16(json, profiles_.high(), extremes.low, extremes.high);
    if (!cells.is_whole()) {
      json.key("low");
      write_u16(json, profiles_.low(), extremes.low, extremes.high);
    }
    json.end_object();
  }
  json.end_object();
}

}  // namespace rubato::report
