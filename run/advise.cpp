#include <rubato/run/advise.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/figures/text.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/run_estimate.hpp>

namespace rubato {

namespace {

/// The numbers of the states that the runs of one trial compute; doubled, a trial takes twice as long. It takes less
/// than a second.
constexpr double numbers_of_a_trial = 1 << 20;
/// After a step that fails, a trial may compute so many times as many. Elsewhere the order extrapolates instead.
constexpr double longest_trial = 4.0;
constexpr int most_trials = 6;
/// The largest factor of the step or of the spacings from one trial to the next: orders hold nearby.
constexpr double largest_change = 6.0;
/// Trials aim at this part of the target. The last one has an error between `least_part` of the target and all of it.
constexpr double aimed_part = 0.6, least_part = 0.1;
/// Of fewer steps in a trial no order is seen.
constexpr double fewest_steps = 10.0;
/// Every scheme is of order 1 or more: a smaller one shows that the error does not fall by an order yet.
constexpr double least_order = 0.5;
/// The largest factor of the cells to extrapolate to: rough data need more, and other means.
constexpr double most_refinement = 32.0;
/// The range of a target that follows from the problem's own error.
constexpr double least_target = 1e-10, most_target = 1e-3;

/// What converge() finds of the step, or of the spacings.
struct RefinementEstimate {
  double error = 0.0;           ///< the largest, relative to Convergence::scale
  std::optional<double> order;  ///< of the quantity with that error
};

RefinementEstimate estimate_of(const ConvergenceOutcome& outcome, bool of_grid) {
  RefinementEstimate estimate;
  for (const Convergence& quantity : outcome.quantities) {
    if (of_grid && !quantity.grid) {
      continue;
    }
    const Refinement& refinement = of_grid ? *quantity.grid : quantity.step;
    const double error = refinement.error() / quantity.scale;
    if (std::isfinite(error) && error > estimate.error) {  // a quantity may be undefined, or 0
      const auto order = refinement.order();
      estimate = {.error = error, .order = order && *order >= least_order ? order : std::nullopt};
    }
  }
  return estimate;
}

/// The factor of the step that changes the error to `wanted`, by the order.
double factor_to(double wanted, const RefinementEstimate& estimate) {
  if (estimate.error == 0.0) {  // rounding
    return largest_change;
  }
  const double ratio = wanted / estimate.error;
  const double factor = estimate.order ? std::pow(ratio, 1.0 / *estimate.order) : (ratio < 1.0 ? 0.25 : 2.0);
  return std::clamp(factor, 1.0 / largest_change, largest_change);
}

/// Rounded down: what is tried is what is printed.
double in_three_digits(double step) {
  const double unit = std::pow(10.0, std::floor(std::log10(std::abs(step))) - 2.0);
  return std::stod(fmt::format("{:.2e}", std::copysign(std::floor(std::abs(step) / unit + 1e-9) * unit, step)));
}

/// The numbers of a state.
double numbers_of(const Problem& problem) {
  if (const HamiltonianProblem* const orbit = problem.hamiltonian()) {
    return static_cast<double>(orbit->names().size());
  }
  auto numbers = static_cast<double>(problem.multisymplectic()->fields.size());
  for (const GridAxis& axis : problem.multisymplectic()->axes) {
    numbers *= static_cast<double>(axis.cells);
  }
  return numbers;
}

/// A scheme that was searched for.
struct FoundScheme {
  AdvisedScheme scheme;
  Problem problem;
  double factor = 1.0;                                      ///< of the step, to an error that is exactly the target
  double stages = std::numeric_limits<double>::infinity();  ///< of a trial on all nodes, at that error

