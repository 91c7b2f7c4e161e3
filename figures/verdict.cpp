#include <rubato/figures/verdict.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include <rubato/figures/statistics.hpp>

namespace rubato::figures {

namespace {

/// Of the energy exchanged, what an error of the node energy may be: above the first a run is doubtful, above the
/// second lost.
constexpr double doubtful_energy = 0.1, lost_energy = 0.5;
/// Of a field's power, the share in the last third of its waves.
constexpr double doubtful_waves = 1e-6, lost_waves = 1e-2;
/// Of the size of a formula, what it is off between the nodes: waves of three nodes have half, aliases nearly all.
constexpr double doubtful_between = 0.6, lost_between = 0.75;
/// Breaks of slope or value at the seam below this are less than truncation errors usually are.
constexpr double doubtful_period = 1e-3;
/// Errors of an exact solution at the start are rounding; those of its first increment truncation errors, of the cells
/// and of one step.
constexpr double wrong_start = 1e-6, wrong_residual = 0.05;
/// Of the first increment the error of a step of the midpoint rule, (ωh)²/6 of it: ω h = 2π over the steps per turn.
double error_of_step(double steps_per_turn) {
  const double angle = 2.0 * std::numbers::pi / steps_per_turn;
  return angle * angle / 6.0;
}
/// Of the range of a coordinate or momentum, or of the duration, what the solution of a boundary-value problem is off
/// by one with half the step.
constexpr double doubtful_halved = 0.1, lost_halved = 0.5;
/// Relative deviations of E_k below this are rounding: the law does not determine h there, and any step meets it.
constexpr double least_off_law = 1e-9;
/// So are those of so many rounding errors of H where the energy is 0: E_k sums up the stages or parts of a step.
constexpr double most_roundings = 100.0;

/// What of the pure law is expected to be off: steps near each zero of Γ, by errors of the scheme.
constexpr double few_off_law = 0.5, small_off_law = 0.02;

class Judge {
public:
  explicit Judge(const Statistics& statistics) : statistics_(statistics), measures_(statistics.measures) {}

  Judgement run() {
    judge_energy();
    judge_law();
    judge_waves();
    judge_sampling();
    judge_period();
    judge_exact();
    judge_resolution();
    judge_halved_steps();
    judge_events();
    judge_end();
    judge_action();
    judge_conditions();
    for (const Reason& reason : result_.reasons) {
      result_.verdict = std::max(result_.verdict, reason.verdict);
    }
    return std::move(result_);
  }

private:
  void add(Reason reason) {
    (measures_.accepts(reason.kind) ? result_.accepted : result_.reasons).push_back(std::move(reason));
  }

  void judge_energy() {
    if (!(measures_.energy > doubtful_energy)) {
      return;
    }
    const std::string_view energy = statistics_.balance ? "node energy less the work" : "node energy";
    const double t = measures_.energy_t;
    add({.kind = ReasonKind::energy,
         .verdict = measures_.energy > lost_energy ? Verdict::lost : Verdict::doubtful,
         .value = measures_.energy,
         .finding = std::isnan(t)
                        ? fmt::format("the {} strays by {:.2g} of the size of its terms, in the mean over the run",
                                      energy, measures_.energy)
                        : fmt::format("the {} strays by {:.2g} of the energy that is exchanged (at t = {:.6g})", energy,
                                      measures_.energy, t),
         .remedy = "take smaller steps, or a scheme of higher order"});
  }

  void judge_law() {
    const std::size_t steps = statistics_.off_law_steps;
    // Where E and H are near 0, as at the edge of escape, the energy exchanged is what a deviation is small or large
    // by.
    const double deviation = statistics_.off_law_deviation(),
                 scale = std::fmax(statistics_.energy_scale(), measures_.exchanged);
    if (steps == 0 || !(deviation > std::max(least_off_law * scale, most_roundings * statistics_.rounding.largest()))) {
      return;
    }
    const bool few = static_cast<double>(steps) < few_off_law * static_cast<double>(statistics_.steps);
    if (measures_.pure_law != 0.0 && few && deviation < small_off_law * scale) {
      return;  // steps over the singular set, which the problem asks for
    }
    const auto relative = statistics_.relative_off_law_deviation();
    add({.kind = ReasonKind::law,
         .verdict = Verdict::doubtful,
         .value = static_cast<double>(steps),
         .finding = fmt::format("{} of {} steps are off the energy law, by up to {:.2g}{}", steps, statistics_.steps,
                                relative.value_or(deviation), relative ? " (relative)" : ""),
         .remedy = "take smaller steps, or step_potential = \"auto\""});
  }

