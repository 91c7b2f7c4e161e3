#include <rubato/report/film.hpp>

#include <algorithm>
#include <cmath>

namespace rubato::report {

namespace {

constexpr std::size_t film_value_bytes = 2, enough_frames = 24, smallest_side = 32, least_frames = 2,
                      least_extremes = 40;
/// The first field is drawn in full where its part of the room has so many pictures; with more, the others would have
/// fewer pictures, or less detail.
constexpr std::size_t enough_full_frames = 8;
constexpr double part_of_first = 0.6;
/// A point of the extremes: t in double, two values in single precision; two envelopes select points.
constexpr std::size_t extremes_bytes = packed_size(2 * (8 + 4 + 4)), film_padding = 16;

std::size_t count_films(const MapCounts& counts) {
  return counts.fields + counts.exact + counts.residuals;
}

}  // namespace

Demand Film::demand(const record::DatasetInfo& field, const Contents& contents) {
  const MapCounts counts(contents);
  const std::size_t levels = field.shape.front(), height = field.shape[field.shape.size() - 2],
                    width = field.shape.back(), films = count_films(counts);
  const auto bytes = [&](std::size_t frames, std::size_t rows, std::size_t columns, std::size_t points) {
    return counts.frames + packed_size(8 * frames) +
           films * (packed_size(film_value_bytes * frames * rows * columns) + extremes_bytes * points + film_padding);
  };
  const std::size_t whole = bytes(levels, height, width, levels);
  return {std::min(whole, bytes(std::min(levels, least_frames), std::min(height, smallest_side),
                                std::min(width, smallest_side), std::min(levels, least_extremes))),
          whole};
}

Film::Plan Film::plan(const record::DatasetInfo& field, const Contents& contents, std::size_t bytes) {
  const MapCounts counts(contents);
  const std::size_t levels = field.shape.front(), height = field.shape[field.shape.size() - 2],
                    width = field.shape.back(), films = count_films(counts);
  Plan plan{.height = height,
            .width = width,
            .slices = field.row_size() / (height * width),
            .rows = {height, height},
            .columns = {width, width},
            .first_rows = {height, height},
            .first_columns = {width, width},
            .frames = {},
            .levels = levels,
            .extremes_points = no_limit,
            .times = contents.field_times};
  std::size_t frames = levels;
  if (bytes < demand(field, contents).whole) {
    // Curves of extremes take at most an eighth.
    const std::size_t room = (bytes - counts.frames) / films;
    plan.extremes_points = std::clamp<std::size_t>(room / 8 / extremes_bytes, least_extremes, 4000);
    const std::size_t left = room - std::min(levels, plan.extremes_points) * extremes_bytes - film_padding;
    // What is given to the times of the pictures is no more than to one value each.
    const std::size_t values = left / 4 * 3 / film_value_bytes;
    const std::size_t whole = height * width, small = std::min(height, smallest_side) * std::min(width, smallest_side);
    // Blocks are squares of nodes, all of the same size but at the border.
    const auto divide = [&](double values_of_picture) {
      const double block = std::max(1.0, std::ceil(std::sqrt(static_cast<double>(whole) / values_of_picture)));
      const auto reduced = [block](std::size_t size) {
        const auto wanted = static_cast<std::size_t>(std::ceil(static_cast<double>(size) / block));
        return Partition(size, std::max(wanted, std::min(size, smallest_side)));
      };
      plan.rows = reduced(height);
      plan.columns = reduced(width);
    };
    divide(static_cast<double>(values) / static_cast<double>(std::min(levels, enough_frames)));
    frames = values / (plan.rows.parts() * plan.columns.parts() + 4);
    // `values` are for one film; all have as many pictures.
    const std::size_t all = values * films, others = films - 1;
    const std::size_t full = std::min({static_cast<std::size_t>(part_of_first * static_cast<double>(all)) / (whole + 4),
                                       all / (whole + 4 + others * (small + 4)), levels});
    const bool is_whole = plan.rows.is_whole() && plan.columns.is_whole();
    if (!is_whole && others > 0 && full >= std::min(levels, enough_full_frames)) {
      frames = full;
      divide(static_cast<double>((all - frames * (whole + 4)) / others) / static_cast<double>(frames) - 4.0);
      const std::size_t used = plan.rows.parts() * plan.columns.parts() + 4;
      frames = all / (whole + 4 + others * used);  // what blocks of whole nodes leave goes into more pictures
    } else if (!is_whole && others == 0 && values / (whole + 4) >= std::min(levels, enough_full_frames)) {
      frames = values / (whole + 4);
    } else {
      plan.first_rows = plan.rows;
      plan.first_columns = plan.columns;
    }
    frames = std::clamp<std::size_t>(frames, least_frames, levels);
  }
  for (std::size_t i = 0; i < frames; ++i) {
    plan.frames.push_back(frames == 1 ? 0 : i * (levels - 1) / (frames - 1));
  }
  return plan;
}

Film::Plan Film::Plan::of(const record::DatasetInfo& info) const {
  Plan plan = *this;
  plan.height = info.shape[info.shape.size() - 2];
  plan.width = info.shape.back();
  plan.slices = info.row_size() / (plan.height * plan.width);
  for (Partition* const part : {&plan.rows, &plan.first_rows}) {
    *part = part->of(plan.height);
  }
  for (Partition* const part : {&plan.columns, &plan.first_columns}) {
    *part = part->of(plan.width);
  }
  return plan;
}

void Film::write_times(Json& json, std::string_view key, const record::Reader& reader, const Plan& plan) {
  json.key(key).begin_object().key("first");
  write_f64(json, pick(reader.read(plan.times), plan.frames));
  json.end_object();
}

void Film::add(std::size_t level, std::span<const double> values) {
  extremes_.emplace_back().add(values);
  if (!is_before_start(drawing_, level, values)) {
    census_.add(values);
  }
  if (!std::ranges::binary_search(plan_.frames, level)) {
    return;
  }
  BlockEnvelope picture(rows_, columns_);
  const auto slice = values.subspan(plan_.slices / 2 * plan_.height * plan_.width, plan_.height * plan_.width);
  for (std::size_t row = 0; row < plan_.height; ++row) {
    picture.add_row(slice.subspan(row * plan_.width, plan_.width));
  }
  low_.insert(low_.end(), picture.low().begin(), picture.low().end());
  high_.insert(high_.end(), picture.high().begin(), picture.high().end());
}

void Film::write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const {
  const std::vector<double> t = reader.read(plan_.times);
  json.begin_object();
  write_drawing(json, drawing_, census_);
  json.entry("shape", "film");
  json.entry("thinned", !rows_.is_whole() || !columns_.is_whole());
  json.key("levels").begin_object().entry("count", plan_.levels).entry("parts", plan_.frames.size()).end_object();
  write_axis(json, "y", reader, dimensions[dimensions.size() - 2], rows_);
  write_axis(json, "x", reader, dimensions.back(), columns_);
  if (plan_.slices > 1) {
    const std::vector<double> across = reader.read("/grid/" + dimensions.front());
    json.key("slice").begin_object().entry("axis", display_name(dimensions.front()));
    json.entry("at", across[plan_.slices / 2]).end_object();
  }
  write_blocks(json, drawing_, low_, high_);
  write_extremes(json, t);
  json.end_object();
}

void Film::write_extremes(Json& json, std::span<const double> t) const {
  std::vector<double> lowest, highest;
  for (const Extremes& extremes : extremes_) {
    const double undefined = std::numeric_limits<double>::quiet_NaN();
    lowest.push_back(extremes.is_empty() ? undefined : extremes.low);
    highest.push_back(extremes.is_empty() ? undefined : extremes.high);
  }
  const auto kept =
      merge(envelope_within(lowest, plan_.extremes_points), envelope_within(highest, plan_.extremes_points));
  json.key("extremes").begin_object().entry("count", t.size()).key("t");
  write_f64(json, pick(t, kept));
  json.key("low");
  write_f32(json, pick(lowest, kept));
  json.key("high");
  write_f32(json, pick(highest, kept));
  json.end_object();
}

}  // namespace rubato::report