  /// True for the better one of two variants of a family.
  [[nodiscard]] bool is_before(const FoundScheme& other) const {
    const bool fails = !scheme.failure.empty(), other_fails = !other.scheme.failure.empty();
    return fails != other_fails ? other_fails : stages < other.stages;
  }
};

/// A trial of one scheme with one step.
struct Trial {
  AdvisedScheme scheme = {};
  bool ended = false;
  double steps = 0.0;  ///< taken with the whole step
  RefinementEstimate of_step = {}, of_grid = {};
};

/// What all trials of one problem have in common.
class Trials {
public:
  Trials(const Problem& problem, const RunOptions& options)
      : problem_(problem), options_(options), text_(without_scheme(problem)), until_(problem.scheme.until) {
    const double steps = std::max(fewest_steps, numbers_of_a_trial / numbers_of(problem) / runs_of_a_trial);
    const double step = *problem.scheme.step;
    if (std::abs(step) * steps < std::abs(until_ - problem.start())) {
      until_ = problem.start() + steps * step;
    }
  }

  [[nodiscard]] const Problem& problem() const { return problem_; }
  [[nodiscard]] double until() const { return until_; }
  [[nodiscard]] double length() const { return std::abs(until_ - problem_.start()); }
  /// How many times the numbers of a trial one with another step computes.
  [[nodiscard]] double size(const Problem& problem, double step) const {
    return numbers_of(problem) * length() / step * runs_of_a_trial / numbers_of_a_trial;
  }

  Trial run(const Problem& problem, bool with_grids) const {
    Trial trial;
    trial.scheme.step = *problem.scheme.step;
    if (const MultisymplecticProblem* const pde = problem.multisymplectic()) {
      for (const GridAxis& axis : pde->axes) {
        trial.scheme.cells.emplace_back(axis.name, axis.cells);
      }
    }
    const ConvergenceOutcome outcome =
        converge(problem, std::nullopt, options_, {.until = until_, .grids = with_grids});
    if (outcome.status == ExitStatus::interrupted) {
      throw Interrupted();
    }
    trial.ended = outcome.ended && outcome.status == ExitStatus::done;
    if (!trial.ended) {
      trial.scheme.failure = outcome.message;
      return trial;
    }
    trial.steps = static_cast<double>(outcome.steps);
    trial.of_step = estimate_of(outcome, false);
    trial.of_grid = estimate_of(outcome, true);
    trial.scheme.step_error = trial.of_step.error;
    trial.scheme.order = trial.of_step.order;
    if (with_grids && problem.multisymplectic() != nullptr) {
      trial.scheme.grid_error = trial.of_grid.error;
    }
    trial.scheme.verdict = outcome.findings.verdict();
    return trial;
  }

  /// The problem with another scheme. \param refinement factor of the numbers of cells
  /// \throws ProblemError, std::invalid_argument if the scheme does not take it
  [[nodiscard]] Problem with(const SchemeVariant& variant, double step, double refinement) const {
    std::vector<std::string> settings = {fmt::format("scheme.step={}", std::copysign(step, *problem_.scheme.step))};
    for (const auto& [key, value] : variant.entries) {
      settings.push_back(fmt::format("scheme.{}={}", key, value));
    }
    if (variant.lattice) {
      const auto method = make_lattice_method(*variant.lattice);
      const std::vector<GridAxis>& axes = problem_.multisymplectic()->axes;
      const auto dimensions = static_cast<int>(axes.size());
      for (const GridAxis& axis : axes) {
        const auto wanted = static_cast<std::size_t>(std::ceil(static_cast<double>(axis.cells) * refinement));
        const bool is_taken = refinement == 1.0 && !method->other_count(wanted, dimensions);
        settings.push_back(
            fmt::format("grid.{}.cells={}", axis.name, is_taken ? wanted : method->count_near(wanted, dimensions)));
      }
    }
    return parse_problem(text_, problem_.source, settings);
  }

  void add_cost(FoundScheme& found) const {
    AdvisedScheme& scheme = found.scheme;
    if (!scheme.failure.empty()) {
      return;
    }
    try {
      scheme.seconds = estimate_run(found.problem, options_).seconds;
    } catch (const ProblemError& error) {
      scheme.failure = error.reason();
    }
    if (scheme.seconds) {
      scheme.cost = *scheme.seconds / found.factor;
    }
  }

private:
  /// The work of a trial, in units of its run with the whole step.
  static constexpr double runs_of_a_trial = 1.0 + 2.0 + 4.0;

