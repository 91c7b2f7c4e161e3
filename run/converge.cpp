#include <rubato/run/converge.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <span>
#include <utility>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/figures/text.hpp>
#include <rubato/grids/resample.hpp>
#include <rubato/problem/effective.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/ensemble_ranks.hpp>

namespace rubato {

namespace {

/// Differences below so many roundings of the quantity's size say nothing of an order.
constexpr double rounding_floor = 100.0 * std::numeric_limits<double>::epsilon();

/// A folder for the records of the runs, removed with them.
class Workshop {
public:
  Workshop() {
    std::string name = (std::filesystem::temp_directory_path() / "rubato-converge-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) {
      throw FileError(
          fmt::format("{}: no folder for the runs can be made there", std::filesystem::temp_directory_path().string()));
    }
    path_ = name;
  }
  Workshop(const Workshop&) = delete;
  Workshop& operator=(const Workshop&) = delete;
  ~Workshop() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] std::string operator/(const std::string& name) const { return (path_ / name).string(); }

private:
  std::filesystem::path path_;
};

using State = std::vector<std::vector<double>>;  ///< the values of each quantity

/// The problem with another step, or other numbers of cells, and the state at `until` as its only output.
Problem refined(const Problem& problem, double until, int step_halvings, int grid_halvings) {
  std::vector<std::string> settings = {fmt::format("scheme.step={}", *problem.scheme.step / std::exp2(step_halvings)),
                                       fmt::format("scheme.until={}", until), "output.states=true",
                                       "output.every=1000000000"};
  if (const MultisymplecticProblem* pde = problem.multisymplectic()) {
    if (pde->next) {
      const double step = *problem.scheme.step / std::exp2(step_halvings);
      settings.push_back(fmt::format("initial.next.t={}", problem.start() + step));
    }
    for (const GridAxis& axis : pde->axes) {
      const std::int64_t cells = axis.cells * (std::int64_t{1} << grid_halvings);
      // An odd number of elements stays one; between walls any number will do.
      const bool odd = axis.cells % 2 != 0 && grid_halvings > 0 && !axis.has_walls();
      settings.push_back(fmt::format("grid.{}.cells={}", axis.name, cells + (odd ? problem.scheme.space_stages : 0)));
    }
    settings.emplace_back("laws.every=false");
  }
  // Events would end runs before the time at which these are compared.
  std::string text = problem.text;
  for (const char* const entry : {"events", "section", "output.interval", "output.times"}) {
    text = without(text, problem.source, entry);
  }
  Problem result = parse_problem(text, problem.source, settings);
  result.output.times = {until};
  result.output.in_fictitious_time = true;  // with time_scale every run comes to `until`, at a time of its own
  return result;
}

class RefinedRuns {
public:
  RefinedRuns(const Problem& problem, const RunOptions& options, double until)
      : problem_(problem), options_(options), until_(until) {
    if (const HamiltonianProblem* orbit = problem.hamiltonian()) {
      names_ = orbit->names();
      coordinates_ = orbit->q.size();
    } else {
      const MultisymplecticSystem system = make_system(problem);
      for (const std::string& field : problem.multisymplectic()->fields) {
        if (!system.structure().at_midpoints(system.field(field))) {
          names_.push_back(field);
        }
      }
      grid_.emplace(make_grid(problem));
    }
    states_ = names_.size();
    for (const OutputQuantity& quantity : problem.output.quantities) {
      const bool taken = std::ranges::find(names_, quantity.name) != names_.end();
      names_.push_back(taken ? fmt::format("output.quantities.{}", quantity.name) : quantity.name);
    }
  }

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  /// One past the last of each kind: coordinates and momenta, or fields.
  [[nodiscard]] std::vector<std::size_t> kinds() const {
    return coordinates_ == 0 ? std::vector{states_} : std::vector{coordinates_, states_};
  }
  /// Whether both are coordinates, momenta or fields.
  [[nodiscard]] bool of_one_kind(std::size_t i, std::size_t j) const {
    return i == j || (std::max(i, j) < states_ && (i < coordinates_) == (j < coordinates_));
  }

