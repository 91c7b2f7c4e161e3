#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/periodic_lattice.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/solve.hpp>
#include <rubato/run/lattice_solve.hpp>
#include <rubato/run/record_scales.hpp>

namespace rubato {

namespace {

std::unique_ptr<PeriodicStep> step_of(const Problem& problem, const MultisymplecticSystem& system) {
  const Scheme& scheme = problem.scheme;
  if (scheme.method == "splitting") {
    return make_split_step(system, make_grid(problem), composition(scheme.composition),
                           scheme.space == "differences" ? Collocation::corners : Collocation::nodes);
  }
  return make_swept_step(system, make_grid(problem), scheme.method == "box" ? Collocation::cells : Collocation::nodes);
}

/// The problem with so many equal steps over a period.
Problem over_period(Problem problem, double period) {
  problem.scheme.step = period / static_cast<double>(problem.solve->steps);
  problem.scheme.until = problem.start() + period;
  return problem;
}

/// A problem that runs over one period of the solution, from its first level.
class SolvedLattice {
public:
  SolvedLattice(const Problem& problem, const PeriodOfLattice& orbit) {
    const MultisymplecticProblem& pde = *problem.multisymplectic();
    const MultisymplecticSystem system = make_system(problem);
    WholeFields whole(make_jumps(problem), make_grid(problem), system.field_count());
    std::vector<std::string> names;
    for (int f = 0; f < system.field_count(); ++f) {
      if (!system.structure().algebraic[static_cast<std::size_t>(f)]) {
        const std::span<const double> values = whole(f, orbit.levels.front().all());
        arrays_.emplace(system.fields()[static_cast<std::size_t>(f)], std::vector(values.begin(), values.end()));
        names.push_back(fmt::format("\"{}\"", system.fields()[static_cast<std::size_t>(f)]));
      }
    }
    const std::vector<std::string> settings = {"-initial",
                                               "initial.from=the solution",
                                               fmt::format("initial.t={:.17g}", pde.start),
                                               fmt::format("initial.at={:.17g}", pde.start),
                                               fmt::format("initial.take=[{}]", fmt::join(names, ", ")),
                                               fmt::format("scheme.step={:.17g}", orbit.step()),
                                               fmt::format("scheme.until={:.17g}", pde.start + orbit.period)};
    problem_ = parse_problem(problem.text, problem.source, settings);
    auto& solved = std::get<MultisymplecticProblem>(problem_.system);
    for (const auto& [name, values] : arrays_) {
      solved.initial_record->arrays.emplace(name, values);
    }
  }
  [[nodiscard]] const Problem& problem() const { return problem_; }

private:
  std::map<std::string, std::vector<double>> arrays_;
  Problem problem_;
};

/// The largest |z_N - z_0| beside closing_scales(), of fields that have an equation of motion, after a run over the
/// period.
double distance_after_period(const Problem& problem) {
  LatticeIntegrator lattice = make_lattice(problem);
  const grids::FieldSet first = lattice.level().fields;
  std::vector<double> largest(static_cast<std::size_t>(first.fields()), 0.0);
  while (!lattice.finished()) {
    if (lattice.step().status != Status::success) {
      return std::numeric_limits<double>::infinity();
    }
    for (int f = 0; f < first.fields(); ++f) {
      double& size = largest[static_cast<std::size_t>(f)];
      size = std::max(size, grids::max_abs(lattice.field(f)));
    }
  }
  const std::vector<double> scales = closing_scales(std::move(largest));
  double distance = 0.0;
  for (int f = 0; f < first.fields(); ++f) {
    const auto which = static_cast<std::size_t>(f);
    for (std::size_t i = 0; i < first.size() && !lattice.system().structure().algebraic[which]; ++i) {
      distance = std::max(distance, std::abs(lattice.field(f)[i] - first.field(f)[i]) / scales[which]);
    }
  }
  return distance;
}

/// Each step in two halves: between its levels fields are interpolated by cubics, and those of the middle of a step
/// stay as they are.
PeriodOfLattice halved_steps(const MultisymplecticSystem& system, const PeriodOfLattice& orbit) {
  PeriodOfLattice halved{.levels = {}, .slopes = orbit.slopes, .period = orbit.period};
  const std::size_t steps = orbit.steps();
  const auto level = [&](std::size_t k) -> const grids::FieldSet& { return orbit.levels[k % steps]; };
  for (std::size_t k = 0; k < steps; ++k) {
    grids::FieldSet between = level(k);
    for (int f = 0; f < between.fields(); ++f) {
      const std::span<double> middle = between.field(f);
      for (std::size_t i = 0; i < middle.size() && !system.structure().algebraic[static_cast<std::size_t>(f)]; ++i) {
        middle[i] = (9.0 * (level(k).field(f)[i] + level(k + 1).field(f)[i]) - level(k + steps - 1).field(f)[i] -
                     level(k + 2).field(f)[i]) /
                    16.0;
      }
    }
    halved.levels.push_back(level(k));
    halved.levels.push_back(std::move(between));
  }
  return halved;
}

/// As step_error() of an orbit: of the error that the steps leave, the largest beside the largest value of its field
/// (closing_scales()). \param start the time of the first level
HalvedMeasure error_by_halved_steps(const MultisymplecticSystem& system, const PeriodOfLattice& orbit,
                                    const PeriodicLatticeSolution& halved, int order, double start) {
  if (!halved.found()) {
    return {.relative = std::numeric_limits<double>::infinity(), .t = start};
  }
  const double factor = 1.0 / (1.0 - std::exp2(-order));
  const int fields = orbit.levels.front().fields();
  std::vector<double> largest(static_cast<std::size_t>(fields), 0.0);
  const auto moves = [&](int f) { return !system.structure().algebraic[static_cast<std::size_t>(f)]; };
  for (const grids::FieldSet& level : orbit.levels) {
    for (int f = 0; f < fields; ++f) {
      double& size = largest[static_cast<std::size_t>(f)];
      size = std::max(size, grids::max_abs(level.field(f)));
    }
  }
  const std::vector<double> scales = closing_scales(std::move(largest));
  HalvedMeasure error{.relative = factor * std::abs(halved.orbit.period / orbit.period - 1.0),
                      .t = start + orbit.period};
  for (std::size_t k = 0; k < orbit.steps(); ++k) {
    for (int f = 0; f < fields; ++f) {
      const std::span<const double> was = orbit.levels[k].field(f), is = halved.orbit.levels[2 * k].field(f);
      for (std::size_t i = 0; i < was.size() && moves(f); ++i) {
        const double here = factor * std::abs(was[i] - is[i]) / scales[static_cast<std::size_t>(f)];
        if (here > error.relative) {
          error = {.relative = here, .t = start + orbit.step() * static_cast<double>(k)};
        }
      }
    }
  }
  return error;
}

double largest_of(const PeriodOfLattice& orbit) {
  double largest = 0.0;
  for (const grids::FieldSet& level : orbit.levels) {
    largest = std::max(largest, grids::max_abs(level.all()));
  }
  return largest;
}

}  // namespace

std::vector<double> closing_scales(std::vector<double> largest) {
  const double whole = *std::ranges::max_element(largest);
  for (double& scale : largest) {
    scale += whole > 0.0 ? 1e-3 * whole : 1.0;
  }
  return largest;
}

void solve_lattice(const Problem& problem, const RunOptions& options, const std::string& file, SolveOutcome& outcome) {
  constexpr double least_part_of_guess = 1e-9;
  constexpr double tolerance_of_estimate = 1e-9;
  constexpr const char* remedy = "begin nearer to the orbit ([initial]), or with another number of steps";
  const StatedSolve& stated = *problem.solve;
  const MultisymplecticSystem system = make_system(problem);
  LatticeIntegrator lattice =
      make_lattice(over_period(problem, stated.duration.value_or(problem.scheme.until - problem.start())));
  const PeriodOfLattice guess = period_by_integrating(lattice, stated.steps);
  if (guess.steps() != stated.steps) {
    outcome.message = fmt::format("the guess: the run from [initial] ended after {} of {} steps; {}", guess.steps(),
                                  stated.steps, remedy);
    return;
  }
  PeriodicLatticeOptions newton{.period = stated.duration,
                                .energy = stated.energy,
                                .tolerance = stated.tolerance,
                                .most_iterations = stated.most_iterations};
  PeriodicLatticeSolution found =
      solve_periodic_lattice(system, make_grid(problem), step_of(problem, system), guess, newton);
  BoundaryValueSolution& solution = outcome.solution;
  solution.status = found.search.status;
  solution.residual = found.search.residual;
  solution.worst = found.search.worst;
  solution.history = std::move(found.history);
  solution.mean_energy = solution.conserved = found.mean_energy;
  solution.orbit.h.assign(stated.steps, found.orbit.step());
  if (!found.found()) {
    const bool is_pinned = solution.residual < std::sqrt(stated.tolerance);
    outcome.message =
        fmt::format("{}; {}", found.search.message(solution.history.size()),
                    is_pinned ? "the grid pins the orbit, which Newton's method has to move along itself: take more "
                                "steps or cells, or a larger tolerance"
                              : remedy);
    return;
  }
  if (largest_of(found.orbit) < least_part_of_guess * largest_of(guess)) {
    solution.status = Status::not_converged;
    outcome.message = fmt::format("Newton's method went to the state of rest, where all fields are 0; {}", remedy);
    return;
  }
  const SolvedLattice solved(problem, found.orbit);
  outcome.closing = distance_after_period(solved.problem());
  if (!(*outcome.closing <= closing_tolerance)) {
    solution.status = Status::not_converged;
    outcome.message = fmt::format(
        "a periodic orbit was found, but a run over its period ends {:.3g} beside its start, more than {}: it is so "
        "unstable that rounding errors leave it; take a shorter period, or fewer steps",
        *outcome.closing, closing_tolerance);
    return;
  }
  newton.tolerance = std::max(newton.tolerance, tolerance_of_estimate);
  const HalvedMeasure error =
      error_by_halved_steps(system, found.orbit,
                            solve_periodic_lattice(system, make_grid(problem), step_of(problem, system),
                                                   halved_steps(system, found.orbit), newton),
                            lattice.order(), problem.start());
  RunOptions to_file = options;
  to_file.output = file;
  const Outcome run = run_with_scales(solved.problem(), to_file, history_scales(solution.history), error);
  outcome.status = run.status;
  outcome.message = run.message;
  outcome.statistics = run.statistics;
  outcome.judgement = run.judgement;
  outcome.warnings = run.warnings;
  outcome.file = run.file;
}

}  // namespace rubato
