#include <rubato/study/run.hpp>

#include <chrono>
#include <cmath>
#include <limits>
#include <memory>

#include <fmt/format.h>
#include <omp.h>

#include <rubato/ode/integrate.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/record/writer.hpp>
#include <rubato/study/simulation.hpp>
#include <rubato/study/stored.hpp>
#include <rubato/study/version.hpp>
#include <rubato/variation/bridge_causes.hpp>

namespace rubato::study {

namespace {

using Clock = std::chrono::steady_clock;

/// Above this step condition the energy law still holds to the tolerance but its levels carry visible rounding.
constexpr double condition_warning = 1e-6;

std::string about_gamma(const Problem& problem, const Simulation& simulation) {
  if (!simulation.has_gamma()) {
    return "Gamma(z_k) is not defined for this scheme";
  }
  return problem.hamiltonian() != nullptr
             ? "Gamma(z_k) (theory, section 3)"
             : "Gamma(z_k) (theory, section 5), from velocities extrapolated over the last steps: an approximation";
}

/// The datasets that every record has, in the order in which level_rows and step_rows append them.
record::Layout make_layout(const Problem& problem, Simulation& simulation, int threads) {
  using record::Type;
  record::Layout layout{.title = problem.title,
                        .problem = problem.text,
                        .version = std::string(version()),
                        .compiler = std::string(compiler()),
                        .threads = threads};
  layout.datasets = {
      {"/levels/t", "/levels/t", {}, Type::f64, "time of every level"},
      {"/levels/gamma", "/levels/t", {}, Type::f64, about_gamma(problem, simulation), !simulation.has_gamma()},
      {"/levels/node_energy", "/levels/t", {}, Type::f64, "H(z_k)"},
      {"/levels/step", "/levels/step", {}, Type::i64, "number of the step from level k to k+1"},
      {"/levels/h", "/levels/step", {}, Type::f64, "t_{k+1} - t_k"},
      {"/levels/energy", "/levels/step", {}, Type::f64, "discrete energy E_k (3.4)"},
      {"/levels/iterations", "/levels/step", {}, Type::i32, "evaluations of the gradient or Hessian in the step"},
      {"/levels/bridged", "/levels/step", {}, Type::u8, "1 on bridging steps, which do not meet the energy law"},
      {"/levels/crossing", "/levels/step", {}, Type::u8, "1 on the first step of each bridge"},
      {"/levels/step_condition",
       "/levels/step",
       {},
       Type::f64,
       "relative error of h: what is left of the level equation, and rounding in E_k, by |h dE/dh|",
       true},
  };
  for (const std::string& name : simulation.invariant_names()) {
    layout.datasets.push_back(
        {"/laws/" + name, "/levels/t", {}, Type::f64, "invariant " + name + " at every level", true});
  }
  for (const std::string& name : simulation.total_names()) {
    layout.datasets.push_back(
        {"/laws/totals/" + name, "/levels/t", {}, Type::f64, "total of the density of " + name + " at every level"});
  }
  for (const std::string& name : simulation.residual_names()) {
    const std::string remark = " of the step (undefined where it has none)";
    layout.datasets.push_back(
        {"/laws/" + name + "_max", "/levels/step", {}, Type::f64, "largest local residual" + remark, true});
    layout.datasets.push_back({"/laws/" + name + "_rms",
                               "/levels/step",
                               {},
                               Type::f64,
                               "root mean square of the local residuals" + remark,
                               true});
  }
  layout.datasets.push_back({"/states/t", "/states/t", {}, Type::f64, "time of the stored levels"});
  layout.datasets.push_back({"/states/level", "/states/t", {}, Type::i64, "number of the stored level"});
  simulation.describe_states(layout, problem.output.every > 1);
  return layout;
}

/// The number of threads has to be known before anything allocates work space for each of them.
std::unique_ptr<Simulation> make_simulation_on(int threads, const Problem& problem, bool tangents) {
  if (threads > 0) {
    omp_set_num_threads(threads);
  }
  return make_simulation(problem, tangents);
}

/// Of a generating function: with F = 0 its even coefficients vanish, so that an odd order rounds up.
int reached_order(const Scheme& scheme) {
  return *scheme.order + (scheme.darboux == DarbouxKind::midpoint ? *scheme.order % 2 : 0);
}

/// How the energy that bridges leave open depends on the step: like the error of the node energy, which is of the order
/// of the scheme.
std::string how_it_falls(const Scheme& scheme) {
  if (scheme.lagrangian == Lagrangian::custom || scheme.lagrangian == Lagrangian::forward) {
    return "smaller steps make this smaller";
  }
  const int order = scheme.lagrangian == Lagrangian::generating ? reached_order(scheme) : 2;
  return order == 1   ? "this falls in proportion to the step"
         : order == 2 ? "this falls as the square of the step"
         : order == 3 ? "this falls as the cube of the step"
                      : fmt::format("this falls as the {}th power of the step", order);
}

/// A run under way: the simulation, what is known of it so far, and its record.
class Driver {
public:
  Driver(const Problem& problem, const RunOptions& options, std::string file)
      : problem_(problem),
        options_(options),
        simulation_(make_simulation_on(options.threads, problem, options.tangents)) {
    outcome_.title = problem.title;
    outcome_.file = std::move(file);
    outcome_.variable_levels = problem.scheme.levels == Levels::variable;
    for (const std::string& name : simulation_->invariant_names()) {
      outcome_.statistics.invariants.push_back({name, {}});
    }
    for (const std::string& name : simulation_->total_names()) {
      outcome_.statistics.totals.push_back({name, {}});
    }
    for (const std::string& name : simulation_->residual_names()) {
      outcome_.statistics.residuals.push_back({name, {}});
    }
    outcome_.statistics.autonomous = simulation_->autonomous();
    layout_ = make_layout(problem, *simulation_, omp_get_max_threads());
    first_state_ = layout_index("/states/t");
  }

