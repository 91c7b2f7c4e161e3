#include <rubato/study/chronicle.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <omp.h>

#include <rubato/study/version.hpp>

namespace rubato::study {

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

/// The datasets that every record has, in the order in which a Chronicle tells of them.
record::Layout make_layout(const Problem& problem, Simulation& simulation, const OutputMaker* output,
                           const EventTeller* events, int threads) {
  using record::Type;
  record::Layout layout{.title = problem.title,
                        .problem = problem.text,
                        .version = std::string(version()),
                        .compiler = std::string(compiler()),
                        .threads = threads,
                        .compression = problem.output.compression};
  layout.datasets = {
      {"/levels/t", "/levels/t", {}, Type::f64, "time of every level"},
      {"/levels/gamma", "/levels/t", {}, Type::f64, about_gamma(problem, simulation), true},
      {"/levels/node_energy", "/levels/t", {}, Type::f64, "H(z_k)", true},
      {"/levels/step", "/levels/step", {}, Type::i64, "number of the step from level k to k+1"},
      {"/levels/h", "/levels/step", {}, Type::f64, "t_{k+1} - t_k"},
      {"/levels/energy", "/levels/step", {}, Type::f64, "discrete energy E_k (3.4)"},
      {"/levels/target", "/levels/step", {}, Type::f64, "what E_k has to equal; undefined before E is set", true},
      {"/levels/rounding", "/levels/step", {}, Type::f64, "a bound of what rounding makes of E_k"},
      {"/levels/iterations", "/levels/step", {}, Type::i32, "evaluations of the gradient or Hessian in the step"},
      {"/levels/bridged", "/levels/step", {}, Type::u8, "1 on bridging steps, which do not meet the energy law"},
      {"/levels/crossing", "/levels/step", {}, Type::u8, "1 on the first step of each bridge"},
      {"/levels/step_condition",
       "/levels/step",
       {},
       Type::f64,
       "relative error of h: what is left of the level equation, and rounding in E_k, by |h dE/dh|; undefined with "
       "fixed levels",
       true},
  };
  if (problem.scheme.potential.kind != StepPotentialChoice::Kind::none) {
    layout.datasets.push_back({"/levels/step_potential", "/levels/step", {}, Type::f64, "f'(h), a part of E_k"});
  }
  if (problem.laws.every > 1) {
    layout.datasets.push_back({std::string(figures::laws_taken),
                               "/levels/t",
                               {},
                               Type::u8,
                               "1 on levels whose laws were taken, with those of the step that led there"});
  }
  for (const std::string& name : simulation.invariant_names()) {
    layout.datasets.push_back(
        {"/laws/" + name, "/levels/t", {}, Type::f64, "invariant " + name + " at every level", true});
  }
  for (const std::string& name : simulation.total_names()) {
    layout.datasets.push_back({"/laws/totals/" + name,
                               "/levels/t",
                               {},
                               Type::f64,
                               "total of the density of " + name + " at every level",
                               true});
  }
  for (const std::string& name : simulation.residual_names()) {
    const std::string remark = problem.laws.every > 1 ? " of the step (undefined where it has none, or was not taken)"
                                                      : " of the step (undefined where it has none)";
    layout.datasets.push_back(
        {"/laws/" + name + "_max", "/levels/step", {}, Type::f64, "largest local residual" + remark, true});
    layout.datasets.push_back({"/laws/" + name + "_rms",
                               "/levels/step",
                               {},
                               Type::f64,
                               "root mean square of the local residuals" + remark,
                               true});
    layout.datasets.push_back({"/laws/" + name + "_undefined",
                               "/levels/step",
                               {},
                               Type::i32,
                               "number of cells in which the local residual of the step is not defined"});
  }
  layout.datasets.push_back({"/states/t", "/states/t", {}, Type::f64, "time of the stored levels"});
  layout.datasets.push_back({"/states/level", "/states/t", {}, Type::i64, "number of the stored level"});
  simulation.describe_states(layout, problem.output.states_every() > 1);
  if (output != nullptr) {
    layout.datasets.push_back({"/output/t", "/output/t", {}, Type::f64, "the output times"});
    output->describe(layout);
  }
  if (events != nullptr) {
    events->describe(layout);
  }
  if (const auto levels = expected_levels(problem)) {
    for (record::Dataset& dataset : layout.datasets) {
      dataset.expected_rows = expected_rows(problem, dataset.axis, *levels);
    }
  }
  return layout;
}

}  // namespace

