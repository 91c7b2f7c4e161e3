#include <cmath>
#include <string_view>

#include <fmt/format.h>

#include <rubato/base/quoted.hpp>
#include <rubato/study/run.hpp>

namespace rubato::study {

namespace {

/// Builds one JSON object. A number that is not finite has no JSON form and is left out with its key.
class JsonObject {
public:
  JsonObject& number(std::string_view key, double value) {
    return std::isfinite(value) ? raw(key, fmt::format("{:.17g}", value)) : *this;
  }
  JsonObject& count(std::string_view key, std::size_t value) { return raw(key, fmt::format("{}", value)); }
  JsonObject& text(std::string_view key, std::string_view value) { return raw(key, quoted(value)); }
  /// One without entries is left out too.
  JsonObject& object(std::string_view key, const JsonObject& value) {
    return value.body_.empty() ? *this : raw(key, value.str());
  }
  [[nodiscard]] std::string str() const { return "{" + body_ + "}"; }

private:
  JsonObject& raw(std::string_view key, std::string_view value) {
    body_ += fmt::format("{}{}: {}", body_.empty() ? "" : ", ", quoted(key), value);
    return *this;
  }
  std::string body_;
};

JsonObject json(const MaxRms& value) {
  return JsonObject().number("max", value.max).number("rms", value.rms());
}
JsonObject json(const Range& range) {
  return JsonObject().number("min", range.min).number("max", range.max);
}
JsonObject json(const Deviation& value) {
  return JsonObject().number("initial", value.initial).number("max_deviation", value.max);
}

/// euler-box has none: it chooses no levels, and is told as 0.
bool has_gamma(const Outcome& outcome) {
  const Range& gamma = outcome.statistics.gamma;
  return gamma.min <= gamma.max && (outcome.variable_levels || gamma.min != 0.0 || gamma.max != 0.0);
}

template <typename T>
JsonObject json(const std::vector<Named<T>>& values) {
  JsonObject object;
  for (const auto& [name, value] : values) {
    object.object(name, json(value));
  }
  return object;
}

}  // namespace

std::string to_json(const Outcome& outcome) {
  const Statistics& statistics = outcome.statistics;
  JsonObject object;
  object.count("status", static_cast<std::size_t>(outcome.status));
  object.count("steps", statistics.steps);
  object.number("t", statistics.t);
  if (statistics.steps > 0) {
    object.object("h", json(statistics.h));
    JsonObject energy = JsonObject().number("value", statistics.energy);
    energy.number(statistics.autonomous ? "max_relative_deviation" : "max_balance",
                  statistics.autonomous ? statistics.relative_energy_deviation() : statistics.energy_deviation);
    object.object("discrete_energy", energy);
  }
  object.object("node_energy", json(statistics.node_energy));
  if (outcome.variable_levels) {
    object.object("bridges", JsonObject()
                                 .count("count", statistics.bridges)
                                 .count("steps", statistics.bridge_steps)
                                 .number("max_deviation", statistics.relative_bridge_deviation()));
  }
  if (has_gamma(outcome)) {
    object.object("gamma", json(statistics.gamma));
  }
  if (outcome.variable_levels && statistics.steps > 0) {
    object.object("step_condition", JsonObject().number("max", statistics.condition));
  }
  if (statistics.iterations > 0.0) {
    object.object("newton_iterations",
                  JsonObject()
                      .number("mean", statistics.iterations / static_cast<double>(statistics.steps))
                      .number("max", statistics.most_iterations));
  }
  if (!statistics.residuals.empty()) {
    object.object("residuals", json(statistics.residuals));
  }
  if (!statistics.invariants.empty()) {
    object.object("invariants", json(statistics.invariants));
  }
  if (!statistics.totals.empty()) {
    object.object("totals", json(statistics.totals));
  }
  if (!statistics.errors.empty()) {
    object.object("error", json(statistics.errors));
  }
  if (outcome.wall_seconds) {
    object.number("wall_seconds", *outcome.wall_seconds);
  }
  object.text("file", outcome.file);
  return object.str();
}

std::string to_table(const Outcome& outcome) {
  const Statistics& statistics = outcome.statistics;
  std::string table;
  const auto row = [&table](std::string_view name, const std::string& value) {
    table += fmt::format("  {:<26} {}\n", name, value);
  };
  if (!outcome.title.empty()) {
    table += outcome.title + "\n";
  }
  row("steps", fmt::format("{}, to t = {:.10g}", statistics.steps, statistics.t));
  if (statistics.steps > 0) {
    row("h", fmt::format("{:.6g} to {:.6g}", statistics.h.min, statistics.h.max));
    if (statistics.autonomous) {
      row("discrete energy",
          fmt::format("{:.15g}, relative deviation {:.2g}", statistics.energy, statistics.relative_energy_deviation()));
    } else {
      row("discrete energy",
          fmt::format("depends on t; largest imbalance of (3.4): {:.2g}", statistics.energy_deviation));
    }
  }
  row("node energy H(z_k)",
      fmt::format("{:.10g}, deviation {:.3g}", statistics.node_energy.initial, statistics.node_energy.max));
  if (has_gamma(outcome)) {
    row("Gamma", fmt::format("{:.6g} to {:.6g}", statistics.gamma.min, statistics.gamma.max));
  }
  if (outcome.variable_levels && statistics.steps > 0) {
    row("bridges",
        statistics.bridge_steps == 0
            ? std::string("none")
            : fmt::format("{} crossings in {} steps, relative energy deviation {:.2g} on them", statistics.bridges,
                          statistics.bridge_steps, statistics.relative_bridge_deviation()));
    row("step condition", fmt::format("{:.2g}", statistics.condition));
  }
  for (const auto& [name, value] : statistics.residuals) {
    row("residual " + name, fmt::format("max {:.3g}, rms {:.3g}", value.max, value.rms()));
  }
  for (const auto& [name, value] : statistics.totals) {
    row("total " + name, fmt::format("{:.10g}, deviation {:.3g}", value.initial, value.max));
  }
  for (const auto& [name, value] : statistics.invariants) {
    row(name,
        std::isfinite(value.max) ? fmt::format("{:.10g}, deviation {:.3g}", value.initial, value.max) : "undefined");
  }
  for (const auto& [name, value] : statistics.errors) {
    row("error in " + name, std::isfinite(value.max)
                                ? fmt::format("max {:.3g}, rms {:.3g} at the last level", value.max, value.rms())
                                : "undefined at the last level");
  }
  if (statistics.iterations > 0.0) {
    row("iterations per step",
        fmt::format("{:.3g} on average, at most {:.0f}", statistics.iterations / static_cast<double>(statistics.steps),
                    statistics.most_iterations));
  }
  if (outcome.wall_seconds) {
    row("time taken", fmt::format("{:.3g} s", *outcome.wall_seconds));
  }
  row("record", outcome.file);
  return table;
}

}  // namespace rubato::study