  void judge_waves() {
    if (measures_.frozen > doubtful_waves) {
      add({.kind = ReasonKind::spectrum,
           .verdict = measures_.frozen > lost_waves && measures_.rough == 0.0 ? Verdict::lost : Verdict::doubtful,
           .value = measures_.frozen,
           .finding = fmt::format("{:.2g} of a field's power at the start is in the shortest wave of an even number of "
                                  "cells, which spectral derivatives leave as it is",
                                  measures_.frozen),
           .remedy = "take an odd number of cells, or more of them"});
    }
    if (measures_.waves > doubtful_waves) {
      add({.kind = ReasonKind::spectrum,
           .verdict = measures_.waves > lost_waves && measures_.rough == 0.0 ? Verdict::lost : Verdict::doubtful,
           .value = measures_.waves,
           .finding =
               fmt::format("the spectrum is full: {:.2g} of a field's power is in the last third of the waves of "
                           "the grid (at t = {:.6g})",
                           measures_.waves, measures_.waves_t),
           .remedy = "take more cells, or end the run before"});
    }
  }

  void judge_sampling() {
    if (measures_.between_nodes > doubtful_between) {
      add({.kind = ReasonKind::spectrum,
           .verdict = measures_.between_nodes > lost_between ? Verdict::lost : Verdict::doubtful,
           .value = measures_.between_nodes,
           .finding = fmt::format("the grid does not hold the formulas of [initial], or S as a function of place: "
                                  "between the nodes they are off by {:.2g} of their size",
                                  measures_.between_nodes),
           .remedy = "take more cells"});
    }
  }

  void judge_period() {
    if (measures_.period > doubtful_period) {
      add({.kind = ReasonKind::period,
           .verdict = Verdict::doubtful,
           .value = measures_.period,
           .finding = fmt::format("the data, or S as a function of place, do not close on the period: they break by "
                                  "{:.2g} of their size at the seam",
                                  measures_.period),
           .remedy = "take a period at whose ends they agree, or one so long that the fields vanish there"});
    }
  }

  void judge_exact() {
    if (measures_.exact_start > wrong_start) {
      add({.kind = ReasonKind::exact,
           .verdict = Verdict::doubtful,
           .value = measures_.exact_start,
           .finding =
               fmt::format("[exact] differs from [initial] at the start by {:.2g} of its size", measures_.exact_start),
           .remedy = "correct the formula of [exact], or the initial data"});
    }
    if (measures_.exact_residual > std::fmax(wrong_residual, error_of_step(measures_.turn))) {
      add({.kind = ReasonKind::exact,
           .verdict = Verdict::doubtful,
           .value = measures_.exact_residual,
           .finding =
               fmt::format("the first increment of [exact] is off that of the run by {:.2g} of itself: it does not "
                           "solve the equation, or cells or steps are too coarse for it",
                           measures_.exact_residual),
           .remedy = "take more cells and smaller steps, or correct the formula of [exact]"});
    }
  }

  void judge_resolution() {
    if (measures_.turn < measures_.turn_least) {
      add({.kind = ReasonKind::resolution,
           .verdict = Verdict::doubtful,
           .value = measures_.turn,
           .finding = fmt::format("the steps do not resolve the motion: {:.2g} steps per turn of the fastest frequency "
                                  "(at t = {:.6g})",
                                  measures_.turn, measures_.turn_t),
           .remedy = fmt::format("take at least {:.2g} steps per turn", measures_.turn_least)});
    }
    if (!std::isnan(measures_.pole_t)) {
      add({.kind = ReasonKind::resolution,
           .verdict = Verdict::lost,
           .value = measures_.pole_t,
           .finding = fmt::format("a step goes over a pole of the energy, where a divisor in it is 0 and no motion can "
                                  "pass (at t = {:.6g})",
                                  measures_.pole_t),
           .remedy = "take smaller steps, or end the run before"});
    }
  }