  const Problem& problem_;
  const RunOptions& options_;
  std::string text_;  ///< of the problem, without its scheme
  double until_;
};

/// The search of the step and the cells with which a scheme has the target error.
class StepSearch {
public:
  StepSearch(const Trials& trials, const SchemeVariant& variant, double target)
      : trials_(trials), variant_(variant), target_(target), longest_(trials.length() / fewest_steps) {
    step_ = in_three_digits(std::min(std::abs(*trials.problem().scheme.step), longest_));
  }

  /// \param stages beyond which another variant is better: the search ends early
  /// \throws ProblemError, std::invalid_argument if the scheme does not take the problem
  FoundScheme find(double stages) {
    for (int count = 0; count < most_trials; ++count) {
      problem_ = trials_.with(variant_, step_, refinement_);
      if (count > 0 && trials_.size(problem_, step_) > most_) {
        break;
      }
      const bool grid_is_known = last_.ended && refinement_ == last_refinement_;
      Trial trial = trials_.run(problem_, !grid_is_known);
      trial.scheme.entries = variant_.entries;
      if (grid_is_known) {
        trial.of_grid = last_.of_grid;
        trial.scheme.grid_error = last_.scheme.grid_error;
      }
      if (trial.ended ? !goes_on_after(trial) || stages_of(trial) > hopeless * stages : !shortens()) {
        break;
      }
      if (trial.ended || !last_.ended) {
        last_ = std::move(trial);
      }
    }
    return best_ ? *std::move(best_) : extrapolated();
  }

private:
  /// Factor between stages by a first trial and by the last one.
  static constexpr double hopeless = 2.0;

  /// The stages at an error that is exactly the target, by the orders.
  [[nodiscard]] double stages_of(const Trial& trial) const {
    const double dimensions = static_cast<double>(trial.scheme.cells.size());
    return variant_.stages * trial.steps * numbers_of(problem_) / to_target(trial) /
           std::pow(std::min(1.0, factor_to(target_, trial.of_grid)), dimensions);
  }
  [[nodiscard]] double to_target(const Trial& trial) const {
    return std::min(factor_to(target_, trial.of_step), std::max(1.0, longest_ / std::abs(trial.scheme.step)));
  }

  /// After a step that fails: the longest one is between those that do not and this one.
  bool shortens() {
    const double works = best_ ? std::abs(best_->scheme.step) : 0.0;
    longest_ = std::max(works, 0.75 * step_);
    most_ = longest_trial;
    step_ = in_three_digits(best_ ? std::sqrt(works * step_) : step_ / 4.0);
    return step_ > 1.25 * works;
  }

  /// Keeps the trial if it meets the target, and chooses the next step. False if there is nothing to gain.
  bool goes_on_after(const Trial& trial) {
    const bool meets = trial.of_step.error <= target_ && trial.of_grid.error <= target_;
    const double next = std::min(step_ * factor_to(aimed_part * target_, trial.of_step), longest_);
    if (meets) {
      FoundScheme found{.scheme = trial.scheme, .problem = problem_};
      if (trial.of_step.error >= least_part * target_) {
        found.factor = std::max(1.0, to_target(trial));
      }
      found.stages = variant_.stages * trial.steps * numbers_of(problem_) / found.factor;
      if (!best_ || found.is_before(*best_)) {
        best_ = std::move(found);
      }
      if (trial.of_step.error >= least_part * target_ || next < 1.25 * step_) {
        return false;
      }
    }
    last_refinement_ = refinement_;
    most_ = 1.0;
    if (trial.of_grid.error > target_ && !trial.of_grid.order) {
      step_ = in_three_digits(step_ / 4.0);  // not stable on the finer grids
      most_ = longest_trial;
      last_refinement_ = 0.0;
      return true;
    }
    step_ = in_three_digits(next);
    refinement_ /= std::min(1.0, factor_to(aimed_part * target_, trial.of_grid));
    return true;
  }

