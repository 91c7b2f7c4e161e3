#include <rubato/run/warnings.hpp>

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <rubato/variation/first_step.hpp>

namespace rubato {

namespace {

/// Above this step condition the energy law still holds to the tolerance but its levels carry visible rounding.
constexpr double condition_warning = 1e-6;
/// A step potential of this part of the terms of the energy is reported as one: it is meant to be of the size of
/// errors.
constexpr double large_potential = 0.1;
/// With a step potential the energy depends on h everywhere: deviations of so many rounding errors of it are those of a
/// motion that does not change.
constexpr double most_roundings = 100.0;
/// So many times the steps of the law without a potential are reported as a cost that need not be paid.
constexpr double high_cost = 5.0;
/// f' as a part of H(z_k) - H(z_0).
constexpr double felt_potential = 1e-2;

/// What there is to warn of at the end of a run.
class RunWarnings {
public:
  RunWarnings(const Problem& problem, const ObservedRun& observed, const figures::Statistics& statistics)
      : problem_(problem), observed_(observed), statistics_(statistics) {}

  std::vector<std::string> take() {
    add_warnings();
    return std::move(warnings_);
  }

private:
  [[nodiscard]] const Simulation& simulation() const { return observed_.simulation(); }
  [[nodiscard]] const OffLawCauses& causes() const { return observed_.causes(); }

  void add_warnings() {
    for (std::string& sentence : simulation().warnings()) {
      warnings_.push_back(std::move(sentence));
    }
    if (observed_.undefined_outputs() > 0) {
      warnings_.push_back(fmt::format(
          "at {} of {} output times something is not defined: {}the step to that time could not be solved",
          observed_.undefined_outputs(), observed_.outputs(),
          problem_.output.quantities.empty() ? "" : "a formula of [output.quantities] left its domain, or "));
    }
    // With time_scale what time a run comes to is known at its end.
    if (const std::size_t times = problem_.output.times.size();
        simulation().finished() && observed_.outputs() < times) {
      warnings_.push_back(fmt::format(
          "{} of {} output times lie beyond the end of the run at t = {:.10g}: raise until, which is a fictitious time",
          times - observed_.outputs(), times, simulation().clock()));
    }
    const Scheme& scheme = problem_.scheme;
    for (std::string& sentence : statistics_.undefined_quantities()) {
      warnings_.push_back(std::move(sentence));
    }
    if (const int order = simulation().order();
        scheme.lagrangian == LagrangianName::generating && order != *scheme.order) {
      warnings_.push_back(
          fmt::format("order = {0} rounds up to {1}: with darboux = \"midpoint\" the even coefficients of the "
                      "generating function vanish, so that orders are even; write order = {1}",
                      *scheme.order, order));
    }
    if (statistics_.off_law_steps > 0 &&
        (scheme.potential.kind == StepPotentialChoice::Kind::none ||
         statistics_.off_law_deviation() > most_roundings * statistics_.rounding.largest())) {
      warnings_.push_back(about_off_law());
    }
    // What rounding leaves of energies that cancel is no measure of f', their terms are.
    const double terms = std::max(
        simulation().energy_terms(),
        node_energy_scale(statistics_.node_energy.values.largest(), simulation().integrator().levels().sizes()));
    if (const double part = statistics_.potential.largest() / terms; part > large_potential) {
      warnings_.push_back(fmt::format(
          "the first step is too long for this orbit: to keep the energy law the step potential had to become "
          "{:.2g}, which is {:.2g} of what the energy is made of; take a smaller step, or levels = \"fixed\" where the "
          "motion speeds up after the end of the run alone",
          statistics_.potential.largest(), part));
    }
    // One that was chosen for what lies beyond the run's end may be nothing up to there.
    const bool is_felt = statistics_.potential.largest() > felt_potential * statistics_.node_energy.max();
    if (const std::optional<double> cost = simulation().potential_cost(); is_felt && cost && *cost >= high_cost) {
      const bool takes_scale = problem_.hamiltonian() != nullptr && !problem_.hamiltonian()->fictitious_time;
      warnings_.push_back(fmt::format(
          "the step potential holds all steps near those where the motion is fastest: at the start it takes about "
          "{:.2g} times as many as the law would without it; {}step_potential = \"none\" lets steps follow the "
          "motion, with plain steps where the law has no solution",
          *cost, takes_scale ? "hamiltonian.time_scale has as few, every one of them on the law; " : ""));
    }
    if (statistics_.condition.any() && statistics_.condition.max > condition_warning) {
      warnings_.push_back(
          fmt::format("the step condition reached {:.2g}: rounding in H moves the levels by that relative amount; "
                      "larger steps make it smaller",
                      statistics_.condition.max));
    }
  }