  /// The same of a boundary-value problem.
  void judge_halved_steps() {
    if (!(measures_.halved > doubtful_halved)) {
      return;
    }
    const bool found = std::isfinite(measures_.halved);
    add({.kind = ReasonKind::resolution,
         .verdict = found && measures_.halved > lost_halved ? Verdict::lost : Verdict::doubtful,
         .value = measures_.halved,
         .finding = found ? fmt::format("the steps do not resolve the orbit: by a solution with half the step they "
                                        "leave an error of {:.2g} of its size or duration (at t = {:.6g})",
                                        measures_.halved, measures_.halved_t)
                          : "the steps do not resolve the orbit: with half the step no solution is found near it",
         .remedy = "take smaller steps"});
  }

  void judge_conditions() {
    if (measures_.rest == 1.0) {
      add({.kind = ReasonKind::conditions,
           .verdict = Verdict::doubtful,
           .value = measures_.rest,
           .finding = "the solution is an equilibrium, where nothing moves: the guess led there",
           .remedy = "begin with a larger motion, or take a longer period or another energy"});
    }
    if (measures_.open > 0.0) {
      const bool duration = measures_.open_duration == 1.0, energy = measures_.open_energy == 1.0;
      const std::string_view what = duration && energy ? "the duration and the energy of the orbit"
                                    : duration         ? "the duration of the orbit"
                                    : energy           ? "the energy of the orbit"
                                                       : "the orbit";
      add({.kind = ReasonKind::conditions,
           .verdict = Verdict::doubtful,
           .value = measures_.open,
           .finding = fmt::format("[solve] does not determine {}: the solution is one of a family{}", what,
                                  measures_.open > 1.0 ? fmt::format(" of {:.0f} dimensions", measures_.open) : ""),
           .remedy = fmt::format("give {} in place of a condition that follows from the others",
                                 duration && energy ? "the duration or the energy"
                                 : duration         ? "the duration"
                                 : energy           ? "the energy"
                                                    : "another one")});
    }
  }

  void judge_events() {
    for (const auto& [name, event] : statistics_.events) {
      if (event.returned > 0) {
        add({.kind = ReasonKind::event,
             .verdict = Verdict::doubtful,
             .value = static_cast<double>(event.returned),
             .finding = fmt::format("event {} starts at its zero and has returned through it within the first step, "
                                    "unseen",
                                    name),
             .remedy = "take a smaller step, or end the run there"});
      }
    }
  }

  void judge_end() {
    if (!std::isnan(measures_.end)) {
      add({.kind = ReasonKind::end,
           .verdict = Verdict::doubtful,
           .value = measures_.end,
           .finding =
               fmt::format("the run failed at t = {:.6g}, before until = {:.6g}, and its figures hold up to there",
                           measures_.end, measures_.end_wanted),
           .remedy = "take the remedy that its message names, or end it before"});
    }
  }

  void judge_action() {
    if (measures_.action > 0.0) {
      add({.kind = ReasonKind::action,
           .verdict = Verdict::doubtful,
           .value = measures_.action,
           .finding =
               fmt::format("L does not approximate the equation: its variation stays off by {:.2g} of the terms, "
                           "however small steps and cells are",
                           measures_.action),
           .remedy = "correct L: the action of an orbit's step is (t_1 - t_0)*L, and in a frame L is of its fields"});
    }
  }

  const Statistics& statistics_;
  const Measures& measures_;
  Judgement result_;
};

}  // namespace

std::string_view to_string(Verdict verdict) {
  constexpr std::array<std::string_view, 3> words = {"good", "doubtful", "lost"};
  return words[static_cast<std::size_t>(verdict)];
}

std::vector<double> to_values(const Measures& measures) {
  std::vector<double> values;
  Measures::visit(measures, [&values](double value) { values.push_back(value); });
  return values;
}

Measures measures_of(std::span<const double> values) {
  Measures measures;
  std::size_t next = 0;
  Measures::visit(measures, [&](double& value) {
    if (next < values.size()) {
      value = values[next++];
    }
  });
  return measures;
}

Judgement judge(const Statistics& statistics) {
  return Judge(statistics).run();
}

std::string text_of(const Judgement& judgement) {
  std::string text(to_string(judgement.verdict));
  for (const Reason& reason : judgement.reasons) {
    text += fmt::format("{}{}; {}", &reason == judgement.reasons.data() ? ": " : ". ", reason.finding, reason.remedy);
  }
  for (const Reason& reason : judgement.accepted) {
    text +=
        fmt::format("{}accepted by [verdict]: {}", &reason == judgement.accepted.data() ? " (" : "; ", reason.finding);
  }
  return text + (judgement.accepted.empty() ? "" : ")");
}

}  // namespace rubato::figures
