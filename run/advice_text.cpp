#include <algorithm>
#include <charconv>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/text.hpp>
#include <rubato/run/advise.hpp>
#include <rubato/run/run_estimate.hpp>

namespace rubato {

namespace {

figures::JsonObject json(const AdvisedScheme& scheme) {
  figures::JsonObject object, entries, cells;
  for (const auto& [key, value] : scheme.entries) {
    double number = 0.0;  // of TOML that is not a string
    const bool is_number = std::from_chars(value.data(), value.data() + value.size(), number).ec == std::errc();
    is_number ? entries.number(key, number) : entries.text(key, unquoted(value));
  }
  object.object("scheme", entries).number("step", scheme.step);
  for (const auto& [axis, count] : scheme.cells) {
    cells.count(axis, static_cast<std::size_t>(count));
  }
  object.object("cells", cells);
  const auto add = [&object](const char* key, const std::optional<double>& value) {
    if (value) {
      object.number(key, *value);
    }
  };
  add("step_error", scheme.step_error);
  add("grid_error", scheme.grid_error);
  add("order", scheme.order);
  object.flag("measured", scheme.measured && scheme.step_error);
  add("seconds", scheme.seconds);
  add("cost", scheme.cost);
  if (scheme.step_error) {
    object.text("verdict", to_string(scheme.verdict));
  }
  if (!scheme.failure.empty()) {
    object.text("failure", scheme.failure);
  }
  return object;
}

/// "splitting, order = 4": what the table has of a scheme beside its levels.
std::string label_of_scheme(const AdvisedScheme& scheme) {
  std::string label;
  for (const auto& [key, value] : scheme.entries) {
    if (key != "levels") {
      label += label.empty() ? unquoted(value) : fmt::format(", {} = {}", key, unquoted(value));
    }
  }
  return label.empty() ? "as it stands" : label;
}

std::string levels_of_scheme(const AdvisedScheme& scheme) {
  return scheme.entries.empty() ? "" : unquoted(scheme.entries.back().second);
}

std::string row_of_scheme(std::string_view number, std::size_t width, const AdvisedScheme& scheme) {
  std::string row =
      fmt::format("  {:>2}  {:<{}}  {:<8}", number, label_of_scheme(scheme), width, levels_of_scheme(scheme));
  if (!scheme.failure.empty()) {
    return row + "  " + scheme.failure.substr(0, scheme.failure.find_first_of(";\n")) + "\n";
  }
  const auto number_text = [](const std::optional<double>& value) {
    return !value ? std::string() : *value == 0.0 ? "rounding" : fmt::format("{:.2g}", *value);
  };
  row += fmt::format("  {:<9.3g}", scheme.step);
  if (!scheme.cells.empty()) {
    std::vector<std::int64_t> counts;
    for (const auto& [axis, count] : scheme.cells) {
      counts.push_back(count);
    }
    row += fmt::format("  {:<10}  {:<9}", fmt::format("{}", fmt::join(counts, "x")), number_text(scheme.grid_error));
  }
  row += fmt::format("  {:<9}  {:<5}  {:<8}  {}{}\n", number_text(scheme.step_error),
                     scheme.order ? fmt::format("{:.1f}", *scheme.order) : "-",
                     scheme.seconds ? duration_text(*scheme.seconds) : "unknown", to_string(scheme.verdict),
                     scheme.measured ? "" : ", extrapolated");
  return row;
}

/// The lines that replace those of [scheme], and of [grid] where its cells change.
std::string lines_of_scheme(const AdvisedScheme& scheme, const AdvisedScheme& present) {
  std::string lines;
  for (const auto& [key, value] : scheme.entries) {
    lines += fmt::format("    {} = {}\n", key, value);
  }
  lines += fmt::format("    step = {}\n", scheme.step);
  for (std::size_t axis = 0; axis < scheme.cells.size(); ++axis) {
    if (scheme.cells[axis] != present.cells[axis]) {
      lines +=
          fmt::format("    # and cells = {} of {} in [grid]\n", scheme.cells[axis].second, scheme.cells[axis].first);
    }
  }
  return lines;
}

}  // namespace

std::string to_json(const Advice& advice) {
  figures::JsonObject object, refused;
  object.count("status", static_cast<std::size_t>(advice.status))
      .number("until", advice.until)
      .number("target", advice.target)
      .object("present", json(advice.present));
  std::vector<figures::JsonObject> schemes;
  for (const AdvisedScheme& scheme : advice.schemes) {
    schemes.push_back(json(scheme));
  }
  object.objects("schemes", schemes);
  for (const auto& [method, reason] : advice.refused) {
    refused.text(unquoted(method), reason);
  }
  object.object("refused", refused);
  if (!advice.message.empty()) {
    object.text("message", advice.message);
  }
  return object.str();
}

std::string to_table(const Advice& advice) {
  constexpr std::size_t shown = 3;
  std::size_t width = 6;
  for (const AdvisedScheme& scheme : advice.schemes) {
    width = std::max(width, label_of_scheme(scheme).size());
  }
  std::string table = fmt::format(
      "{}\n  schemes by cost at an error of {:.3g}, relative to the largest coordinate, momentum or field, at t = "
      "{:.10g}{}\n",
      advice.title, advice.target, advice.until, advice.whole_run ? "" : ", before the end of the run");
  table += fmt::format("  {:>2}  {:<{}}  {:<8}  {:<9}{}  {:<9}  {:<5}  {:<8}  verdict\n", "", "scheme", width, "levels",
                       "step", advice.present.cells.empty() ? "" : "  cells       of grid  ", "error", "order", "time");
  table += row_of_scheme("", width, advice.present);
  std::size_t number = 0;
  for (const AdvisedScheme& scheme : advice.schemes) {
    table += row_of_scheme(scheme.cost ? std::to_string(++number) : "-", width, scheme);
  }
  for (const auto& [method, reason] : advice.refused) {
    table += fmt::format("  not {}: {}\n", unquoted(method), reason.substr(0, reason.find('\n')));
  }
  for (std::size_t i = 0; i < std::min(number, shown); ++i) {
    table += fmt::format("  {}, in [scheme]:\n{}", i + 1, lines_of_scheme(advice.schemes[i], advice.present));
  }
  return table;
}

}  // namespace rubato
