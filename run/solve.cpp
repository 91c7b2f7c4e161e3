#include <rubato/run/solve.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>

#include <fmt/format.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/ode/continuation.hpp>
#include <rubato/ode/second_variation.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/solve.hpp>
#include <rubato/record/writer.hpp>
#include <rubato/run/lattice_solve.hpp>
#include <rubato/run/record_scales.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/solution_measures.hpp>
#include <rubato/run/solution_rows.hpp>
#include <rubato/run/threads.hpp>
#include <rubato/run/version.hpp>

namespace rubato {

namespace {

using Ends = StatedSolve::Ends;

constexpr const char* guess_remedy =
    "begin nearer to the orbit ([initial], or [solve] guess), or with another number of steps";

/// The nodes that Newton's method begins from, over half of the period for a symmetric orbit.
NodesOfOrbit make_guess(const Problem& problem, const StatedSolve::Start& start, const Hamiltonian& hamiltonian,
                        const SegmentLagrangian& lagrangian) {
  const StatedSolve& stated = *problem.solve;
  const bool half = stated.ends == Ends::symmetric;
  const std::size_t steps = half ? stated.steps / 2 : stated.steps;
  const double duration = stated.duration.value_or(problem.scheme.until - problem.start()) * (half ? 0.5 : 1.0);
  const double h = duration / static_cast<double>(steps);
  if (start.formulas.empty()) {
    return guess_by_integrating(hamiltonian, lagrangian, start.z, h, steps);
  }
  std::vector<NamedFormula> formulas;
  for (const FormulaText& formula : start.formulas) {
    formulas.push_back({{}, formula});
  }
  FormulaTable table(problem, formulas, {"t"});
  NodesOfOrbit guess{.dimension = formulas.size(), .z = {}, .h = std::vector<double>(steps, h)};
  for (std::size_t k = 0; k <= steps; ++k) {
    const double t = h * static_cast<double>(k);
    const std::span<const double> z = table({&t, 1});
    guess.z.insert(guess.z.end(), z.begin(), z.end());
  }
  return guess;
}

/// The whole of a symmetric orbit from its first half, z(T - t) = Rz(t).
NodesOfOrbit unfolded(const NodesOfOrbit& half, const std::vector<std::size_t>& mirror) {
  NodesOfOrbit whole = half;
  for (std::size_t k = half.segments(); k-- > 0;) {
    std::vector<double> z(half.node(k).begin(), half.node(k).end());
    for (const std::size_t place : mirror) {
      z[place] = -z[place];
    }
    whole.z.insert(whole.z.end(), z.begin(), z.end());
    whole.h.push_back(half.h[k]);
  }
  return whole;
}

/// True if the guess moves and the orbit rests: the range of every coordinate and momentum is next to nothing beside
/// that of the guess.
bool came_to_rest(const NodesOfOrbit& orbit, const NodesOfOrbit& guess) {
  constexpr double at_rest = 1e-6;
  const auto range = [](const NodesOfOrbit& of, std::size_t i) {
    double least = of.node(0)[i], most = least;
    for (std::size_t k = 1; k <= of.segments(); ++k) {
      least = std::min(least, of.node(k)[i]);
      most = std::max(most, of.node(k)[i]);
    }
    return most - least;
  };
  bool moved = false;
  for (std::size_t i = 0; i < orbit.dimension; ++i) {
    moved = moved || range(guess, i) > 0.0;
    if (range(orbit, i) > at_rest * range(guess, i)) {
      return false;
    }
  }
  return moved;
}

record::Layout layout_of(const Problem& problem, const SolveOutcome& outcome, const SolutionRows& rows) {
  const HamiltonianProblem& system = *problem.hamiltonian();
  record::Layout layout{.title = problem.title,
                        .problem = problem.text,
                        .version = std::string(version()),
                        .compiler = std::string(compiler()),
                        .threads = 1,
                        .compression = problem.output.compression};
  layout.scales.push_back({"/states/coordinate", system.q, "names of the coordinates"});
  layout.scales.push_back({"/states/momentum", system.p, "names of the momenta"});
  if (system.L) {
    layout.scales.push_back({"/states/velocity", system.q_dot, "names of the velocities"});
  }
  for (record::Scale& scale : history_scales(outcome.solution.history)) {
    layout.scales.push_back(std::move(scale));
  }
  const auto numbers = [&](std::string path, std::vector<double> values, std::string description) {
    if (!values.empty()) {
      layout.scales.push_back({std::move(path), std::move(values), std::move(description)});
    }
  };
  const StepPotential& f = outcome.solution.potential;
  numbers(solution_potential, {f.strength, f.length, f.exponent}, "strength, length and exponent of f'");
  std::vector<double> real, imaginary;
  for (const std::complex<double>& multiplier : outcome.multipliers) {
    real.push_back(multiplier.real());
    imaginary.push_back(multiplier.imag());
  }
  numbers("/solve/multiplier_real", real, "real parts of the Floquet multipliers");
  numbers("/solve/multiplier_imaginary", imaginary, "imaginary parts of the Floquet multipliers");
  std::vector<double> parameters, durations, energies, folds;
  for (const BranchRow& row : outcome.branch) {
    parameters.push_back(row.parameter);
    durations.push_back(row.duration);
    energies.push_back(row.energy);
    folds.push_back(row.is_fold ? 1.0 : 0.0);
  }
  numbers("/solve/branch_parameter", parameters, outcome.parameter + " along the branch");
  numbers("/solve/branch_duration", durations, "period or time along the branch");
  numbers("/solve/branch_energy", energies, "mean of K along the branch");
  numbers("/solve/branch_fold", folds, "1 where the parameter turns round");
  if (outcome.starts > 1) {
    numbers("/solve/start", {static_cast<double>(outcome.start)},
            "number of the guess that led to the solution, from 1");
  }
  numbers("/solve/conjugate_point", outcome.conjugate_points, "times of the points conjugate to the start");
  if (!outcome.dependent.empty()) {
    layout.scales.push_back({"/solve/dependent_condition", outcome.dependent, "conditions that say the same in part"});
  }
  if (outcome.index) {
    numbers("/solve/morse_index", {static_cast<double>(*outcome.index)}, "negative directions of the second variation");
  }

