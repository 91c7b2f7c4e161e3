// What a person and a program are told of an ensemble.

#include <algorithm>
#include <array>
#include <functional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/text.hpp>
#include <rubato/study/ensemble.hpp>

namespace rubato::study {

namespace {

figures::JsonObject json(const EnsembleFigure& figure) {
  figures::JsonObject object;
  if (figure.values.any()) {
    object.number("min", figure.values.min)
        .number("max", figure.values.max)
        .number("mean", figure.sum / figure.values.defined)
        .count("worst", figure.worst);
  }
  if (figure.values.undefined > 0.0) {
    object.count("absent", static_cast<std::size_t>(figure.values.undefined));
  }
  return object;
}

/// The figures of `all` from `first` on whose names begin with `prefix`, as an object of objects.
figures::JsonObject nested(std::span<const EnsembleFigure> all, std::size_t& next, const std::string& prefix) {
  figures::JsonObject object;
  while (next < all.size() && all[next].name.starts_with(prefix)) {
    const std::string rest = all[next].name.substr(prefix.size());
    const std::size_t slash = rest.find('/');
    if (slash == std::string::npos) {
      if (all[next].values.any()) {
        object.object(rest, json(all[next]));
      }
      ++next;
    } else {
      const std::string key = rest.substr(0, slash);
      object.object(key, nested(all, next, fmt::format("{}{}/", prefix, key)));
    }
  }
  return object;
}

/// Of the table: the label of a figure, in the words of a run's table.
struct Shown {
  std::string_view name, label;
};
constexpr std::array shown = {
    Shown{"steps", "steps"},
    Shown{"t", "last level"},
    Shown{"discrete_energy/max_relative_deviation", "discrete energy, relative deviation"},
    Shown{"discrete_energy/max_deviation", "discrete energy, deviation"},
    Shown{"node_energy/max_deviation", "node energy, deviation"},
    Shown{"bridges/steps", "steps on bridges"},
    Shown{"step_condition/max", "step condition"},
};

std::string label_of(const std::string& name) {
  const auto known = std::ranges::find(shown, name, &Shown::name);
  if (known != shown.end()) {
    return std::string(known->label);
  }
  constexpr std::string_view event = "events/", count = "/count", first = "/first";
  if (name == "stopped/t") {
    return "ended by an event at";
  }
  constexpr std::string_view residual = "residuals/", error = "error/", invariant = "invariants/", max = "/max",
                             deviation = "/max_deviation";
  const auto inner = [&name](std::string_view before, std::string_view after) {
    return name.substr(before.size(), name.size() - before.size() - after.size());
  };
  if (name.starts_with(event) && name.ends_with(count)) {
    return "event " + inner(event, count);
  }
  if (name.starts_with(event) && name.ends_with(first)) {
    return inner(event, first) + ", first";
  }
  if (name.starts_with(residual) && name.ends_with(max)) {
    return "residual " + inner(residual, max);
  }
  if (name.starts_with(error) && name.ends_with(max)) {
    return "error in " + inner(error, max);
  }
  if (name.starts_with(invariant) && name.ends_with(deviation)) {
    return inner(invariant, deviation) + ", deviation";
  }
  return "";
}

/// One line a member: what it was given, how it ended, and the figures that say most.
std::string member_rows(const EnsembleOutcome& outcome) {
  std::vector<std::size_t> columns;
  std::vector<std::string> head = {"member"};
  head.insert(head.end(), outcome.paths.begin(), outcome.paths.end());
  head.emplace_back("status");
  for (std::size_t i = 0; i < outcome.summary.size(); ++i) {
    const std::string label = label_of(outcome.summary[i].name);
    if (!label.empty() && outcome.summary[i].values.any()) {
      columns.push_back(i);
      head.push_back(label);
    }
  }
  std::vector<std::vector<std::string>> rows = {head};
  for (std::size_t m = 0; m < outcome.statuses.size(); ++m) {
    auto& row = rows.emplace_back();
    row.push_back(fmt::format("{}", m));
    row.insert(row.end(), outcome.values[m].begin(), outcome.values[m].end());
    row.push_back(fmt::format("{}", static_cast<int>(outcome.statuses[m])));
    for (const std::size_t column : columns) {
      const double value = outcome.figures[m][column];
      row.push_back(value - value == 0.0 ? fmt::format("{:.6g}", value) : "-");
    }
  }
  std::vector<std::size_t> widths(head.size(), 0);
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      widths[i] = std::max(widths[i], row[i].size());
    }
  }
  std::string text;
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < row.size(); ++i) {
      line += fmt::format("  {:>{}}", row[i], widths[i]);
    }
    text += line + "\n";
  }
  return text;
}

}  // namespace

std::string to_json(const EnsembleOutcome& outcome) {
  figures::JsonObject object;
  object.count("status", static_cast<std::size_t>(outcome.status));
  object.count("members", outcome.members).count("finished", outcome.finished);
  const auto failed = static_cast<std::size_t>(
      std::ranges::count_if(outcome.statuses, [](ExitStatus status) { return status != ExitStatus::done; }));
  object.count("ended_early", failed);
  for (std::size_t next = 0; next < outcome.summary.size();) {
    const std::string& name = outcome.summary[next].name;
    const std::size_t slash = name.find('/');
    if (slash == std::string::npos) {
      object.object(name, json(outcome.summary[next++]));
    } else {
      const std::string key = name.substr(0, slash);
      object.object(key, nested(outcome.summary, next, key + "/"));
    }
  }
  if (outcome.wall_seconds) {
    object.number("wall_seconds", *outcome.wall_seconds);
  }
  if (outcome.compared > 0) {
    object.count("compared", outcome.compared);
  }
  return object.text("file", outcome.file).str();
}

std::string to_table(const EnsembleOutcome& outcome, bool rows) {
  std::string table = outcome.title + "\n";
  if (rows) {
    table += member_rows(outcome);
  }
  const auto row = [&table](std::string_view name, std::string_view value) {
    table += fmt::format("  {:<38} {}\n", name, value);
  };
  row("members", outcome.finished == outcome.members
                     ? fmt::format("{}, of {}", outcome.members, fmt::join(outcome.paths, ", "))
                     : fmt::format("{} of {}", outcome.finished, outcome.members));
  for (const EnsembleFigure& figure : outcome.summary) {
    const std::string label = label_of(figure.name);
    if (label.empty() || !figure.values.any()) {
      continue;
    }
    const Spread& values = figure.values;
    std::string text = values.min == values.max
                           ? fmt::format("{:.6g} in all", values.max)
                           : fmt::format("{:.3g} to {:.3g}, mean {:.3g}; the largest in member {}", values.min,
                                         values.max, figure.sum / values.defined, figure.worst);
    if (values.undefined > 0.0) {
      text += fmt::format("; none in {:.0f}", values.undefined);
    }
    row(label, text);
  }
  if (outcome.wall_seconds) {
    row("time taken", fmt::format("{:.3g} s", *outcome.wall_seconds));
  }
  row("record", outcome.file);
  if (outcome.compared > 0 && outcome.status != ExitStatus::contradiction) {
    table += fmt::format("{} numbers recomputed: all agree\n", outcome.compared);
  }
  return table;
}

}  // namespace rubato::study