  /// The state at `until`, on the problem's own grid; nothing, and why, where the run did not get there.
  std::optional<State> at_end(int step_halvings, int grid_halvings, ConvergenceOutcome& outcome) {
    Problem problem = refined(problem_, until_, step_halvings, grid_halvings);
    if (potential_) {
      problem.scheme.potential = scaled(*potential_, std::exp2(-step_halvings));
    }
    RunOptions options = options_;
    options.output = folder_ / "run.h5";
    options.overwrite = true;
    const Outcome run = rubato::run(problem, options);
    const std::string which =
        fmt::format("{} of the step{}", fraction(step_halvings),
                    grid_halvings > 0 ? fmt::format(" and {} of the spacings", fraction(grid_halvings)) : "");
    if (step_halvings == 0 && grid_halvings == 0) {
      outcome.steps = run.statistics.steps;
    }
    if (step_halvings == 0 && grid_halvings == 0) {
      for (const auto& error : run.statistics.errors) {
        exact_.emplace_back(error.name, error.value.largest());
      }
    }
    outcome.findings.add(0, which, run.warnings, run.judgement,
                         run.complete             ? RunEnd::complete
                         : has_failed(run.status) ? RunEnd::failed
                                                  : RunEnd::interrupted);
    if (!run.complete) {
      outcome.status = run.status;
      // Its record goes with the folder, which the run's own message could not know.
      outcome.message = run.status == ExitStatus::interrupted ? fmt::format("interrupted in the run with {}", which)
                                                              : fmt::format("with {}: {}", which, run.message);
      return std::nullopt;
    }
    if (!potential_ && problem.scheme.potential.kind == StepPotentialChoice::Kind::automatic) {
      potential_ = {run.step_potential, run.order};
    }
    const record::Reader reader(*options.output);
    State state;
    if (!grid_) {
      for (const char* const path : {"/output/q", "/output/p"}) {
        for (const double value : reader.read(path, 0, 1)) {
          state.push_back({value});
        }
      }
    }
    const auto read = [&](std::size_t i) {
      return reader.read(i < states_
                             ? fmt::format("/output/{}", names_[i])
                             : fmt::format("/output/quantities/{}", problem_.output.quantities[i - states_].name),
                         0, 1);
    };
    if (grid_) {  // the fields, of which some may turn together from one period to the next
      const std::vector<std::string>& all = problem.multisymplectic()->fields;
      const grids::Grid grid = make_grid(problem);
      std::vector<int> fields;
      std::vector<FieldOnGrid> given;
      for (std::size_t i = 0; i < states_; ++i) {
        fields.push_back(static_cast<int>(std::ranges::find(all, names_[i]) - all.begin()));
        given.push_back({read(i), grid});
      }
      state = make_jumps(problem).resampled(fields, given, *grid_);
    }
    if (const auto undefined = std::ranges::find_if_not(state, all_finite); undefined != state.end()) {
      outcome.status = ExitStatus::failed;
      outcome.message = fmt::format("with {}: {} is not defined at the end, to which the last step could not be solved",
                                    which, names_[static_cast<std::size_t>(undefined - state.begin())]);
      return std::nullopt;
    }
    for (std::size_t i = state.size(); i < names_.size(); ++i) {
      const std::vector<double> values = read(i);
      state.push_back(values.size() == 1 ? values : grids::resampled(values, make_grid(problem), *grid_));
    }
    return state;
  }

  /// The largest difference of the run as it stands from [exact].
  [[nodiscard]] std::optional<double> exact(const std::string& name) const {
    const auto found = std::ranges::find(exact_, name, &std::pair<std::string, double>::first);
    return found == exact_.end() || !std::isfinite(found->second) ? std::nullopt : std::optional(found->second);
  }

private:
  /// What a look-ahead of each run would choose differs from run to run. f' of h·ratio is ratio^s f'(h), as errors are,
  /// so that with the step the same levels are refined.
  struct ChosenPotential {
    StepPotential of_whole;
    int order;
  };
  static StepPotentialChoice scaled(const ChosenPotential& chosen, double ratio) {
    StepPotential potential = chosen.of_whole;
    potential.strength *= std::pow(ratio, chosen.order);
    potential.length *= ratio;
    return {.kind = StepPotentialChoice::Kind::stated, .potential = potential};
  }

  static std::string fraction(int halvings) { return halvings == 0 ? "the whole" : fmt::format("1/{}", 1 << halvings); }