  using record::Type;
  constexpr auto levels = "/levels/t", steps = "/levels/step", states = "/states/t";
  const auto add = [&](const char* axis, std::string path, Type type, std::string description,
                       bool may_be_undefined = false) {
    layout.add({std::move(path), axis, {}, type, std::move(description), may_be_undefined, rows.t.size()});
  };
  add(levels, "/levels/t", Type::f64, "time of every level");
  add(levels, "/levels/gamma", Type::f64, "Gamma(z_k) (theory, section 3), where it is that of the scheme", true);
  add(levels, "/levels/node_energy", Type::f64, "node energy H(z_k)", true);
  add(steps, "/levels/step", Type::i64, "number of the step from level k to k+1");
  add(steps, "/levels/h", Type::f64, "length t_{k+1} - t_k of the step");
  add(steps, "/levels/energy", Type::f64, "discrete energy E_k (3.4)");
  add(steps, "/levels/target", Type::f64, "value E that the law requires of E_k; with equal levels their mean");
  add(steps, "/levels/rounding", Type::f64, "bound on the rounding error of E_k");
  add(steps, "/levels/iterations", Type::i32, "0: all steps are solved for at once");
  add(steps, "/levels/off_law", Type::u8, "0: there are no plain steps");
  add(steps, "/levels/step_condition", Type::f64, "relative error of h; undefined with equal levels", true);
  if (f.active()) {
    add(steps, "/levels/step_potential", Type::f64, "f'(h), a part of E_k");
  }
  for (const std::string& name : rows.invariant_names) {
    add(levels, "/laws/" + name, Type::f64, "invariant " + name + " at every level", true);
  }
  add(states, "/states/t", Type::f64, "time of the stored levels");
  add(states, "/states/level", Type::i64, "number of the stored level");
  layout.add({"/states/q", states, {"/states/coordinate"}, Type::f64, "coordinates"});
  layout.add({"/states/p", states, {"/states/momentum"}, Type::f64, "momenta"});
  if (system.L) {
    layout.add({"/states/q_dot", states, {"/states/velocity"}, Type::f64, "velocities, of q and p"});
  }
  return layout;
}

void write_record(const Problem& problem, const RunOptions& options, const SolveOutcome& outcome,
                  const SolutionRows& rows) {
  const record::Layout layout = layout_of(problem, outcome, rows);
  auto writer = record::Writer::create(outcome.file, layout, options.overwrite, {.locking = locking_of(options)});
  const NodesOfOrbit& orbit = outcome.solution.orbit;
  const std::size_t n = orbit.dimension / 2;
  const auto integers = [](std::size_t count, const std::function<std::int64_t(std::size_t)>& value) {
    std::vector<std::int64_t> numbers(count);
    for (std::size_t i = 0; i < count; ++i) {
      numbers[i] = value(i);
    }
    return numbers;
  };
  std::size_t column = 0;
  const auto append = [&](const std::vector<double>& values) { writer.append(column++, values, values.size()); };
  const auto append_integers = [&](const std::vector<std::int64_t>& values) {
    writer.append(column++, values, values.size());
  };
  const std::size_t steps = orbit.segments();
  append(rows.t);
  append(rows.gamma);
  append(rows.node_energy);
  append_integers(integers(steps, [](std::size_t k) { return static_cast<std::int64_t>(k); }));
  append(rows.h);
  append(rows.energy);
  append(std::vector<double>(steps, outcome.solution.conserved));
  append(std::vector<double>(steps, rows.rounding));
  append_integers(integers(steps, [](std::size_t) { return 0; }));
  append_integers(integers(steps, [](std::size_t) { return 0; }));
  append(rows.condition);
  if (outcome.solution.potential.active()) {
    append(rows.potential);
  }
  for (const std::vector<double>& values : rows.invariants) {
    append(values);
  }
  append(rows.t);
  append_integers(integers(steps + 1, [](std::size_t k) { return static_cast<std::int64_t>(k); }));
  for (const bool momenta : {false, true}) {
    for (std::size_t k = 0; k <= steps; ++k) {
      writer.append(column, orbit.node(k).subspan(momenta ? n : 0, n));
    }
    ++column;
  }
  for (std::size_t k = 0; k < rows.t.size() && !rows.q_dot.empty(); ++k) {
    writer.append(column, std::span(rows.q_dot).subspan(k * n, n));
  }
  writer.end_level();
  record::Checkpoint checkpoint;
  checkpoint.emplace(figures::statistics_name, outcome.statistics.values());
  checkpoint.emplace(figures::statistics_names_name, outcome.statistics.names_text());
  checkpoint.emplace(figures::measures_name, figures::to_values(outcome.statistics.measures));
  if (const StepPotential& f = outcome.solution.potential; f.active()) {
    checkpoint.emplace("step_potential", std::vector<double>{f.strength, f.length, f.exponent});
  }
  writer.finish(checkpoint, record::Writer::Completion::complete);
}

/// What the second variation reports on the solution.
void add_second_variation(const Problem& problem, const Hamiltonian& hamiltonian, SolveOutcome& outcome) {
  const auto segments = make_segment_equation(hamiltonian, make_discretisation(problem));
  if (segments->is_action()) {
    return;
  }
  try {
    const SecondVariation variation(*segments, outcome.solution.orbit);
    const std::size_t implied = 2 * hamiltonian.constraints().count();
    if (outcome.closes) {
      outcome.multipliers = variation.multipliers();
      // The last ones are 0: those of variations that leave the constraints.
      outcome.multipliers.resize(outcome.multipliers.size() - implied);
    }
    if (implied > 0) {
      return;
    }
    outcome.index = outcome.closes ? variation.index_of_periodic() : variation.index_of_fixed_ends();
    for (const double t : variation.conjugate_points()) {
      outcome.conjugate_points.push_back(problem.start() + t);
    }
  } catch (const std::invalid_argument& error) {
    outcome.warnings.push_back(fmt::format("there is no second variation: {}", error.what()));
  }
}

/// The search for the solution of a problem: from the guess, along a branch where one is asked for, and from half of a
/// symmetric orbit to the whole.
class Search {
public:
  Search(const Problem& problem, SolveOutcome& outcome)
      : problem_(problem),
        stated_(*problem.solve),
        outcome_(outcome),
        half_(stated_.ends == Ends::symmetric),
        hamiltonian_(make_hamiltonian(problem)),
        ends_(make_end_conditions(problem, hamiltonian_)),
        settings_(make_boundary_value_options(problem)) {
    if (half_ && settings_.duration) {
      settings_.duration = 0.5 * *settings_.duration;
    }
  }

