#include <rubato/run/observed_run.hpp>

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
    return "not a number: this scheme has no Gamma at its levels (theory, section 3)";
  }
  return problem.hamiltonian() != nullptr
             ? "Gamma(z_k) (theory, section 3)"
             : "Gamma(z_k) (theory, section 5), from velocities extrapolated over the last steps: an approximation";
}

std::size_t rows_along(std::string_view axis, const Problem& problem, std::size_t levels) {
  if (axis.starts_with("/levels/")) {
    return levels / static_cast<std::size_t>(problem.levels.every) + 1;
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

std::optional<std::size_t> expected_levels(const Problem& problem) {
  if (!problem.scheme.step) {
    return std::nullopt;
  }
  const double steps = std::ceil((problem.scheme.until - problem.start()) / *problem.scheme.step);
  return static_cast<std::size_t>(std::clamp(steps, 0.0, static_cast<double>(problem.scheme.max_steps))) + 1;
}

std::vector<std::optional<std::size_t>> expected_rows(const record::Layout& layout, const Problem& problem,
                                                      std::size_t levels) {
  std::vector<std::optional<std::size_t>> rows;
  for (const record::Dataset& dataset : layout.datasets) {
    rows.emplace_back(rows_along(dataset.axis, problem, levels));
  }
  return rows;
}

ObservedRun::ObservedRun(const Problem& problem, bool tangents)
    : problem_(problem),
      simulation_(make_simulation(problem, tangents)),
      output_(make_output(problem)),
      events_(make_events(problem)),
      tangents_(make_tangents(problem)),
      times_(problem),
      meter_(problem) {
  describe(omp_get_max_threads());
  rows_.describe(layout_, simulation_->levels_kept());
  may_stop_ = std::ranges::any_of(problem.events, [](const StatedEvent& event) { return event.stop_after > 0; });
  statistics_.name(simulation_->invariant_names(), simulation_->total_names(), simulation_->law_names(),
                   events_ == nullptr ? std::vector<std::string>() : events_->names(),
                   tangents_ == nullptr ? std::vector<std::string>() : tangents_->names());
  const HamiltonianProblem* orbit = problem.hamiltonian();
  const MultisymplecticProblem* pde = problem.multisymplectic();
  statistics_.balance = orbit != nullptr ? orbit->p.back() == figures::work_momentum : pde != nullptr && pde->driven;
  statistics_.laws_every = static_cast<std::size_t>(problem.laws.every);
}

/// The columns that every record has.
void ObservedRun::describe(int threads) {
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
  const std::string which =
      problem_.levels.all() ? "every level" : fmt::format("every {}-th level, and the last", problem_.levels.every);
  columns_ = {
      .t = add(levels, "/levels/t", Type::f64, "time of " + which),
      .gamma = add(levels, "/levels/gamma", Type::f64, about_gamma(problem_, *simulation_), true),
      .node_energy = add(levels, "/levels/node_energy", Type::f64, "node energy H(z_k)", true),
      .step = add(steps, "/levels/step", Type::i64,
                  problem_.levels.all() ? "number of the step from level k to k+1"
                                        : "number k of the step from level k to the next, which has a row"),
      .h = add(steps, "/levels/h", Type::f64, "length t_{k+1} - t_k of the step"),
      .energy = add(steps, "/levels/energy", Type::f64, "discrete energy E_k (3.4)"),
      .target = add(steps, "/levels/target", Type::f64,
                    "value E that the law requires of E_k; undefined before it is set", true),
      .rounding = add(steps, "/levels/rounding", Type::f64, "bound on the rounding error of E_k"),
      .iterations = add(steps, "/levels/iterations", Type::i32, "evaluations of the gradient or Hessian in the step"),
      .off_law = add(steps, "/levels/off_law", Type::u8, "1 on plain steps, which do not satisfy the energy law"),
      .condition = add(steps, "/levels/step_condition", Type::f64,
                       "relative error of h: residual of the level equation and rounding error of E_k, over |h dE/dh|; "
                       "undefined with fixed levels",
                       true)};
  if (problem_.scheme.potential.kind != StepPotentialChoice::Kind::none) {
    columns_.potential = add(steps, "/levels/step_potential", Type::f64, "f'(h) of the step potential, a part of E_k");
  }
  if (problem_.clock()) {
    columns_.time = add(levels, std::string(figures::level_times), Type::f64, "physical time of " + which);
  }
  const bool gaps = problem_.laws.every > 1;
  if (gaps) {
    columns_.laws_taken = add(levels, std::string(figures::laws_taken), Type::u8,
                              "1 on levels whose laws were taken, with those of the step that led there");
  }
  for (const std::string& name : simulation_->invariant_names()) {
    columns_.invariants.push_back(add(levels, "/laws/" + name, Type::f64, "invariant " + name + " at " + which, true));
  }
  for (const std::string& name : simulation_->total_names()) {
    columns_.totals.push_back(
        add(levels, "/laws/totals/" + name, Type::f64, "total of the density of " + name + " at " + which, true));
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
  if (tangents_ != nullptr) {
    tangents_->describe(layout_);
  }
  if (const auto count = expected_levels(problem_)) {
    const auto rows = expected_rows(layout_, problem_, *count);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      layout_.datasets[i].expected_rows = rows[i];
    }
  }
}

void ObservedRun::append_start(RowSink& sink) {
  rows_.pass_on_to(sink);
  const NodeEnergy node = simulation_->node();
  take_level(0, {.t = simulation_->t(), .node_energy = node.energy, .gamma = node.gamma}, 0.0);
  append_row(sink);
  append_state(sink);
  if (tangents_ != nullptr) {
    tangents_->append_state(sink);
  }
  append_outputs(sink, 0);
  if (events_ != nullptr) {
    const OutputStep start = simulation_->last();
    events_->begin(sink, start.z_1, start.t_1, statistics_.events);
  }
}

void ObservedRun::take_level(std::size_t number, const figures::LevelFigures& level, double rounding) {
  statistics_.add_level(level);
  rows_.put(columns_.t, level.t);
  if (columns_.time) {
    rows_.put(*columns_.time, simulation_->clock());
  }
  rows_.put(columns_.gamma, level.gamma);
  rows_.put(columns_.node_energy, level.node_energy);
  const bool taken = problem_.laws.taken_at(number);
  if (columns_.laws_taken) {
    rows_.put(*columns_.laws_taken, taken ? 1.0 : 0.0);
  }
  const auto invariants = taken ? simulation_->invariants() : std::span<const double>();
  const auto totals = simulation_->totals(taken);
  if (taken) {
    statistics_.add_laws(invariants, totals);
  } else {
    statistics_.add_balances(totals);
  }
  for (std::size_t i = 0; i < columns_.invariants.size(); ++i) {
    rows_.put(columns_.invariants[i], taken ? invariants[i] : std::numeric_limits<double>::quiet_NaN());
  }
  for (std::size_t i = 0; i < columns_.totals.size(); ++i) {
    rows_.put(columns_.totals[i], totals[i]);
  }
  meter_.add_level(*simulation_, number, level.node_energy, rounding);
}

void ObservedRun::take_step(const TakenStep& taken) {
  const StepReport& report = taken.report;
  causes_.add(report);
  const figures::StepFigures step{.h = report.h,
                                  .energy = report.energy,
                                  .target = report.target,
                                  .condition = report.condition,
                                  .rounding = taken.rounding,
                                  .potential = report.potential,
                                  .iterations = static_cast<double>(report.iterations),
                                  .off_law = report.off_law};
  statistics_.add_step(step);
  rows_.put(columns_.step, static_cast<double>(statistics_.steps - 1));
  rows_.put(columns_.h, step.h);
  rows_.put(columns_.energy, step.energy);
  rows_.put(columns_.target, step.target);
  rows_.put(columns_.rounding, step.rounding);
  rows_.put(columns_.iterations, step.iterations);
  rows_.put(columns_.off_law, step.off_law ? 1.0 : 0.0);
  rows_.put(columns_.condition, step.condition);
  if (columns_.potential) {
    rows_.put(*columns_.potential, step.potential);
  }
  const auto laws = simulation_->laws();
  for (std::size_t i = 0; i < laws.size(); ++i) {
    if (problem_.laws.taken_at(statistics_.steps)) {
      statistics_.add_residual(i, laws[i].figures());
    } else {
      laws[i].set({});
    }
    laws[i].append(rows_);
  }
}

void ObservedRun::append_steps(RowSink& sink) {
  const std::span<const TakenStep> taken = simulation_->taken();
  const std::size_t before = statistics_.steps, count = taken.size();
  rows_.pass_on_to(sink);
  for (std::size_t place = 0; place < count; ++place) {
    look_at(place);
    take_level(before + place + 1, taken[place].level, taken[place].rounding);
    take_step(taken[place]);
    if (tangents_ != nullptr) {
      take_tangents(sink);
    }
  }
  rows_.require_finite(count, before + 1);
  // show(number, count): of every n-th level in the block, if there are any
  const auto of_every = [&](std::int64_t n, const auto& write) {
    const auto every = static_cast<std::size_t>(n);
    const std::size_t first = every - before % every;  // steps from there
    if (first <= count) {
      look_at(first - 1);
      write(before + first, (count - first) / every + 1, every);
    }
  };
  of_every(problem_.output.states_every(), [&](std::size_t number, std::size_t stored, std::size_t every) {
    append_states(sink, number, stored, every);
  });
  for (std::size_t place = 0; place < count && (output_ != nullptr || events_ != nullptr); ++place) {
    look_at(place);
    append_outputs(sink, before + place + 1);
    if (events_ != nullptr) {
      events_->append(rows_, simulation_->last(), statistics_.events);
    }
  }
  of_every(problem_.levels.every,
           [&](std::size_t, std::size_t stored, std::size_t every) { rows_.append_to(sink, false, stored, every); });
  look_at(count - 1);
}

figures::Measures ObservedRun::final_measures() {
  if (!final_ || final_->first != statistics_.steps) {
    final_.emplace(statistics_.steps, meter_.measures_to(*simulation_, statistics_.steps));
  }
  return final_->second;
}

figures::Statistics ObservedRun::final_statistics() {
  figures::Statistics result = statistics_;
  result.errors = simulation_->errors();
  result.measures = final_measures();
  if (problem_.clock()) {
    result.clock = simulation_->clock();
    result.clock_start = problem_.clock_start();
  }
  if (const StepPotential& f = simulation_->step_potential(); f.active()) {
    result.potential_length = f.length;
    result.potential_exponent = f.exponent;
  }
  return result;
}

void ObservedRun::append_outputs(RowSink& sink, std::size_t number) {
  if (output_ == nullptr) {
    return;
  }
  const OutputStep step = simulation_->last();
  if (!problem_.output.has_times()) {
    if (number % static_cast<std::size_t>(problem_.output.every) == 0) {
      append_output_of_level(sink);
    }
    return;
  }
  while (const auto t = times_.due(outputs_, step.end(), number == 0 ? 0.0 : step.length())) {
    sink.append(columns_.output_t, *t);
    const bool defined = number == 0 ? output_->append(sink, step.z_1, *t) : output_->append(sink, step, *t);
    undefined_outputs_ += defined ? 0 : 1;
    ++outputs_;
  }
}

/// Of the step to the level that is looked at, which was counted already.
void ObservedRun::take_tangents(RowSink& sink) {
  const OutputStep step = simulation_->last();
  tangents_->take(step);
  tangents_->append_step(rows_);
  tangents_->add_to(statistics_, step);
  if (statistics_.steps % static_cast<std::size_t>(problem_.output.states_every()) == 0) {
    tangents_->append_state(sink);
  }
}

void ObservedRun::append_output_of_level(RowSink& sink) {
  const OutputStep step = simulation_->last();
  sink.append(columns_.output_t, step.end());
  undefined_outputs_ += output_->append(sink, step.z_1, step.end()) ? 0 : 1;
  ++outputs_;
}

void ObservedRun::append_last(RowSink& sink) {
  if (!problem_.levels.stored_at(statistics_.steps)) {
    append_row(sink);
  }
  if (stored_ != statistics_.steps) {
    append_state(sink);
    if (tangents_ != nullptr) {
      tangents_->append_state(sink);
    }
  }
  if (output_ != nullptr && !problem_.output.has_times() &&
      statistics_.steps % static_cast<std::size_t>(problem_.output.every) != 0) {
    append_output_of_level(sink);
  }
}

void ObservedRun::append_states(RowSink& sink, std::size_t number, std::size_t count, std::size_t stride) {
  sink.append_rows(columns_.state_t, count, rows_.values(columns_.t, count, stride));
  numbers_of_states_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    numbers_of_states_[i] = static_cast<std::int64_t>(number + i * stride);
  }
  sink.append_rows(columns_.state_level, count, numbers_of_states_);
  simulation_->append_states(sink, count, stride);
  stored_ = number + (count - 1) * stride;
}

void ObservedRun::save(StateWriter& state) const {
  simulation_->save(state);
  causes_.save(state);
  statistics_.save(state);
  save_output(state);
}

void ObservedRun::save_output(StateWriter& state) const {
  state.write(static_cast<double>(stored_));
  if (output_ != nullptr) {
    state.write(static_cast<double>(outputs_));
    state.write(static_cast<double>(undefined_outputs_));
    output_->save(state);
  }
  if (events_ != nullptr) {
    events_->save(state);
  }
  if (tangents_ != nullptr) {
    tangents_->save(state);
  }
  if (!problem_.levels.all()) {  // else the row is in the record
    rows_.save(state);
  }
}

std::size_t ObservedRun::values_after_statistics() const {
  StateWriter output;
  save_output(output);
  return output.values().size();
}

void ObservedRun::restore(StateReader& state) {
  simulation_->restore(state);
  causes_.restore(state);
  statistics_.restore(state);
  state.read(stored_);
  if (output_ != nullptr) {
    state.read(outputs_);
    state.read(undefined_outputs_);
    output_->restore(state);
  }
  if (events_ != nullptr) {
    events_->restore(state);
  }
  if (tangents_ != nullptr) {
    tangents_->restore(state);
  }
  rows_.look_at(0);
  if (!problem_.levels.all()) {
    rows_.restore(state);
  } else {
    rows_.put(columns_.t, simulation_->t());
  }
}

}  // namespace rubato