  const Problem& problem_;
  const RunOptions& options_;
  Workshop folder_;
  std::vector<std::string> names_;  ///< of what is compared: the state, then the quantities of [output.quantities]
  double until_;
  std::size_t states_ = 0, coordinates_ = 0;
  std::optional<grids::Grid> grid_;
  std::optional<ChosenPotential> potential_;
  std::vector<std::pair<std::string, double>> exact_;
};

double size_of(const std::vector<double>& values) {
  double largest = 0.0;
  for (const double value : values) {
    largest = std::max(largest, std::abs(value));
  }
  return largest;
}

double difference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]));
  }
  return largest;
}

/// Differences that are rounding are none; of values that are not defined nothing is known.
Refinement compare(const std::vector<double>& whole, const std::vector<double>& half,
                   const std::vector<double>& quarter, double size) {
  for (const std::vector<double>* values : {&whole, &half, &quarter}) {
    if (!all_finite(*values)) {
      constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
      return {.coarse = unknown, .fine = unknown};
    }
  }
  const auto above_rounding = [size](double value) { return value > rounding_floor * size ? value : 0.0; };
  return {.coarse = above_rounding(difference(whole, half)), .fine = above_rounding(difference(half, quarter))};
}

figures::JsonObject json(const Refinement& refinement) {
  figures::JsonObject object;
  object.number("error", refinement.error());
  if (const auto order = refinement.order()) {
    object.number("order", *order);
  }
  return object;
}

std::string text(const Refinement& refinement) {
  const auto order = refinement.order();
  return refinement.coarse == 0.0 ? "rounding"
         : std::isnan(refinement.coarse)
             ? "not defined"
             : fmt::format("{:.2g}, {}", refinement.error(), order ? fmt::format("order {:.2f}", *order) : "no order");
}

}  // namespace

std::optional<double> Refinement::order() const {
  return coarse > 0.0 && fine > 0.0 && coarse > fine ? std::optional(std::log2(coarse / fine)) : std::nullopt;
}

double Refinement::error() const {
  const auto p = order();
  const double power = p ? std::exp2(*p) : 0.0;
  return p ? coarse * power / (power - 1.0) : std::max(coarse, fine);
}

bool Convergence::explains_exact() const {
  // Estimates by Richardson are off by a part of themselves. Solutions on a line differ from those of a period by what
  // their tails leave at its ends.
  constexpr double most = 3.0, least = 1e-5;
  const double explained = step.error() + (grid ? grid->error() : 0.0);
  return !exact || std::isnan(explained) || *exact <= most * explained + least * size;
}

void require_refinable(const Problem& problem, const RunOptions& options, std::string_view command) {
  if (problem.ensemble) {
    throw ProblemError(problem.ensemble->location,
                       fmt::format("{} compares runs of one problem; leave [ensemble] out", command));
  }
  refuse_ranks(options, problem.scheme.step_location);
  if (!problem.scheme.step) {
    throw ProblemError(problem.scheme.step_location,
                       fmt::format("{} changes the step: give it as a number, not \"auto\"", command));
  }
}

namespace {

/// [initial.next] is moved to the end of the step that is taken: its fields have to be formulas of t.
void refuse_fixed_next(const Problem& problem) {
  const HamiltonianProblem* const orbit = problem.hamiltonian();
  if (orbit != nullptr && orbit->next) {
    throw ProblemError(orbit->next->location,
                       "converge takes parts of the step, and [initial.next] is the end of one step: leave it out");
  }
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  if (pde == nullptr || !pde->next) {
    return;
  }
  std::vector<std::string> names = pde->fields;
  const std::vector<std::string> axes = pde->axis_names();
  names.insert(names.end(), axes.begin(), axes.end());
  names.emplace_back("t");
  const auto is_of_time = [&](const std::optional<FormulaText>& text) {
    formula::Graph graph;
    std::vector<formula::Expression> parts;
    if (text) {
      parts.push_back(build_formula(
          *text, graph,
          {.names = names, .differentiable = pde->fields, .axes = axes, .periods = pde->axes, .differentiated = &parts},
          problem.parameters));
    }
    return std::ranges::any_of(parts, [&](const formula::Expression& part) {
      const auto variables = formula::variables_of(part);
      return std::ranges::any_of(variables, [&](std::size_t number) { return graph.variable_name(number) == "t"; });
    });
  };
  if (std::ranges::none_of(pde->next->fields, is_of_time)) {
    throw ProblemError(pde->next->location,
                       "converge takes parts of the step, and [initial.next] is the end of one step: write its fields "
                       "as formulas of t, or leave it out");
  }
}

/// The doubt about a step whose error is as large as the motion: at least half of the largest value in each kind of
/// quantities, as one of these may happen to vanish at the end.
std::optional<figures::Reason> lost_motion(const std::vector<Convergence>& quantities,
                                           const std::vector<std::size_t>& kinds) {
  constexpr double least = 0.5;
  const auto share = [](const Convergence& quantity) { return quantity.step.error() / quantity.scale; };
  std::optional<Convergence> worst;
  std::size_t i = 0;
  for (const std::size_t end : kinds) {
    const auto all = std::span(quantities).subspan(i, end - i);
    i = end;
    const auto of_kind = std::ranges::max_element(all, {}, share);
    if (of_kind == all.end() || !(share(*of_kind) > least)) {
      return std::nullopt;
    }
    if (!worst || share(*of_kind) > share(*worst)) {
      worst = *of_kind;
    }
  }
  if (!worst) {
    return std::nullopt;
  }
  return figures::Reason{
      .kind = figures::ReasonKind::resolution,
      .verdict = figures::Verdict::doubtful,
      .value = share(*worst),
      .finding = fmt::format("the error of {0} is {1:.2g}, and {0} and its like are up to {2:.2g}: this step does not "
                             "follow the motion to the end, and neither errors nor orders are estimates",
                             worst->name, worst->step.error(), worst->scale),
      .remedy = "take a smaller step, or an earlier until"};
}

}  // namespace