  /// Fills in the solution and the branch. \return the problem that it solves; nothing, with the message, for none
  std::optional<Problem> run() {
    outcome_.starts = stated_.starts.size();
    while (outcome_.start < outcome_.starts && !solve_from(stated_.starts[outcome_.start++])) {
    }
    if (!outcome_.solution.found()) {
      return std::nullopt;
    }
    std::optional<Problem> solved = problem_;
    if (stated_.continuation && !(solved = follow(*stated_.continuation))) {
      return std::nullopt;
    }
    return half_ ? unfold(std::move(*solved)) : solved;
  }

  /// True if the guess moves and the solution rests.
  [[nodiscard]] bool rests() const { return rests_; }

private:
  using Kind = StatedSolve::Continuation::Kind;

  /// \return false, with the message, for no solution
  bool solve_from(const StatedSolve::Start& start) {
    const NodesOfOrbit guess = make_guess(problem_, start, hamiltonian_, settings_.lagrangian);
    const std::size_t wanted = half_ ? stated_.steps / 2 : stated_.steps;
    if (guess.segments() != wanted) {
      outcome_.message = fmt::format("the guess: the integration from [initial] ended after {} of {} steps; {}",
                                     guess.segments(), wanted, guess_remedy);
      return false;
    }
    outcome_.solution = solve_boundary_value(hamiltonian_, ends_, guess, settings_);
    rests_ = false;
    outcome_.message =
        outcome_.solution.found()
            ? ""
            : fmt::format(
                  "{}; {}{}", outcome_.solution.message, guess_remedy,
                  half_ ? "; the time from start to until is a guess of the whole period, not of its half" : "");
    if (outcome_.solution.found() && came_to_rest(outcome_.solution.orbit, guess)) {
      rests_ = true;
      if (half_) {
        outcome_.solution.status = Status::not_converged;  // no half of an orbit
        outcome_.message =
            "the solution is an equilibrium, where nothing moves: the guess led there. Begin with a larger motion, or "
            "take a longer period or another energy";
        return false;
      }
    }
    return outcome_.solution.found();
  }

