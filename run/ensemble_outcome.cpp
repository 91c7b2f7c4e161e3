// What a person and a program are reported on an ensemble.

#include <algorithm>
#include <functional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/run/ensemble.hpp>

namespace rubato {

namespace {

figures::JsonObject json(const EnsembleFigure& figure) {
  figures::JsonObject object;
  const figures::Distribution& values = figure.values;
  if (values.any()) {
    object.number("min", values.min)
        .number("max", values.max)
        .number("mean", values.mean)
        .number("median", values.median)
        .number("lower_quartile", values.lower)
        .number("upper_quartile", values.upper)
        .count("worst", values.worst);
  }
  if (values.undefined > 0) {
    object.count("absent", values.undefined);
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

/// One line a member: what it was given, how it ended, and the figures that say most.
std::string member_rows(const EnsembleOutcome& outcome) {
  std::vector<std::size_t> columns;
  std::vector<std::string> head = {"member"};
  head.insert(head.end(), outcome.paths.begin(), outcome.paths.end());
  head.emplace_back("status");
  for (std::size_t i = 0; i < outcome.summary.size(); ++i) {
    const std::string label = figures::label_of_figure(outcome.summary[i].name);
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
  const auto failed = static_cast<std::size_t>(std::ranges::count_if(
      outcome.statuses, [](ExitStatus status) { return status != ExitStatus::done && status != ExitStatus::lost; }));
  // Each member that the record has is one or the other.
  object.count("members", outcome.members).count("finished", outcome.finished - failed).count("ended_early", failed);
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
  outcome.findings.add_to(object, "members");
  if (!outcome.message.empty()) {
    object.text("message", outcome.message);
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
    const std::string label = figures::label_of_figure(figure.name);
    if (label.empty() || !figure.values.any()) {
      continue;
    }
    const figures::Line line = figures::line_of(label, figure.values);
    row(label, line.remark.empty() ? line.value : fmt::format("{}; {}", line.value, line.remark));
  }
  row("verdict", outcome.findings.verdict_text("members"));
  if (outcome.wall_seconds) {
    row("time taken", fmt::format("{:.3g} s", *outcome.wall_seconds));
  }
  row("record", outcome.file);
  if (outcome.compared > 0 && outcome.status != ExitStatus::contradiction) {
    table += fmt::format("{} numbers recomputed: all agree\n", outcome.compared);
  }
  return table;
}

}  // namespace rubato