ConvergenceOutcome converge(const Problem& problem, std::optional<double> tolerance, const RunOptions& options,
                            const ConvergeScope& scope) {
  require_refinable(problem, options, "converge");
  refuse_fixed_next(problem);
  const auto begin = std::chrono::steady_clock::now();
  ConvergenceOutcome outcome{
      .title = problem.title,
      .until = scope.until.value_or(problem.scheme.until),
      .in_fictitious_time = problem.hamiltonian() != nullptr && problem.hamiltonian()->fictitious_time,
      .step = *problem.scheme.step,
      .tolerance = tolerance};
  RefinedRuns comparison(problem, options, outcome.until);
  std::vector<State> steps, grids;
  figures::Verdict of_whole_step = figures::Verdict::good;
  for (int halvings = 0; halvings < 3; ++halvings) {
    auto state = comparison.at_end(halvings, 0, outcome);
    if (!state) {
      return outcome;
    }
    steps.push_back(*std::move(state));
    of_whole_step = halvings == 0 ? outcome.findings.verdict() : of_whole_step;
  }
  if (problem.multisymplectic() != nullptr && scope.grids) {
    // An explicit scheme whose step is stable on the problem's grid may not be on a finer one: then a quarter of it is
    // taken on all grids, which leaves the ratio to the spacings at most what it was.
    const ConvergenceOutcome before = outcome;
    const auto refine_grids = [&](int step_halvings) {
      grids = {steps[static_cast<std::size_t>(step_halvings)]};
      for (int halvings = 1; halvings < 3; ++halvings) {
        auto state = comparison.at_end(step_halvings, halvings, outcome);
        if (!state) {
          return false;
        }
        grids.push_back(*std::move(state));
      }
      return true;
    };
    outcome.grid_step = outcome.step;
    const bool ended = refine_grids(0);
    const bool is_lost = outcome.status == ExitStatus::failed || outcome.findings.verdict() == figures::Verdict::lost;
    if (is_lost && before.findings.verdict() != figures::Verdict::lost) {
      outcome = before;
      outcome.grid_step = 0.25 * outcome.step;
      if (!refine_grids(2)) {
        return outcome;
      }
    } else if (!ended) {
      return outcome;
    }
  }
  outcome.ended = true;
  if (outcome.findings.all_lost()) {
    outcome.status = ExitStatus::lost;
    outcome.message = fmt::format("every run is lost: {}", outcome.findings.verdict_text("runs"));
  }
  double factor = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < comparison.names().size(); ++i) {
    Convergence& quantity = outcome.quantities.emplace_back();
    quantity.name = comparison.names()[i];
    quantity.size = size_of(steps.back()[i]);
    quantity.step = compare(steps[0][i], steps[1][i], steps[2][i], quantity.size);
    if (!grids.empty()) {
      quantity.grid = compare(grids[0][i], grids[1][i], grids[2][i], quantity.size);
    }
    // Without runs on finer grids what the grid leaves is not known.
    quantity.exact =
        grids.empty() && problem.multisymplectic() != nullptr ? std::nullopt : comparison.exact(quantity.name);
    if (!quantity.explains_exact()) {
      outcome.findings.add_warning(
          "the whole of the step",
          fmt::format("[exact] does not solve the problem: {} differs from it by {:.2g}, and errors of {} are {:.2g}; "
                      "correct the formula of [exact]",
                      quantity.name, *quantity.exact, quantity.grid ? "step and grid" : "the step",
                      quantity.step.error() + (quantity.grid ? quantity.grid->error() : 0.0)));
    }
    if (tolerance && quantity.step.coarse > 0.0) {
      const auto order = quantity.step.order();
      factor =
          !order ? 0.0 : std::min(factor, std::pow(*tolerance * quantity.size / quantity.step.error(), 1.0 / *order));
    }
  }
  for (std::size_t i = 0; i < outcome.quantities.size(); ++i) {
    for (std::size_t j = 0; j < outcome.quantities.size(); ++j) {
      if (comparison.of_one_kind(i, j)) {
        outcome.quantities[i].scale = std::max(outcome.quantities[i].scale, outcome.quantities[j].size);
      }
    }
  }
  if (const auto reason = lost_motion(outcome.quantities, comparison.kinds())) {
    outcome.findings.doubt("the whole of the step", *reason, of_whole_step);
  }
  if (tolerance && factor > 0.0 && std::isfinite(factor)) {
    outcome.step_for_tolerance = outcome.step * factor;
  }
  outcome.wall_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return outcome;
}