  std::optional<Problem> follow(const StatedSolve::Continuation& stated) {
    ContinuationOptions options{
        .newton = settings_, .to = stated.to, .most_points = stated.most_points, .step = stated.step};
    Branch branch;
    if (stated.kind == Kind::parameter) {
      branch = follow_parameter(stated, options);
    } else {
      const bool is_energy = stated.kind == Kind::energy;
      options.parameter.target =
          is_energy ? StationaryAction::Parameter::energy : StationaryAction::Parameter::duration;
      if (half_ && !is_energy) {
        options.to *= 0.5;
        options.step = options.step ? std::optional(0.5 * *options.step) : std::nullopt;
      }
      branch = follow_branch(hamiltonian_, ends_, outcome_.solution, options);
    }
    outcome_.parameter = stated.parameter;
    const double whole = half_ ? 2.0 : 1.0;
    for (const BranchPoint& point : branch.points) {
      outcome_.branch.push_back({.parameter = stated.kind == Kind::duration ? whole * point.parameter : point.parameter,
                                 .duration = whole * point.solution.orbit.duration(),
                                 .energy = point.solution.mean_energy,
                                 .is_fold = point.is_fold});
    }
    if (!branch.complete()) {
      outcome_.message =
          fmt::format("the branch ends before {} = {:.10g}: {}", stated.parameter, stated.to, branch.message);
      return std::nullopt;
    }
    outcome_.solution = std::move(branch.points.back().solution);
    return problem_at(stated);
  }