  /// What the last trial's order says of a step that was not tried, or why it says nothing.
  [[nodiscard]] FoundScheme extrapolated() {
    FoundScheme found{.scheme = last_.scheme, .problem = problem_};
    AdvisedScheme& scheme = found.scheme;
    if (!last_.ended) {
      return found;
    }
    const bool knows_step = last_.of_step.error <= target_ || last_.of_step.order;
    const bool knows_grid = last_.of_grid.error <= target_ || last_.of_grid.order;
    if (!knows_step || !knows_grid) {
      scheme.failure =
          fmt::format("no order is seen of the {}, down to step = {}", knows_step ? "grid" : "step", scheme.step);
      return found;
    }
    const double factor = extrapolated_factor(last_.of_step), coarser = extrapolated_factor(last_.of_grid);
    const double step = in_three_digits(std::abs(scheme.step) * factor);
    if (coarser * most_refinement < 1.0) {
      scheme.failure = fmt::format("the error of the grid, {:.2g}, falls by order {:.1f} only", last_.of_grid.error,
                                   last_.of_grid.order.value_or(0.0));
      return found;
    }
    found.problem = trials_.with(variant_, step, last_refinement_ / coarser);
    found.stages = variant_.stages * last_.steps / factor * numbers_of(found.problem);
    scheme.measured = false;
    scheme.step = std::copysign(step, scheme.step);
    scheme.step_error = last_.of_step.error * std::pow(factor, last_.of_step.order.value_or(0.0));
    if (!scheme.cells.empty()) {
      scheme.grid_error = last_.of_grid.error * std::pow(coarser, last_.of_grid.order.value_or(0.0));
      for (std::size_t axis = 0; axis < scheme.cells.size(); ++axis) {
        scheme.cells[axis].second = found.problem.multisymplectic()->axes[axis].cells;
      }
    }
    return found;
  }
  [[nodiscard]] double extrapolated_factor(const RefinementEstimate& estimate) const {
    return estimate.error <= target_ ? 1.0 : std::pow(aimed_part * target_ / estimate.error, 1.0 / *estimate.order);
  }