std::string to_json(const ConvergenceOutcome& outcome) {
  figures::JsonObject object, quantities;
  object.count("status", static_cast<std::size_t>(outcome.status))
      .number("until", outcome.until)
      .number("step", outcome.step);
  if (outcome.grid_step) {
    object.number("grid_step", *outcome.grid_step);
  }
  for (const Convergence& quantity : outcome.quantities) {
    figures::JsonObject one;
    one.number("size", quantity.size).object("step", json(quantity.step));
    if (quantity.grid) {
      one.object("grid", json(*quantity.grid));
      one.text("dominant", quantity.grid->error() > quantity.step.error() ? "grid" : "step");
    }
    if (quantity.exact) {
      one.number("exact", *quantity.exact);
    }
    quantities.object(quantity.name, one);
  }
  object.object("quantities", quantities);
  if (outcome.tolerance) {
    object.number("tolerance", *outcome.tolerance);
  }
  if (outcome.step_for_tolerance) {
    object.number("step_for_tolerance", *outcome.step_for_tolerance);
  }
  outcome.findings.add_to(object, "runs");
  if (!outcome.message.empty()) {
    object.text("message", outcome.message);
  }
  return object.number("wall_seconds", outcome.wall_seconds).str();
}

std::string to_table(const ConvergenceOutcome& outcome) {
  std::string table =
      fmt::format("{}\n  errors at {} {:.10g} with step = {:.10g}, by runs with halves and quarters\n", outcome.title,
                  outcome.in_fictitious_time ? "fictitious time" : "t =", outcome.until, outcome.step);
  for (const Convergence& quantity : outcome.quantities) {
    table += fmt::format("  {:<16} of {:<10.4g} step: {:<26}", quantity.name, quantity.size, text(quantity.step));
    if (quantity.grid) {
      table += fmt::format(" grid: {:<26}", text(*quantity.grid));
    }
    if (quantity.exact) {
      table += fmt::format(" from [exact]: {:.2g}", *quantity.exact);
    }
    table.erase(table.find_last_not_of(' ') + 1);
    table += "\n";
  }
  if (outcome.grid_step && *outcome.grid_step != outcome.step) {
    table += "  the grid's errors are by runs with a quarter of the step: on finer grids the whole is too long\n";
  }
  if (outcome.tolerance) {
    table += outcome.step_for_tolerance
                 ? fmt::format("  step = {:.3g} would reach {:.3g} of each, if the order held{}\n",
                               *outcome.step_for_tolerance, *outcome.tolerance,
                               outcome.grid_step ? ", beside the errors of the grid" : "")
                 : fmt::format("  which step would reach {:.3g} cannot be said: no order is seen, or all is rounding\n",
                               *outcome.tolerance);
  }
  return table + fmt::format("  verdict: {}\n", outcome.findings.verdict_text("runs"));
}

}  // namespace rubato