  Outcome start() {
    writer_ = std::make_unique<record::Writer>(record::Writer::create(outcome_.file, layout_, options_.overwrite));
    outcome_.statistics.add_start(simulation_->t(), simulation_->node(), simulation_->invariants(),
                                  simulation_->totals());
    append_level();
    append_state();
    writer_->end_level();
    writer_->commit(checkpoint());
    return loop();
  }

  Outcome resume(const record::Checkpoint& checkpoint) {
    restore(checkpoint);
    writer_ = std::make_unique<record::Writer>(record::Writer::resume(outcome_.file, layout_));
    const bool at_end = simulation_->finished();
    Outcome outcome = loop();
    if (at_end) {
      outcome.warnings.push_back(fmt::format(
          "nothing was added: the record goes to t = {:.10g}, and until = {:.10g} is not beyond that; give a "
          "later --until",
          simulation_->t(), problem_.scheme.until));
    }
    return outcome;
  }

private:
  [[nodiscard]] std::size_t layout_index(std::string_view path) const {
    const auto found = std::ranges::find(layout_.datasets, path, &record::Dataset::path);
    return static_cast<std::size_t>(found - layout_.datasets.begin());
  }

  [[nodiscard]] record::Checkpoint checkpoint() const {
    StateWriter state;
    simulation_->save(state);
    outcome_.statistics.save(state);
    causes_.save(state);
    state.write(static_cast<double>(stored_));
    return {{"state", state.values()}};
  }

  void restore(const record::Checkpoint& checkpoint) {
    const auto found = checkpoint.find("state");
    const auto* values = found == checkpoint.end() ? nullptr : std::get_if<std::vector<double>>(&found->second);
    bool whole = values != nullptr;
    try {
      StateReader state(whole ? std::span<const double>(*values) : std::span<const double>());
      simulation_->restore(state);
      outcome_.statistics.restore(state);
      causes_.restore(state);
      state.read(stored_);
      whole = whole && state.done();
    } catch (const std::invalid_argument&) {
      whole = false;  // shorter than what it should restore
    }
    if (!whole) {
      throw record::Error(outcome_.file, "its checkpoint is not that of its problem: the run cannot be continued");
    }
  }

  void append_level() {
    std::size_t next = 0;
    writer_->append(next++, simulation_->t());
    writer_->append(next++, simulation_->node().gamma);
    writer_->append(next++, simulation_->node().energy);
    next = first_law();
    for (const std::span<const double> values : {simulation_->invariants(), simulation_->totals()}) {
      for (const double value : values) {
        writer_->append(next++, value);
      }
    }
  }

  void append_step(const StepReport& report) {
    std::size_t next = layout_index("/levels/step");
    writer_->append(next++, static_cast<std::int64_t>(outcome_.statistics.steps - 1));
    writer_->append(next++, report.h);
    writer_->append(next++, report.energy);
    writer_->append(next++, report.iterations);
    writer_->append(next++, report.bridged ? 1 : 0);
    writer_->append(next++, report.crossing ? 1 : 0);
    writer_->append(next++, report.condition);
    next = first_law() + outcome_.statistics.invariants.size() + outcome_.statistics.totals.size();
    for (const MaxRms& residual : simulation_->residuals()) {
      const bool known = residual.count > 0.0;
      writer_->append(next++, known ? residual.max : std::numeric_limits<double>::quiet_NaN());
      writer_->append(next++, known ? residual.rms() : std::numeric_limits<double>::quiet_NaN());
    }
  }

  [[nodiscard]] std::size_t first_law() const { return layout_index("/levels/step_condition") + 1; }

