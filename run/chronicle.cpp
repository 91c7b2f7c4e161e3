#include <rubato/run/chronicle.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <omp.h>

#include <rubato/run/version.hpp>

namespace rubato {

namespace {

std::string about_gamma(const Problem& problem, const Simulation& simulation) {
  if (!simulation.has_gamma()) {
    return "Gamma(z_k) is not defined for this scheme";
  }
  return problem.hamiltonian() != nullptr
             ? "Gamma(z_k) (theory, section 3)"
             : "Gamma(z_k) (theory, section 5), from velocities extrapolated over the last steps: an approximation";
}

/// About how many levels there will be: as many as equal steps make.
std::optional<std::size_t> expected_levels(const Problem& problem) {
  if (!problem.scheme.step) {
    return std::nullopt;
  }
  const double steps = std::ceil((problem.scheme.until - problem.start()) / *problem.scheme.step);
  return static_cast<std::size_t>(std::clamp(steps, 0.0, static_cast<double>(problem.scheme.max_steps))) + 1;
}

std::size_t expected_rows(const Problem& problem, std::string_view axis, std::size_t levels) {
  if (axis.starts_with("/levels/")) {
    return levels;
  }
  if (axis.starts_with("/events/")) {  // more of them are rare
    constexpr std::size_t levels_per_crossing = 16;
    return levels / levels_per_crossing;
  }
  const Output& output = problem.output;
  if (axis == "/output/t" && output.interval) {
    return static_cast<std::size_t>(
               std::min(std::abs(problem.scheme.until - problem.start()) / *output.interval, 1e9)) +
           2;
  }
  if (axis == "/output/t" && output.has_times()) {
    return output.times.size();
  }
  return levels / static_cast<std::size_t>(axis == "/output/t" ? output.every : output.states_every()) + 2;
}

}  // namespace

Chronicle::Chronicle(const Problem& problem, bool tangents)
    : problem_(problem),
      simulation_(make_simulation(problem, tangents)),
      output_(make_output(problem)),
      events_(make_events(problem)),
      times_(problem) {
  describe(omp_get_max_threads());
  statistics_.name(simulation_->invariant_names(), simulation_->total_names(), simulation_->law_names(),
                   events_ == nullptr ? std::vector<std::string>() : events_->names());
  const HamiltonianProblem* orbit = problem.hamiltonian();
  const MultisymplecticProblem* pde = problem.multisymplectic();
  statistics_.balance = orbit != nullptr ? orbit->p.back() == figures::work_momentum : pde != nullptr && pde->driven;
  statistics_.laws_every = static_cast<std::size_t>(problem.laws.every);
}

/// The columns that every record has, in the order of its digests.
void Chronicle::describe(int threads) {
  using record::Type;
  layout_ = {.title = problem_.title,
             .problem = problem_.text,
             .version = std::string(version()),
             .compiler = std::string(compiler()),
             .threads = threads,
             .compression = problem_.output.compression};
  const auto add = [this](const char* axis, std::string path, Type type, std::string description,
                          bool may_be_undefined = false) {
    return layout_.add({std::move(path), axis, {}, type, std::move(description), may_be_undefined});
  };
  constexpr auto levels = "/levels/t", steps = "/levels/step", states = "/states/t";
  columns_ = {
      .t = add(levels, "/levels/t", Type::f64, "time of every level"),
      .gamma = add(levels, "/levels/gamma", Type::f64, about_gamma(problem_, *simulation_), true),
      .node_energy = add(levels, "/levels/node_energy", Type::f64, "H(z_k)", true),
      .step = add(steps, "/levels/step", Type::i64, "number of the step from level k to k+1"),
      .h = add(steps, "/levels/h", Type::f64, "t_{k+1} - t_k"),
      .energy = add(steps, "/levels/energy", Type::f64, "discrete energy E_k (3.4)"),
      .target = add(steps, "/levels/target", Type::f64, "what E_k has to equal; undefined before E is set", true),
      .rounding = add(steps, "/levels/rounding", Type::f64, "a bound of what rounding makes of E_k"),
      .iterations = add(steps, "/levels/iterations", Type::i32, "evaluations of the gradient or Hessian in the step"),
      .bridged = add(steps, "/levels/bridged", Type::u8, "1 on bridging steps, which do not meet the energy law"),
      .crossing = add(steps, "/levels/crossing", Type::u8, "1 on the first step of each bridge"),
      .condition = add(steps, "/levels/step_condition", Type::f64,
                       "relative error of h: what is left of the level equation, and rounding in E_k, by |h dE/dh|; "
                       "undefined with fixed levels",
                       true)};
  if (problem_.scheme.potential.kind != StepPotentialChoice::Kind::none) {
    columns_.potential = add(steps, "/levels/step_potential", Type::f64, "f'(h), a part of E_k");
  }
  const bool gaps = problem_.laws.every > 1;
  if (gaps) {
    columns_.laws_taken = add(levels, std::string(figures::laws_taken), Type::u8,
                              "1 on levels whose laws were taken, with those of the step that led there");
  }
  for (const std::string& name : simulation_->invariant_names()) {
    columns_.invariants.push_back(
        add(levels, "/laws/" + name, Type::f64, "invariant " + name + " at every level", true));
  }
  for (const std::string& name : simulation_->total_names()) {
    columns_.totals.push_back(
        add(levels, "/laws/totals/" + name, Type::f64, "total of the density of " + name + " at every level", true));
  }
  for (Law& law : simulation_->laws()) {
    law.describe(layout_, gaps);
  }
  columns_.state_t = add(states, "/states/t", Type::f64, "time of the stored levels");
  columns_.state_level = add(states, "/states/level", Type::i64, "number of the stored level");
  simulation_->describe_states(layout_, problem_.output.states_every() > 1);
  if (output_ != nullptr) {
    columns_.output_t = add("/output/t", "/output/t", Type::f64, "the output times");
    output_->describe(layout_);
  }
  if (events_ != nullptr) {
    events_->describe(layout_);
  }
  if (const auto count = expected_levels(problem_)) {
    for (record::Dataset& dataset : layout_.datasets) {
      dataset.expected_rows = expected_rows(problem_, dataset.axis, *count);
    }
  }
}

void Chronicle::tell_start(RowSink& sink) {
  tell_level(0, sink);
  tell_state(sink);
  tell_outputs(sink);
  if (events_ != nullptr) {
    const OutputStep start = simulation_->last();
    events_->begin(sink, start.z_1, start.t_1, statistics_.events);
  }
}

void Chronicle::tell_level(std::size_t number, RowSink& sink) {
  const NodeEnergy node = simulation_->node();
  const figures::LevelFigures level{.t = simulation_->t(), .node_energy = node.energy, .gamma = node.gamma};
  statistics_.add_level(level);
  sink.append(columns_.t, level.t);
  sink.append(columns_.gamma, level.gamma);
  sink.append(columns_.node_energy, level.node_energy);
  const bool taken = problem_.laws.taken_at(number);
  if (columns_.laws_taken) {
    sink.append(*columns_.laws_taken, taken ? 1 : 0);
  }
  const auto tell = [&](const std::vector<record::Column>& columns, std::span<const double> values) {
    for (std::size_t i = 0; i < columns.size(); ++i) {
      sink.append(columns[i], taken ? values[i] : std::numeric_limits<double>::quiet_NaN());
    }
  };
  const auto invariants = taken ? simulation_->invariants() : std::span<const double>();
  const auto totals = taken ? simulation_->totals() : std::span<const double>();
  if (taken) {
    statistics_.add_laws(invariants, totals);
  }
  tell(columns_.invariants, invariants);
  tell(columns_.totals, totals);
}

void Chronicle::tell_step(const StepReport& report, RowSink& sink) {
  tell_level(statistics_.steps + 1, sink);
  causes_.add(report);
  const figures::StepFigures step{.h = report.h,
                                  .energy = report.energy,
                                  .target = report.target,
                                  .condition = report.condition,
                                  .rounding = simulation_->energy_rounding(),
                                  .potential = report.potential,
                                  .iterations = static_cast<double>(report.iterations),
                                  .bridged = report.bridged,
                                  .crossing = report.crossing};
  statistics_.add_step(step);
  sink.append(columns_.step, statistics_.steps - 1);
  sink.append(columns_.h, step.h);
  sink.append(columns_.energy, step.energy);
  sink.append(columns_.target, step.target);
  sink.append(columns_.rounding, step.rounding);
  sink.append(columns_.iterations, report.iterations);
  sink.append(columns_.bridged, step.bridged ? 1 : 0);
  sink.append(columns_.crossing, step.crossing ? 1 : 0);
  sink.append(columns_.condition, step.condition);
  if (columns_.potential) {
    sink.append(*columns_.potential, step.potential);
  }
  const auto laws = simulation_->laws();
  for (std::size_t i = 0; i < laws.size(); ++i) {
    if (problem_.laws.taken_at(statistics_.steps)) {
      statistics_.add_residual(i, laws[i].figures());
    }
    laws[i].append(sink);
  }
  if (statistics_.steps % static_cast<std::size_t>(problem_.output.states_every()) == 0) {
    tell_state(sink);
  }
  tell_outputs(sink);
  if (events_ != nullptr) {
    events_->append(sink, simulation_->last(), statistics_.events);
  }
}

figures::Statistics Chronicle::final_statistics() {
  figures::Statistics result = statistics_;
  result.errors = simulation_->errors();
  if (const StepPotential& f = simulation_->step_potential(); f.active()) {
    result.potential_length = f.length;
    result.potential_exponent = f.exponent;
  }
  return result;
}

void Chronicle::tell_outputs(RowSink& sink) {
  if (output_ == nullptr) {
    return;
  }
  const OutputStep step = simulation_->last();
  if (!problem_.output.has_times()) {
    if (statistics_.steps % static_cast<std::size_t>(problem_.output.every) == 0) {
      tell_output_of_level(sink);
    }
    return;
  }
  while (const auto t = times_.due(outputs_, step.t_1, statistics_.steps == 0 ? 0.0 : step.h)) {
    sink.append(columns_.output_t, *t);
    const bool defined = statistics_.steps == 0 ? output_->append(sink, step.z_1, *t) : output_->append(sink, step, *t);
    undefined_outputs_ += defined ? 0 : 1;
    ++outputs_;
  }
}

void Chronicle::tell_output_of_level(RowSink& sink) {
  const OutputStep step = simulation_->last();
  sink.append(columns_.output_t, step.t_1);
  undefined_outputs_ += output_->append(sink, step.z_1, step.t_1) ? 0 : 1;
  ++outputs_;
}

void Chronicle::tell_last(RowSink& sink) {
  if (stored_ != statistics_.steps) {
    tell_state(sink);
  }
  if (output_ != nullptr && !problem_.output.has_times() &&
      statistics_.steps % static_cast<std::size_t>(problem_.output.every) != 0) {
    tell_output_of_level(sink);
  }
}

void Chronicle::tell_state(RowSink& sink) {
  sink.append(columns_.state_t, simulation_->t());
  sink.append(columns_.state_level, statistics_.steps);
  simulation_->append_state(sink);
  stored_ = statistics_.steps;
}

void Chronicle::save(StateWriter& state) const {
  simulation_->save(state);
  causes_.save(state);
  statistics_.save(state);
  state.write(static_cast<double>(stored_));
  if (output_ != nullptr) {
    state.write(static_cast<double>(outputs_));
    state.write(static_cast<double>(undefined_outputs_));
  }
  if (events_ != nullptr) {
    events_->save(state);
  }
}

std::size_t Chronicle::values_after_statistics() const {
  StateWriter events;
  if (events_ != nullptr) {
    events_->save(events);
  }
  return (output_ == nullptr ? 1 : 3) + events.values().size();
}

void Chronicle::restore(StateReader& state) {
  simulation_->restore(state);
  causes_.restore(state);
  statistics_.restore(state);
  state.read(stored_);
  if (output_ != nullptr) {
    state.read(outputs_);
    state.read(undefined_outputs_);
  }
  if (events_ != nullptr) {
    events_->restore(state);
  }
}

}  // namespace rubato