  /// H in which the parameter is a coordinate: its value at the start is what changes.
  Branch follow_parameter(const StatedSolve::Continuation& stated, ContinuationOptions options) {
    const Hamiltonian beside = make_hamiltonian_beside(problem_, stated.parameter);
    const std::size_t n = hamiltonian_.degrees_of_freedom();
    const double value = problem_.parameters.find(stated.parameter)->value;
    NodesOfOrbit nodes{.dimension = 2 * n + 2, .z = {}, .h = outcome_.solution.orbit.h};
    double momentum = 0.0;
    for (std::size_t k = 0; k <= nodes.segments(); ++k) {
      const std::span<const double> z = outcome_.solution.orbit.node(k);
      nodes.z.insert(nodes.z.end(), z.begin(), z.begin() + static_cast<std::ptrdiff_t>(n));
      nodes.z.push_back(value);
      nodes.z.insert(nodes.z.end(), z.begin() + static_cast<std::ptrdiff_t>(n), z.end());
      nodes.z.push_back(momentum);
    }
    // The momentum follows from the orbit: μ' = -∂H/∂λ, by the slopes at the nodes.
    HamiltonianEvaluator evaluator(beside);
    std::vector<double> gradient(nodes.dimension);
    double before = 0.0;
    for (std::size_t k = 0; k <= nodes.segments(); ++k) {
      evaluator.gradient(nodes.node(k).data(), gradient.data());
      momentum -= k == 0 ? 0.0 : 0.5 * nodes.h[k - 1] * (before + gradient[n]);
      before = gradient[n];
      nodes.z[k * nodes.dimension + 2 * n + 1] = momentum;
    }
    const BoundaryValueSolution start = solve_boundary_value(
        beside, make_end_conditions_beside(problem_, stated.parameter, beside, value), nodes, options.newton);
    if (!start.found()) {
      return {.message = start.message};
    }
    options.parameter.component = n;
    Branch branch =
        follow_branch(beside, make_end_conditions_beside(problem_, stated.parameter, beside), start, options);
    for (BranchPoint& point : branch.points) {
      NodesOfOrbit& orbit = point.solution.orbit;
      NodesOfOrbit without{.dimension = 2 * n, .z = {}, .h = orbit.h};
      for (std::size_t k = 0; k <= orbit.segments(); ++k) {
        for (std::size_t i = 0; i < orbit.dimension; ++i) {
          if (i != n && i != 2 * n + 1) {
            without.z.push_back(orbit.node(k)[i]);
          }
        }
      }
      orbit = std::move(without);
    }
    return branch;
  }

  /// The problem that the end of a branch is the solution of.
  [[nodiscard]] Problem problem_at(const StatedSolve::Continuation& stated) const {
    const std::string_view duration = stated_.closes() ? "period" : "time";
    std::vector<std::string> settings = {"-solve.continue"};
    switch (stated.kind) {
      case Kind::parameter:
        settings.push_back(fmt::format("parameters.{}={:.17g}", stated.parameter, stated.to));
        if (settings_.energy) {
          settings.push_back(fmt::format("solve.energy={:.17g}", *settings_.energy));
        }
        break;
      case Kind::energy:
        settings.push_back(fmt::format("solve.energy={:.17g}", stated.to));
        settings.push_back(fmt::format("solve.{}=free", duration));
        break;
      case Kind::duration:
        settings.push_back(fmt::format("solve.{}={:.17g}", duration, stated.to));
        settings.push_back("solve.energy=free");
        break;
    }
    return parse_problem(problem_.text, problem_.source, settings);
  }

  /// The whole of a symmetric orbit, which has to solve the equations of a periodic one.
  std::optional<Problem> unfold(Problem solved) {
    BoundaryValueOptions whole_settings = make_boundary_value_options(solved);
    const Hamiltonian hamiltonian = make_hamiltonian(solved);
    BoundaryValueSolution whole = boundary_value_residual(hamiltonian, EndConditions::periodic(hamiltonian),
                                                          unfolded(outcome_.solution.orbit, stated_.mirror),
                                                          outcome_.solution.potential, whole_settings);
    whole.history = outcome_.solution.history;
    if (!whole.found()) {
      outcome_.message = fmt::format(
          "the half of the orbit was found, but its mirror image does not go on from it (the residual is {:.3g}, the "
          "largest in {}): mirror does not reverse this motion, or the scheme is not symmetric",
          whole.residual, whole.worst);
      return std::nullopt;
    }
    outcome_.solution = std::move(whole);
    return solved;
  }