  void append_state() {
    writer_->append(first_state_, simulation_->t());
    writer_->append(first_state_ + 1, static_cast<std::int64_t>(outcome_.statistics.steps));
    simulation_->append_state(*writer_, first_state_ + 2, problem_.output.every > 1);
    stored_ = outcome_.statistics.steps;
  }

  Outcome loop() {
    const auto begin = Clock::now();
    last_progress_ = begin;
    outcome_.warnings = simulation_->cautions();
    for (const std::string& sentence : outcome_.warnings) {
      if (options_.caution) {
        options_.caution(sentence);
      }
    }
    while (outcome_.status == ExitStatus::done && !simulation_->finished()) {
      one_step();
    }
    outcome_.complete = outcome_.status == ExitStatus::done;
    finish();
    outcome_.statistics.errors = simulation_->errors();
    outcome_.wall_seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    add_warnings();
    return std::move(outcome_);
  }

  void finish() {
    const record::Checkpoint last = checkpoint();
    // The last state is always stored. Where it is not one of every n-th it is provisional: `resume` drops it again, so
    // that a run continued is the same as one never stopped.
    if (stored_ != outcome_.statistics.steps) {
      append_state();
    }
    writer_->finish(last,
                    outcome_.complete ? record::Writer::Completion::complete : record::Writer::Completion::interrupted);
  }

