#include <cmath>
#include <string_view>

#include <fmt/format.h>

#include <rubato/figures/text.hpp>
#include <rubato/run/run.hpp>

namespace rubato {

namespace {

/// Numbers that are not finite are left out.
figures::JsonObject json(const Disagreement& disagreement) {
  figures::JsonObject object;
  object.text("dataset", disagreement.dataset);
  if (disagreement.row) {
    object.count("row", *disagreement.row);
  }
  if (disagreement.index) {
    object.count("index", *disagreement.index);
  }
  object.number("stored", disagreement.stored).number("recomputed", disagreement.recomputed);
  if (disagreement.tolerance > 0.0) {
    object.number("tolerance", disagreement.tolerance);
  }
  return object.text("reason", disagreement.reason);
}

}  // namespace

std::string to_json(const Outcome& outcome) {
  figures::JsonObject object;
  object.count("status", static_cast<std::size_t>(outcome.status));
  figures::add_figures(object, outcome.statistics);
  if (outcome.wall_seconds) {
    object.number("wall_seconds", *outcome.wall_seconds);
  }
  if (!outcome.file.empty()) {
    object.text("file", outcome.file);
  }
  if (outcome.compared > 0 || outcome.disagreement_count > 0) {
    object.count("compared", outcome.compared).count("disagreement_count", outcome.disagreement_count);
    std::vector<figures::JsonObject> disagreements;
    for (const Disagreement& disagreement : outcome.disagreements) {
      disagreements.push_back(json(disagreement));
    }
    object.objects("disagreements", disagreements);
  }
  if (!outcome.message.empty()) {
    object.text("message", outcome.message);
  }
  return object.texts("warnings", outcome.warnings).str();
}

std::string to_table(const Outcome& outcome) {
  std::string table;
  const auto row = [&table](std::string_view name, std::string_view value) {
    table += fmt::format("  {:<26} {}\n", name, value);
  };
  using figures::label_of, figures::LineKind;
  if (!outcome.title.empty()) {
    table += outcome.title + "\n";
  }
  for (const figures::Line& line : figures::lines_of(outcome.statistics)) {
    row(line.label, line.value);
  }
  if (outcome.wall_seconds) {
    row(label_of(LineKind::time_taken), fmt::format("{:.3g} s", *outcome.wall_seconds));
  }
  if (outcome.wall_seconds && outcome.statistics.errors.empty()) {
    row(label_of(LineKind::accuracy),
        "unknown (conservation laws do not measure it); estimate it with `rubato converge`");
  }
  if (!outcome.file.empty()) {
    row(label_of(LineKind::record), outcome.file);
  }
  if (outcome.compared > 0 || outcome.disagreement_count > 0) {
    table += outcome.disagreement_count == 0
                 ? fmt::format("{} numbers recomputed: all agree\n", outcome.compared)
                 : fmt::format("{} numbers recomputed: {} disagree\n", outcome.compared, outcome.disagreement_count);
    for (const Disagreement& disagreement : outcome.disagreements) {
      table += to_string(disagreement) + "\n";
    }
    if (outcome.disagreements.size() < outcome.disagreement_count) {
      table += fmt::format("and {} more\n", outcome.disagreement_count - outcome.disagreements.size());
    }
  }
  return table;
}

}  // namespace rubato