Chronicle::Chronicle(const Problem& problem, bool tangents)
    : problem_(problem),
      simulation_(make_simulation(problem, tangents)),
      output_(make_output(problem)),
      events_(make_events(problem)),
      times_(problem),
      layout_(make_layout(problem, *simulation_, output_.get(), events_.get(), omp_get_max_threads())),
      first_step_(dataset("/levels/step")),
      has_potential_(problem.scheme.potential.kind != StepPotentialChoice::Kind::none),
      laws_taken_(problem.laws.every > 1 ? std::optional(dataset(figures::laws_taken)) : std::nullopt),
      first_law_(dataset("/levels/step_condition") + (has_potential_ ? 2 : 1) + (laws_taken_ ? 1 : 0)),
      first_state_(dataset("/states/t")),
      first_output_(dataset("/output/t")),
      first_event_(problem.events.empty() ? 0 : dataset("/events/" + problem.events.front().name + "/missed")) {
  statistics_.name(simulation_->invariant_names(), simulation_->total_names(), simulation_->residual_names(),
                   events_ == nullptr ? std::vector<std::string>() : events_->names());
  const HamiltonianProblem* orbit = problem.hamiltonian();
  const MultisymplecticProblem* pde = problem.multisymplectic();
  statistics_.balance = orbit != nullptr ? orbit->p.back() == figures::work_momentum : pde != nullptr && pde->driven;
  statistics_.laws_every = static_cast<std::size_t>(problem.laws.every);
}

std::size_t Chronicle::dataset(std::string_view path) const {
  const auto found = std::ranges::find(layout_.datasets, path, &record::Dataset::path);
  return static_cast<std::size_t>(found - layout_.datasets.begin());
}

void Chronicle::tell_start(RowSink& sink) {
  tell_level(0, sink);
  tell_state(sink);
  tell_outputs(sink);
  if (events_ != nullptr) {
    const OutputStep start = simulation_->last();
    events_->begin(sink, first_event_, start.z_1, start.t_1, statistics_.events);
  }
}

void Chronicle::tell_level(std::size_t number, RowSink& sink) {
  const LevelNode node = simulation_->node();
  const figures::LevelFigures level{.t = simulation_->t(), .node_energy = node.energy, .gamma = node.gamma};
  statistics_.add_level(level);
  std::size_t next = 0;
  sink.append(next++, level.t);
  sink.append(next++, level.gamma);
  sink.append(next++, level.node_energy);
  const bool taken = problem_.laws.taken_at(number);
  if (laws_taken_) {
    sink.append(*laws_taken_, taken ? 1 : 0);
  }
  next = first_law_;
  if (!taken) {
    for (std::size_t i = 0; i < statistics_.invariants.size() + statistics_.totals.size(); ++i) {
      sink.append(next++, std::numeric_limits<double>::quiet_NaN());
    }
    return;
  }
  const auto invariants = simulation_->invariants(), totals = simulation_->totals();
  statistics_.add_laws(invariants, totals);
  for (const std::span<const double> values : {invariants, totals}) {
    for (const double value : values) {
      sink.append(next++, value);
    }
  }
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
  std::size_t next = first_step_;
  sink.append(next++, statistics_.steps - 1);
  sink.append(next++, step.h);
  sink.append(next++, step.energy);
  sink.append(next++, step.target);
  sink.append(next++, step.rounding);
  sink.append(next++, report.iterations);
  sink.append(next++, step.bridged ? 1 : 0);
  sink.append(next++, step.crossing ? 1 : 0);
  sink.append(next++, step.condition);
  if (has_potential_) {
    sink.append(next++, step.potential);
  }
  next = first_law_ + statistics_.invariants.size() + statistics_.totals.size();
  const auto residuals = simulation_->residuals();
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    const auto residual = figures::ResidualFigures::of(residuals[i]);
    if (problem_.laws.taken_at(statistics_.steps)) {
      statistics_.add_residual(i, residual);
    }
    sink.append(next++, residual.max);
    sink.append(next++, residual.rms);
    sink.append(next++, static_cast<std::int64_t>(residual.undefined));
  }
  if (statistics_.steps % static_cast<std::size_t>(problem_.output.states_every()) == 0) {
    tell_state(sink);
  }
  tell_outputs(sink);
  if (events_ != nullptr) {
    events_->append(sink, first_event_, simulation_->last(), statistics_.events);
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
    sink.append(first_output_, *t);
    const bool defined = statistics_.steps == 0 ? output_->append(sink, first_output_ + 1, step.z_1, *t)
                                                : output_->append(sink, first_output_ + 1, step, *t);
    undefined_outputs_ += defined ? 0 : 1;
    ++outputs_;
  }
}

void Chronicle::tell_output_of_level(RowSink& sink) {
  const OutputStep step = simulation_->last();
  sink.append(first_output_, step.t_1);
  undefined_outputs_ += output_->append(sink, first_output_ + 1, step.z_1, step.t_1) ? 0 : 1;
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
  sink.append(first_state_, simulation_->t());
  sink.append(first_state_ + 1, statistics_.steps);
  simulation_->append_state(sink, first_state_ + 2, problem_.output.states_every() > 1);
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

}  // namespace rubato::study