  void one_step() {
    if (options_.interrupt != nullptr && options_.interrupt->load()) {
      outcome_.status = ExitStatus::interrupted;
      outcome_.message =
          fmt::format("interrupted at t = {:.10g}; the record is whole up to there: continue with `rubato resume {}`",
                      simulation_->t(), outcome_.file);
      return;
    }
    if (outcome_.statistics.steps >= static_cast<std::size_t>(problem_.scheme.max_steps)) {
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "max_steps = {} reached at t = {:.10g}, before until = {:.10g}: raise scheme.max_steps, or take a larger "
          "step",
          problem_.scheme.max_steps, simulation_->t(), problem_.scheme.until);
      return;
    }
    const StepReport report = simulation_->step();
    causes_.add(report);
    if (report.status != Status::success) {
      const bool singular = report.status == Status::singular || report.status == Status::ill_conditioned;
      outcome_.status = singular ? ExitStatus::singular : ExitStatus::failed;
      const std::string reason = simulation_->failure_reason();
      outcome_.message = describe_failure(report, simulation_->t(), simulation_->node(), simulation_->last_step(),
                                          problem_.scheme.on_singular, reason);
      return;
    }
    Statistics& statistics = outcome_.statistics;
    const LevelNode node = simulation_->node();
    if (!std::isfinite(node.energy) || (simulation_->has_gamma() && !std::isfinite(node.gamma))) {
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "the node energy or Gamma is not finite at t = {:.10g}: the orbit left the domain of the formula{}",
          simulation_->t(),
          simulation_->failure_reason().empty() ? "" : fmt::format(" ({})", simulation_->failure_reason()));
      return;
    }
    statistics.add_step(report, simulation_->t(), node, simulation_->invariants(), simulation_->totals());
    const auto residuals = simulation_->residuals();
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      statistics.residuals[i].value.add(residuals[i]);
    }
    append_level();
    append_step(report);
    if (statistics.steps % static_cast<std::size_t>(problem_.output.every) == 0) {
      append_state();
    }
    writer_->end_level();
    if (writer_->commit_due()) {
      writer_->commit(checkpoint());
    }
    show_progress(report);
  }

  void show_progress(const StepReport& report) {
    if (!options_.progress) {
      return;
    }
    const auto now = Clock::now();
    if (now - last_progress_ < std::chrono::milliseconds(100)) {
      return;
    }
    last_progress_ = now;
    const Statistics& statistics = outcome_.statistics;
    options_.progress({.t = simulation_->t(),
                       .start = problem_.start(),
                       .until = problem_.scheme.until,
                       .h = report.h,
                       .steps = statistics.steps,
                       .bridges = statistics.bridges,
                       .relative_energy_deviation = statistics.relative_energy_deviation()});
  }

  void add_warnings() {
    for (std::string& sentence : simulation_->warnings()) {
      outcome_.warnings.push_back(std::move(sentence));
    }
    const Statistics& statistics = outcome_.statistics;
    const Scheme& scheme = problem_.scheme;
    for (std::string& sentence : statistics.undefined_quantities()) {
      outcome_.warnings.push_back(std::move(sentence));
    }
    if (scheme.order && reached_order(scheme) != *scheme.order) {
      outcome_.warnings.push_back(
          fmt::format("order = {0} rounds up to {1}: with darboux = \"midpoint\" the even coefficients of the "
                      "generating function vanish, so that orders are even; write order = {1}",
                      *scheme.order, reached_order(scheme)));
    }
    if (statistics.bridge_steps > 0) {
      outcome_.warnings.push_back(about_bridges());
    }
    if (outcome_.variable_levels && statistics.condition > condition_warning) {
      outcome_.warnings.push_back(
          fmt::format("the step condition reached {:.2g}: rounding in H moves the levels by that relative amount; "
                      "larger steps make it smaller",
                      statistics.condition));
    }
  }

  /// Why there were bridging steps, by what they show (BridgeCauses), and what to do.
  [[nodiscard]] std::string about_bridges() const {
    const Statistics& statistics = outcome_.statistics;
    const std::string count = fmt::format("{} of {} steps", statistics.bridge_steps, statistics.steps);
    // Where most of them are flat any h keeps the energy: H is linear, or the order so high that its errors vanish.
    if (2 * causes_.flat() > causes_.steps()) {
      return fmt::format(
          "Gamma is 0 to rounding on {}: there the discrete energy is the same whatever h is, and h was left as it "
          "was; larger steps, a lower order or levels = \"fixed\" may suit this problem better",
          count);
    }
    if (causes_.starting() == causes_.steps()) {
      return fmt::format(
          "the first step is too long to set the law: {}, and {} plain; E is {}; take a smaller step", too_long(),
          count, causes_.steps() == statistics.steps ? "not set yet" : "that of the first step that meets the law");
    }
    const std::string off = fmt::format(
        "{} bridge{} in {} steps, on which the discrete energy is off by up to {:.2g} "
        "(relative); {}",
        statistics.bridges, statistics.bridges == 1 ? "" : "s", statistics.steps,
        statistics.relative_bridge_deviation(), how_it_falls(problem_.scheme));
    if (causes_.crossings() == 0 && !nears_zero()) {
      return fmt::format("the step is too long for this orbit: {}; {}", too_long(), off);
    }
    const bool long_bridges = statistics.bridge_steps > 2 * statistics.bridges;
    return fmt::format("{}: {}{}", causes_.crossings() > 0 ? "Gamma changes sign on this orbit" : nearly_zero(), off,
                       long_bridges ? ". Here a bridge takes many steps, which smaller steps mend too" : "");
  }

  /// The smallest |Γ| of the run beside the largest.
  [[nodiscard]] bool nears_zero() const {
    constexpr double near = 0.02;
    const Range& gamma = outcome_.statistics.gamma;
    return gamma.min * gamma.max <= 0.0 || std::min(std::abs(gamma.min), std::abs(gamma.max)) <
                                               near * std::max(std::abs(gamma.min), std::abs(gamma.max));
  }
  [[nodiscard]] std::string nearly_zero() const {
    const Range& gamma = outcome_.statistics.gamma;
    return fmt::format("Gamma nears 0 on this orbit ({:.3g} to {:.3g})", gamma.min, gamma.max);
  }
  [[nodiscard]] std::string too_long() const {
    return fmt::format("{} goes from {:.4g} to {:.4g} in one step", causes_.from_slopes() ? "-(4/h) dE/dh" : "Gamma",
                       causes_.gamma_before(), causes_.gamma_after());
  }

  const Problem& problem_;
  const RunOptions& options_;
  std::unique_ptr<Simulation> simulation_;
  record::Layout layout_;
  std::size_t first_state_ = 0;
  std::unique_ptr<record::Writer> writer_;
  BridgeCauses causes_;
  std::size_t stored_ = 0;  ///< number of the last level whose state is stored
  Clock::time_point last_progress_;
  Outcome outcome_;
};

}  // namespace

std::unique_ptr<Simulation> make_simulation(const Problem& problem, bool tangents) {
  if (problem.hamiltonian() == nullptr) {
    return make_lattice_simulation(problem, tangents);
  }
  if (tangents) {
    throw ProblemError(problem.hamiltonian()->H.location,
                       "tangent solutions are carried along a lattice only: leave out --tangents for an orbit");
  }
  return make_orbit_simulation(problem);
}

Outcome run(const Problem& problem, const RunOptions& options) {
  return Driver(problem, options, options.output.value_or(problem.output.file)).start();
}

Outcome resume(const std::string& file, std::optional<double> until, const RunOptions& options) {
  Problem problem;
  record::Checkpoint checkpoint;
  RunOptions as_begun = options;
  {
    const record::Reader reader(file);
    as_begun.tangents = reader.has("/laws/multisymplectic_max");
    problem = stored_problem(reader);
    checkpoint = reader.checkpoint();
  }
  if (until) {
    const std::vector<std::string> settings = {fmt::format("scheme.until={:.17g}", *until)};
    problem = parse_problem(problem.text, file, settings);
  }
  return Driver(problem, as_begun, file).resume(checkpoint);
}

}  // namespace rubato::study