  /// Why there were steps off the law, by what they show (OffLawCauses), and what to do.
  [[nodiscard]] std::string about_off_law() {
    const std::string count = fmt::format("{} of {} steps", statistics_.off_law_steps, statistics_.steps);
    const std::string off =
        fmt::format("{:.2g}{}", statistics_.relative_off_law_deviation().value_or(statistics_.off_law_deviation()),
                    statistics_.relative_off_law_deviation() ? " (relative)" : "");
    const HamiltonianProblem* orbit = problem_.hamiltonian();
    if (problem_.scheme.potential.kind != StepPotentialChoice::Kind::none && statistics_.potential.largest() == 0.0) {
      return fmt::format(
          "on {} the discrete energy is off that of the first by up to {}: where the run begins it does not depend "
          "on the step, so that every step is as long as the first; begin the run later, or use levels = \"fixed\"",
          count, off);
    }
    if (problem_.scheme.potential.kind != StepPotentialChoice::Kind::none) {
      const bool stated = problem_.scheme.potential.kind == StepPotentialChoice::Kind::given;
      return fmt::format(
          "on {} the level equation had no solution in spite of the step potential: {}; these steps are plain ones, "
          "off the law by up to {}; a smaller step or {} may mend it{}",
          count, stated ? "the one that is stated is too weak there" : "the orbit went beyond what that was chosen for",
          off, stated ? "a smaller kappa, or step_potential = \"auto\"," : "a smaller largest_step",
          orbit != nullptr && !orbit->fictitious_time
              ? ", or hamiltonian.time_scale where the motion is fast in places, as on an eccentric orbit"
              : "");
    }
    // Where most of them are flat any h keeps the energy: H is linear, or the order so high that its errors vanish.
    if (2 * causes().flat() > causes().steps()) {
      return fmt::format(
          "on {} the discrete energy is the same to rounding whatever h is: h was left as it was there; larger steps, "
          "a lower order or levels = \"fixed\" may suit this problem better",
          count);
    }
    if (causes().starting() == causes().steps()) {
      return fmt::format(
          "the first step is too long to set the law: {}, and {} plain; E is {}; take a smaller step", too_long(),
          count, causes().steps() == statistics_.steps ? "not set yet" : "that of the first step that meets the law");
    }
    const std::string plain = fmt::format("{} are plain ones, off the law by up to {}", count, off);
    if (causes().crossings() == 0 && !nears_zero()) {
      return fmt::format("the step is too long for this orbit: {}; {}; take a smaller step", too_long(), plain);
    }
    return fmt::format("{}, where the pure law has no solution: {}; {} keeps every step on its law",
                       causes().crossings() > 0 ? gamma_name() + " changes sign on this orbit" : nearly_zero(), plain,
                       problem_.scheme.lagrangian == LagrangianName::custom ? "a step potential, -f(t_1 - t_0) in L,"
                                                                            : "step_potential = \"auto\"");
  }

  /// Γ, or what the slopes of steps have in its place.
  [[nodiscard]] std::string gamma_name() {
    return simulation().has_gamma() ? "Gamma" : slope_name(simulation().order());
  }

  /// The smallest |Γ| of the run beside the largest.
  [[nodiscard]] bool nears_zero() const {
    constexpr double near = 0.02;
    const Spread& gamma = statistics_.gamma;
    return gamma.any() &&
           (gamma.min * gamma.max <= 0.0 || std::min(std::abs(gamma.min), std::abs(gamma.max)) <
                                                near * std::max(std::abs(gamma.min), std::abs(gamma.max)));
  }
  [[nodiscard]] std::string nearly_zero() const {
    const Spread& gamma = statistics_.gamma;
    return fmt::format("Gamma nears 0 on this orbit ({:.3g} to {:.3g})", gamma.min, gamma.max);
  }
  [[nodiscard]] std::string too_long() {
    return fmt::format("{} goes from {:.4g} to {:.4g} in one step", gamma_name(), causes().gamma_before(),
                       causes().gamma_after());
  }

  const Problem& problem_;
  const ObservedRun& observed_;
  const figures::Statistics& statistics_;
  std::vector<std::string> warnings_;
};

}  // namespace

std::vector<std::string> warnings_of(const Problem& problem, const ObservedRun& observed,
                                     const figures::Statistics& statistics) {
  return RunWarnings(problem, observed, statistics).take();
}

}  // namespace rubato
