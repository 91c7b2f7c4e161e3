#include <rubato/report/budget.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/report/film.hpp>
#include <rubato/report/page_data.hpp>
#include <rubato/report/space_time_map.hpp>

namespace rubato::report {

namespace {

constexpr std::size_t least_points = 40, least_states = 200, least_off_law = 40, least_crossings = 200;
/// x in double and y in single precision, in base 64.
constexpr std::size_t point_bytes = 16, point_padding = 8;

/// Two doubles in base 64.
constexpr std::size_t off_law_bytes = 22, off_law_frame = 300;

std::size_t thinned_curves(std::size_t curves, std::size_t points) {
  return curves * (point_bytes * points + point_padding);
}

Demand demand_of_curves(const record::Reader& reader, const Contents& contents, std::size_t frames) {
  const std::size_t levels = reader.rows("/levels/t"), stored = reader.rows("/states/t");
  const std::size_t curves = count_curves(contents),
                    errors = contents.kind == Contents::Kind::orbit ? contents.exact.size() : 0,
                    quantities = contents.quantities.size();
  // Drawn in full, curves share their times.
  const std::size_t whole = frames + (curves - errors - quantities) * packed_size(4 * levels) +
                            2 * packed_size(8 * levels) + errors * packed_size(4 * stored) + packed_size(8 * stored) +
                            (quantities > 0 ? quantities * packed_size(12 * reader.rows("/output/t")) : 0);
  return {std::min(whole, frames + thinned_curves(curves, least_points)), whole};
}

Demand demand_of_off_law(const record::Reader& reader) {
  const std::size_t spans = off_law_spans(reader).size();
  return {off_law_frame + off_law_bytes * std::min(spans, least_off_law), off_law_frame + off_law_bytes * spans};
}

/// Of all sections together.
struct SectionSizes {
  std::size_t columns = 0, frames = 0, rows = 0;
};
SectionSizes sizes_of_sections(const record::Reader& reader, const Contents& contents) {
  SectionSizes sizes;
  for (const std::string& name : contents.sections) {
    const std::string group = "/events/" + name;
    sizes.frames += frame_of(Frame::column, name);
    for (const std::string& quantity : reader.read_strings(group + "/quantity")) {
      sizes.frames += frame_of(Frame::column, quantity);
      ++sizes.columns;
    }
    sizes.rows = std::max(sizes.rows, reader.rows(group + "/t"));
  }
  return sizes;
}

std::size_t path_bytes(std::size_t states, std::size_t columns) {
  return packed_size(8 * states) + columns * packed_size(4 * states);
}

}  // namespace

std::vector<std::size_t> share(std::size_t bytes, std::span<const Demand> demands) {
  const auto at = [&](double level) {
    std::vector<std::size_t> shares;
    for (const Demand& demand : demands) {
      const double wanted = level * demand.weight;
      shares.push_back(wanted >= static_cast<double>(demand.whole)
                           ? demand.whole
                           : std::max(demand.least, static_cast<std::size_t>(wanted)));
    }
    return shares;
  };
  const auto fits = [&](double level) {
    std::size_t sum = 0;
    for (const std::size_t part : at(level)) {
      sum += part;
    }
    return sum <= bytes;
  };
  double low = 0.0, high = 1.0;
  for (const Demand& demand : demands) {
    high = std::max(high, (static_cast<double>(demand.whole) + 1.0) / demand.weight);
  }
  if (fits(high)) {
    return at(high);
  }
  while (high - low > 0.5) {
    const double middle = (low + high) / 2;
    (fits(middle) ? low : high) = middle;
  }
  return at(low);
}

std::size_t frame_of(Frame frame, std::string_view name) {
  constexpr std::size_t escaped = 6;
  return static_cast<std::size_t>(frame) + escaped * name.size();
}

Needs::Needs(const record::Reader& reader, const Contents& contents)
    : is_orbit_(contents.kind == Contents::Kind::orbit),
      curves_(count_curves(contents)),
      curve_frames_(0),
      section_columns_(0),
      section_frames_(0),
      columns_(0),
      column_frames_(0) {
  constexpr double pictures = 3.0;   // paths and maps say more than a curve
  constexpr std::size_t rest = 500;  // keys of times and of states
  curve_frames_ = rest + curves_ * frame_of(Frame::curve, "");
  for (const auto* names : {&contents.invariants, &contents.totals, &contents.residuals, &contents.residuals,
                            &contents.exact, &contents.quantities}) {
    for (const std::string& name : *names) {
      curve_frames_ += frame_of(Frame::curve, name) - frame_of(Frame::curve, "");
    }
  }
  demands_.push_back(demand_of_curves(reader, contents, curve_frames_));
  demands_.push_back(demand_of_off_law(reader));
  const SectionSizes sections = sizes_of_sections(reader, contents);
  section_columns_ = sections.columns;
  section_frames_ = sections.frames;
  const auto section_bytes = [&sections](std::size_t rows) {
    return sections.frames + sections.columns * packed_size(4 * rows);
  };
  demands_.push_back({section_bytes(std::min(sections.rows, least_crossings)), section_bytes(sections.rows), pictures});
  if (!is_orbit_) {
    const auto add_maps = [&](const Contents& drawn) {
      const record::DatasetInfo info = reader.info(drawn.fields.front().path);
      demands_.push_back(drawn.axes.size() < 2 ? SpaceTimeMap::demand(info, drawn) : Film::demand(info, drawn));
      demands_.back().weight = pictures;
    };
    add_maps(contents);
    if (!contents.node_quantities.empty()) {
      add_maps(with_quantities_as_fields(contents));
    }
    return;
  }
  const std::vector<StateColumn> columns = state_columns(contents);
  columns_ = columns.size();
  for (const StateColumn& column : columns) {
    column_frames_ += frame_of(Frame::column, column.name);
  }
  const std::size_t states = reader.rows("/states/t");
  const std::size_t whole = column_frames_ + path_bytes(states, columns_);
  const std::size_t least =
      column_frames_ + path_bytes(least_states, columns_) + thinned_curves(columns_, least_points);
  demands_.push_back({std::min(whole, least), whole, pictures});
}

Resolution Needs::resolution(std::span<const std::size_t> shares) const {
  Resolution resolution;
  if (shares[0] < demands_[0].whole) {
    resolution.curve_points = (shares[0] - curve_frames_) / std::max<std::size_t>(curves_, 1) / point_bytes - 1;
  }
  if (shares[1] < demands_[1].whole) {
    resolution.off_law = (shares[1] - off_law_frame) / off_law_bytes;
  }
  if (shares[2] < demands_[2].whole) {
    constexpr std::size_t padding = 4;
    resolution.crossings = entries_in((shares[2] - section_frames_) / section_columns_ - padding, 4);
  }
  if (shares.size() > 4 && shares[4] < demands_[4].whole) {
    resolution.quantity_bytes = shares[4];
  }
  if (shares[3] >= demands_[3].whole) {
    return resolution;
  }
  if (!is_orbit_) {
    resolution.map_bytes = shares[3];
    return resolution;
  }
  // A column against time is a curve like others; the path gets three times what all of them get.
  const std::size_t room = shares[3] - column_frames_;
  resolution.column_points = std::max(least_points, room / 4 / columns_ / point_bytes - 1);
  const std::size_t left = room - thinned_curves(columns_, resolution.column_points);
  constexpr std::size_t padding = 4;
  resolution.path_states = (left - padding * (columns_ + 1)) / 4 * 3 / (8 + 4 * columns_);
  return resolution;
}

}  // namespace rubato::report
