#include <rubato/report/drawing.hpp>

#include <algorithm>
#include <cmath>

namespace rubato::report {

namespace {

/// log10 of magnitudes, from 16 decades below the largest; zero counts as the smallest other value.
void take_logarithms(std::vector<double>& values) {
  constexpr double decades = 16.0;
  double smallest = std::numeric_limits<double>::infinity(), largest = 0.0;
  for (const double value : values) {
    smallest = value > 0.0 && value < smallest ? value : smallest;
    largest = value > largest ? value : largest;
  }
  const double floor = largest == 0.0 ? -decades : std::max(std::log10(smallest), std::log10(largest) - decades);
  for (double& value : values) {
    value = std::isnan(value) ? value : std::max(value > 0.0 ? std::log10(value) : floor, floor);
  }
}

/// Zero if there are values of both signs, else the mean of the middles of the blocks.
double centre_of(std::span<const double> low, std::span<const double> high, const Extremes& extremes) {
  if (extremes.low < 0.0 && extremes.high > 0.0) {
    return 0.0;
  }
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < low.size(); ++i) {
    if (std::isfinite(low[i])) {
      sum += low[i] / 2 + high[i] / 2;
      ++count;
    }
  }
  return count == 0 ? 0.0 : sum / static_cast<double>(count);
}

}  // namespace

void Census::add(std::span<const double> more) {
  values += more.size();
  undefined +=
      static_cast<std::size_t>(std::ranges::count_if(more, [](double value) { return !std::isfinite(value); }));
}

bool is_before_start(const Drawing& drawing, std::size_t level, std::span<const double> values) {
  return ((drawing.starts_late && level == 0) || drawing.has_gaps) &&
         std::ranges::all_of(values, [](double value) { return std::isnan(value); });
}

void write_drawing(Json& json, const Drawing& drawing, const Census& census) {
  json.entry("name", drawing.name).entry("group", drawing.group).entry("count", census.values);
  json.entry("undefined", census.undefined).entry("starts_late", drawing.starts_late);
  json.entry("has_gaps", drawing.has_gaps);
  if (drawing.rounding) {
    json.entry("rounding", *drawing.rounding);
  }
}

MapCounts::MapCounts(const Contents& contents)
    : fields(contents.fields.size()),
      exact(contents.exact.size()),
      residuals(contents.residual_fields.size()),
      frames(0) {
  std::size_t axes = 0;
  for (const std::string& axis : contents.axes) {
    axes += 2 * (frame_of(Frame::map, axis) - frame_of(Frame::map, ""));
  }
  for (const Contents::Field& field : contents.fields) {
    frames += frame_of(Frame::map, field.name) + axes;
  }
  for (const auto* names : {&contents.exact, &contents.exact, &contents.residual_fields}) {
    for (const std::string& name : *names) {
      frames += frame_of(Frame::map, name) + axes;
    }
  }
}

void write_blocks(Json& json, const Drawing& drawing, std::vector<double> low, std::vector<double> high) {
  Extremes extremes;
  std::vector<double>& shown = high;
  json.entry("logarithmic", drawing.logarithmic);
  if (drawing.logarithmic) {
    take_logarithms(shown);
    extremes.add(shown);
  } else {
    extremes.add(low);
    extremes.add(high);
    const double centre = drawing.group == "error" ? 0.0 : centre_of(low, high, extremes);
    json.entry("centre", centre);
    for (std::size_t i = 0; i < shown.size(); ++i) {
      shown[i] = centre - low[i] > high[i] - centre ? low[i] : high[i];
    }
  }
  json.key("values");
  write_u16(json, shown, extremes.is_empty() ? 0.0 : extremes.low, extremes.is_empty() ? 0.0 : extremes.high);
}

void write_axis(Json& json, std::string_view key, const record::Reader& reader, const std::string& dimension,
                const Partition& partition) {
  const std::vector<double> x = reader.read("/grid/" + dimension);
  json.key(key).begin_object().entry("name", display_name(dimension));
  json.entry("first", x.front()).entry("last", x.back());
  json.entry("count", partition.places()).entry("parts", partition.parts()).end_object();
}

std::string_view display_name(std::string_view dimension) {
  constexpr std::string_view cells = "_cell";
  return dimension.ends_with(cells) ? dimension.substr(0, dimension.size() - cells.size()) : dimension;
}

}  // namespace rubato::report