  const Problem& problem_;
  const StatedSolve& stated_;
  SolveOutcome& outcome_;
  bool half_, rests_ = false;
  Hamiltonian hamiltonian_;
  EndConditions ends_;
  BoundaryValueOptions settings_;
};

/// solve_problem() of an orbit, as solve_lattice().
void solve_orbit(const Problem& problem, const RunOptions& options, const std::string& file, SolveOutcome& outcome) {
  Search search(problem, outcome);
  const std::optional<Problem> solved = search.run();  // at the end of a branch another one
  if (!solved) {
    return;
  }
  outcome.file = file;
  const SolutionRows rows(*solved, outcome.solution);
  outcome.statistics = rows.statistics(outcome.solution);
  SolutionMeasures measured = measure_solution(*solved, outcome.solution.orbit, search.rests());
  outcome.statistics.measures = measured.measures;
  outcome.error = std::move(measured.error);
  outcome.dependent = std::move(measured.open.dependent);
  outcome.judgement = figures::judge(outcome.statistics);
  add_second_variation(*solved, make_hamiltonian(*solved), outcome);
  write_record(*solved, options, outcome, rows);
}

void refuse_existing(const std::string& file, bool overwrite) {
  std::error_code ignored;
  if (!overwrite && std::filesystem::exists(file, ignored)) {
    throw record::AlreadyExists(file, "already exists");
  }
}

}  // namespace

std::vector<record::Scale> history_scales(const std::vector<solve::NewtonIteration>& history) {
  std::vector<double> residuals, corrections, fractions, stages;
  for (const solve::NewtonIteration& iteration : history) {
    residuals.push_back(iteration.residual);
    corrections.push_back(iteration.correction);
    fractions.push_back(iteration.fraction);
    stages.push_back(iteration.stage);
  }
  return {{solution_history, residuals, "largest scaled residual after every iteration of Newton's method"},
          {"/solve/correction", corrections, "relative correction of every iteration; 0 at its start"},
          {"/solve/fraction", fractions, "damping factor of the correction"},
          {"/solve/stage", stages, "0: equal levels, 1: levels by the step law, 2: free levels"}};
}

SolveOutcome solve_problem(const Problem& problem, const RunOptions& options) {
  if (problem.solve == nullptr) {
    throw ProblemError({problem.source, 0, 0},
                       "there is no [solve]: it states the ends of the orbit, as [solve] ends = \"periodic\" (see "
                       "`rubato help solve`)");
  }
  if (problem.ensemble) {
    throw ProblemError(problem.ensemble->location,
                       "[ensemble] is for runs; leave it out, or solve its problems one by one");
  }
  const auto begun = std::chrono::steady_clock::now();
  const ThreadCount threads(options.threads, problem);
  SolveOutcome outcome;
  outcome.title = problem.title;
  outcome.closes = problem.solve->closes();
  const std::string file = options.output.value_or(problem.output.file);
  refuse_existing(file, options.overwrite);
  const Interruptible here(options.interrupt);
  try {
    if (problem.multisymplectic() != nullptr) {
      solve_lattice(problem, options, file, outcome);
    } else {
      solve_orbit(problem, options, file, outcome);
    }
  } catch (const StepPotentialError& error) {
    throw ProblemError(problem.scheme.potential_location, error.what());
  } catch (const ProblemError&) {
    throw;
  } catch (const std::invalid_argument& error) {
    throw ProblemError(problem.solve->location, error.what());
  } catch (const Interrupted&) {
    outcome.status = ExitStatus::interrupted;
    outcome.message = "interrupted; nothing was written";
    return outcome;
  }
  if (!outcome.found()) {
    outcome.status = ExitStatus::failed;
    outcome.message += "; nothing was written";
  } else if (outcome.judgement.verdict == figures::Verdict::lost) {
    outcome.status = ExitStatus::lost;
    outcome.message = fmt::format("a solution was found, but it is {}", figures::text_of(outcome.judgement));
  }
  outcome.wall_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  return outcome;
}

}  // namespace rubato