  const Trials& trials_;
  const SchemeVariant& variant_;
  double target_;
  double step_ = 0.0, refinement_ = 1.0, last_refinement_ = 0.0;  ///< of the next trial, and of the last one
  double most_ = 1.0;                                             ///< of Trials::size()
  double longest_;                                                ///< step
  Problem problem_;                                               ///< of the trial
  Trial last_;
  std::optional<FoundScheme> best_;
};

/// A method that does not take the problem, and why.
using Refusal = std::pair<std::string, std::string>;

/// Returns nothing if the scheme does not take the problem; the first reason of each method is added to `refused`.
/// \param stages as of StepSearch::find() \param refused null: not kept
std::optional<FoundScheme> searched(const Trials& trials, const SchemeVariant& variant, double target, double stages,
                                    std::vector<Refusal>* refused) {
  const std::string& method = variant.entries.front().second;
  try {
    return StepSearch(trials, variant, target).find(stages);
  } catch (const std::invalid_argument& error) {
    const auto* const at_a_place = dynamic_cast<const ProblemError*>(&error);
    const std::string reason = std::string(at_a_place != nullptr ? at_a_place->reason() : error.what());
    if (refused != nullptr && std::ranges::find(*refused, method, &Refusal::first) == refused->end()) {
      refused->emplace_back(method, reason);
    }
    return std::nullopt;
  }
}

/// The best variant of each family with equal steps, and the same variant with variable levels.
std::vector<FoundScheme> best_of_families(const Trials& trials, Advice& advice) {
  struct Best {
    FoundScheme found;
    const SchemeVariant* variant;
  };
  const std::vector<SchemeVariant> variants = scheme_variants(trials.problem());
  std::map<std::string, Best> best;
  for (const SchemeVariant& variant : variants) {
    const auto known = best.find(variant.family);
    const double stages = known == best.end() ? std::numeric_limits<double>::infinity() : known->second.found.stages;
    auto found = searched(trials, variant.with(Levels::fixed), advice.target, stages, &advice.refused);
    if (found && (known == best.end() || found->is_before(known->second.found))) {
      best.insert_or_assign(variant.family, Best{*std::move(found), &variant});
    }
  }
  std::vector<FoundScheme> all;
  for (auto& [family, one] : best) {
    all.push_back(std::move(one.found));
    if (auto found = searched(trials, one.variant->with(Levels::variable), advice.target,
                              std::numeric_limits<double>::infinity(), nullptr)) {
      all.push_back(*std::move(found));
    }
  }
  return all;
}

/// What a scheme has for the time that it takes: the larger of its errors.
double error_of(const AdvisedScheme& scheme) {
  return std::max(scheme.step_error.value_or(0.0), scheme.grid_error.value_or(0.0));
}

/// True if a scheme takes no longer than another one and has no larger error, and differs in one of them.
bool dominates(const AdvisedScheme& scheme, const AdvisedScheme& other) {
  const double error = error_of(scheme), other_error = error_of(other);
  return scheme.seconds && other.seconds && *scheme.seconds <= *other.seconds && error <= other_error &&
         (*scheme.seconds < *other.seconds || error < other_error);
}

/// By cost at equal error; those without one last. Where the order of a scheme promises more than its trials show, as
/// of one whose step may grow no further, its cost is at most that of any scheme that takes longer for a larger error.
void rank(std::vector<AdvisedScheme>& schemes) {
  struct Place {
    double cost, seconds, error;
    auto operator<=>(const Place&) const = default;
  };
  std::vector<std::pair<Place, std::size_t>> places;
  for (std::size_t i = 0; i < schemes.size(); ++i) {
    const AdvisedScheme& scheme = schemes[i];
    constexpr double never = std::numeric_limits<double>::infinity();
    Place place{scheme.cost.value_or(never), scheme.seconds.value_or(never), error_of(scheme)};
    for (const AdvisedScheme& other : schemes) {
      if (scheme.cost && other.cost && dominates(scheme, other)) {
        place.cost = std::min(place.cost, *other.cost);
      }
    }
    places.emplace_back(place, i);
  }
  std::ranges::sort(places);
  std::vector<AdvisedScheme> ranked;
  for (const auto& [place, number] : places) {
    ranked.push_back(std::move(schemes[number]));
    if (ranked.back().cost) {
      ranked.back().cost = place.cost;
    }
  }
  schemes = std::move(ranked);
}

}  // namespace

Advice advise(const Problem& problem, std::optional<double> tolerance, const RunOptions& options) {
  require_refinable(problem, options, "advise");
  const Trials trials(problem, options);
  Advice advice;
  advice.title = problem.title;
  advice.until = trials.until();
  advice.whole_run = trials.until() == problem.scheme.until;
  try {
    const Trial trial = trials.run(problem, true);
    const double error = trial.ended ? std::max(trial.of_step.error, trial.of_grid.error) : most_target;
    advice.target = tolerance.value_or(std::clamp(error, least_target, most_target));
    FoundScheme present{.scheme = trial.scheme, .problem = problem};
    trials.add_cost(present);
    advice.present = std::move(present.scheme);
    for (FoundScheme& found : best_of_families(trials, advice)) {
      trials.add_cost(found);
      advice.schemes.push_back(std::move(found.scheme));
    }
  } catch (const Interrupted&) {
    advice.status = ExitStatus::interrupted;
    advice.message = "interrupted before every scheme was tried";
    return advice;
  }
  rank(advice.schemes);
  if (advice.schemes.empty() || !advice.schemes.front().cost) {
    advice.status = ExitStatus::failed;
    advice.message = "no scheme reached the target in its trials; try a smaller scheme.step, or a larger --tolerance";
  }
  return advice;
}

}  // namespace rubato
