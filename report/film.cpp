#include <rubato/report/film.hpp>

#include <algorithm>
#include <cmath>

namespace rubato::report {

Film::Plan Film::plan(const record::DatasetInfo& field, const Contents& contents, std::size_t bytes) {
  constexpr std::size_t value_bytes = 2, enough_frames = 40, smallest_side = 32;
  const std::size_t levels = field.shape.front(), height = field.shape[field.shape.size() - 2],
                    width = field.shape.back();
  const std::size_t films = contents.fields.size() + contents.exact.size() + contents.residual_fields.size();
  const std::size_t values = bytes / value_bytes / films;

  const double picture = static_cast<double>(values) / static_cast<double>(std::min(levels, enough_frames));
  const double scale = std::min(1.0, std::sqrt(picture / static_cast<double>(height * width)));
  const auto reduced = [&](std::size_t size) {
    const auto wanted = static_cast<std::size_t>(static_cast<double>(size) * scale);
    return Partition(size, std::max(wanted, smallest_side));
  };
  Plan plan{.height = height,
            .width = width,
            .slices = field.row_size() / (height * width),
            .rows = reduced(height),
            .columns = reduced(width),
            .frames = {},
            .levels = levels};
  const std::size_t most = std::max<std::size_t>(2, values / (plan.rows.parts() * plan.columns.parts()));
  const std::size_t frames = std::min(most, levels);
  for (std::size_t i = 0; i < frames; ++i) {
    plan.frames.push_back(frames == 1 ? 0 : i * (levels - 1) / (frames - 1));
  }
  return plan;
}

void Film::add(std::size_t level, std::span<const double> values) {
  extremes_.emplace_back().add(values);
  if (!std::ranges::binary_search(plan_.frames, level)) {
    return;
  }
  BlockEnvelope picture(plan_.rows, plan_.columns);
  const auto slice = values.subspan(plan_.slices / 2 * plan_.height * plan_.width, plan_.height * plan_.width);
  for (std::size_t row = 0; row < plan_.height; ++row) {
    picture.add_row(slice.subspan(row * plan_.width, plan_.width));
  }
  low_.insert(low_.end(), picture.low().begin(), picture.low().end());
  high_.insert(high_.end(), picture.high().begin(), picture.high().end());
}

void Film::write(Json& json, const record::Reader& reader, const std::vector<std::string>& dimensions) const {
  const std::vector<double> t = reader.read("/states/t");
  json.begin_object().entry("name", drawing_.name).entry("group", drawing_.group).entry("shape", "film");
  json.entry("thinned", !plan_.rows.is_whole() || !plan_.columns.is_whole());
  json.key("levels").begin_object().entry("count", plan_.levels).entry("parts", plan_.frames.size()).end_object();
  for (const char* key : {"t_first", "t_last"}) {
    json.key(key);
    write_f64(json, pick(t, plan_.frames));
  }
  write_axis(json, "y", reader, dimensions[dimensions.size() - 2], plan_.rows);
  write_axis(json, "x", reader, dimensions.back(), plan_.columns);
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
  constexpr std::size_t buckets = 1000;
  const auto kept = merge(envelope(lowest, buckets), envelope(highest, buckets));
  json.key("extremes").begin_object().key("t");
  write_f64(json, pick(t, kept));
  json.key("low");
  write_f32(json, pick(lowest, kept));
  json.key("high");
  write_f32(json, pick(highest, kept));
  json.end_object();
}

}  // namespace rubato::report
