#include <array>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/figures/text.hpp>
#include <rubato/run/solve.hpp>

namespace rubato {

std::string to_json(const SolveOutcome& outcome) {
  figures::JsonObject object;
  object.count("status", static_cast<std::size_t>(outcome.status));
  const BoundaryValueSolution& solution = outcome.solution;
  std::vector<figures::JsonObject> history;
  for (const NewtonIteration& iteration : solution.history) {
    figures::JsonObject one;
    one.count("stage", static_cast<std::size_t>(iteration.stage)).number("residual", iteration.residual);
    one.number("correction", iteration.correction).number("fraction", iteration.fraction);
    history.push_back(one);
  }
  figures::JsonObject found;
  found.number("residual", solution.residual).text("largest_in", solution.worst);
  if (outcome.found()) {
    found.number(outcome.closes ? "period" : "time", solution.orbit.duration());
    if (outcome.closing) {
      found.number("closing", *outcome.closing);
    }
    found.number("energy", solution.mean_energy).number("conserved_energy", solution.conserved);
    if (outcome.error && outcome.error->halved.found()) {
      figures::JsonObject error;
      error.number("relative", outcome.error->relative);
      error.number(outcome.closes ? "period" : "time", outcome.error->duration);
      found.object("step_error", error.number("energy", outcome.error->energy));
    }
    if (!outcome.dependent.empty()) {
      found.texts("dependent_conditions", outcome.dependent);
    }
    std::vector<figures::JsonObject> multipliers;
    for (const std::complex<double>& multiplier : outcome.multipliers) {
      figures::JsonObject one;
      one.number("real", multiplier.real()).number("imaginary", multiplier.imag());
      multipliers.push_back(one);
    }
    if (!multipliers.empty()) {
      found.objects("multipliers", multipliers);
    }
    if (outcome.index) {
      found.count("morse_index", *outcome.index);
    }
    std::vector<figures::JsonObject> points;
    for (const double t : outcome.conjugate_points) {
      figures::JsonObject one;
      points.push_back(one.number("t", t));
    }
    if (!points.empty()) {
      found.objects("conjugate_points", points);
    }
  }
  if (outcome.starts > 1) {
    found.count("start", outcome.start).count("starts", outcome.starts);
  }
  found.objects("iterations", history);
  object.object("solution", found);
  if (!outcome.branch.empty()) {
    std::vector<figures::JsonObject> points;
    for (const BranchRow& point : outcome.branch) {
      figures::JsonObject one;
      one.number(outcome.parameter, point.parameter);
      if (outcome.parameter != "energy") {
        one.number("energy", point.energy);
      }
      if (const std::string_view duration = outcome.closes ? "period" : "time"; outcome.parameter != duration) {
        one.number(duration, point.duration);
      }
      points.push_back(one.flag("fold", point.is_fold));
    }
    object.objects("branch", points);
  }
  if (outcome.found()) {
    figures::add_figures(object, outcome.statistics);
  }
  object.number("wall_seconds", outcome.wall_seconds);
  if (!outcome.file.empty()) {
    object.text("file", outcome.file);
  }
  if (!outcome.message.empty()) {
    object.text("message", outcome.message);
  }
  return object.texts("warnings", outcome.warnings).str();
}

std::string to_table(const SolveOutcome& outcome) {
  using figures::label_of, figures::LineKind;
  std::string table = outcome.title + "\n";
  const auto row = [&table](std::string_view name, std::string_view value) {
    table += fmt::format("  {:<26} {}\n", name, value);
  };
  const BoundaryValueSolution& solution = outcome.solution;
  constexpr std::array<std::string_view, 3> stages = {"equal levels", "levels by the step law", "free levels"};
  for (std::size_t i = 0; i < solution.history.size();) {
    const int stage = solution.history[i].stage;
    std::vector<std::string> residuals;
    for (; i < solution.history.size() && solution.history[i].stage == stage; ++i) {
      residuals.push_back(fmt::format("{:.1e}", solution.history[i].residual));
    }
    constexpr std::size_t shown = 8;  // the last ones show how it converged
    if (residuals.size() > shown) {
      residuals.erase(residuals.begin() + 1, residuals.end() - (shown - 2));
      residuals[0] += ", ...";
    }
    row(stages[static_cast<std::size_t>(stage)], fmt::format("{}", fmt::join(residuals, ", ")));
  }
  if (outcome.starts > 1) {
    row("guess", fmt::format("{} of {}", outcome.start, outcome.starts));
  }
  if (!outcome.branch.empty()) {
    row("branch", fmt::format("{} solutions, {} from {:.10g} to {:.10g}", outcome.branch.size(), outcome.parameter,
                              outcome.branch.front().parameter, outcome.branch.back().parameter));
    for (const BranchRow& point : outcome.branch) {
      if (point.is_fold) {
        row("fold", fmt::format("{} = {:.12g}", outcome.parameter, point.parameter));
      }
    }
  }
  if (!outcome.found()) {
    row("verdict", "not found");
    return table;
  }
  row("residual", fmt::format("{:.1e}, the largest", solution.residual));
  row("steps", fmt::format("{}", solution.orbit.segments()));
  row("h", fmt::format("{:.6g} ... {:.6g}", outcome.statistics.h.min, outcome.statistics.h.max));
  row(outcome.closes ? "period" : "time", fmt::format("{:.15g}", solution.orbit.duration()));
  row("energy", fmt::format("{:.15g}", solution.mean_energy));
  if (outcome.closing) {
    row("closing", fmt::format("a run over one period ends {:.1e} beside its start", *outcome.closing));
  }
  if (solution.potential.active()) {
    row("with the step potential", fmt::format("{:.15g} on every step", solution.conserved));
  }
  for (const auto& [name, invariant] : outcome.statistics.invariants) {
    row("invariant " + name, fmt::format("{:.15g}, within {:.1e}", invariant.initial, invariant.max()));
  }
  for (const std::complex<double>& multiplier : outcome.multipliers) {
    row("Floquet multiplier", multiplier.imag() == 0.0
                                  ? fmt::format("{:.12g}", multiplier.real())
                                  : fmt::format("{:.12g} {:+.12g} i", multiplier.real(), multiplier.imag()));
  }
  if (outcome.index) {
    row("Morse index", fmt::format("{}", *outcome.index));
  }
  for (const double t : outcome.conjugate_points) {
    row("conjugate point", fmt::format("t = {:.10g}", t));
  }
  if (outcome.error && outcome.error->halved.found()) {
    const auto part = [](double error, std::string_view of) {
      return error > 0.0 ? fmt::format(", {:.1e} in the {}", error, of) : "";
    };
    row(label_of(LineKind::accuracy),
        fmt::format("{:.1e} of the size of the orbit{}{}, by half the step", outcome.error->relative,
                    part(outcome.error->duration, outcome.closes ? "period" : "time"),
                    part(outcome.error->energy, "energy")));
  }
  if (!outcome.dependent.empty()) {
    row("dependent conditions", fmt::format("{}", fmt::join(outcome.dependent, "; ")));
  }
  row(label_of(LineKind::verdict), figures::text_of(outcome.judgement));
  row("time taken", fmt::format("{:.3g} s", outcome.wall_seconds));
  row("record", outcome.file);
  return table;
}

}  // namespace rubato
