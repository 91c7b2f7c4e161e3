#include <rubato/run/run.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>

#include <fmt/format.h>

#include <rubato/ode/integrate.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/record/writer.hpp>
#include <rubato/run/gathering_sink.hpp>
#include <rubato/run/lattice_ranks.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/shared_rows.hpp>
#include <rubato/run/threads.hpp>

namespace rubato {

namespace {

using Clock = std::chrono::steady_clock;

/// Above this step condition the energy law still holds to the tolerance but its levels carry visible rounding.
constexpr double condition_warning = 1e-6;
/// A step potential of this part of the terms of the energy is told as one: it is meant to be of the size of errors.
constexpr double large_potential = 0.1;
/// So many times the steps of the law without a potential are told as a price that need not be paid.
constexpr double high_price = 5.0;

/// Keeps digests of rows that a record has already.
class DigestSink final : public RowSink {
public:
  explicit DigestSink(Digests& digests) : digests_(digests) {}
  void append(record::Column column, std::span<const double> row) override { digests_[column.number].add_row(row); }
  void append(record::Column column, std::span<const std::int64_t> row) override {
    digests_[column.number].add_row(row);
  }
  void append_part(record::Column column, std::span<const double> part, bool is_last) override {
    digests_[column.number].add_part(part, is_last);
  }
  InParts in_parts(std::span<const record::Column> /*columns*/) override {
    return {.wanted = InParts::Wanted::checksum, .file = {}, .rows = {}};
  }
  void append_checksum(record::Column column, const Checksum& row) override { digests_[column.number].add_row(row); }

private:
  Digests& digests_;
};

/// How the energy that bridges leave open depends on the step: like the error of the node energy, which is of the order
/// of the scheme.
std::string how_it_falls(const Scheme& scheme, int order) {
  if (scheme.lagrangian == LagrangianName::custom || scheme.lagrangian == LagrangianName::forward) {
    return "smaller steps make this smaller";
  }
  return order == 1   ? "this falls in proportion to the step"
         : order == 2 ? "this falls as the square of the step"
         : order == 3 ? "this falls as the cube of the step"
                      : fmt::format("this falls as the {}th power of the step", order);
}

/// A run under way: the simulation, what is known of it so far, and its record.
class Driver {
public:
  Driver(const Problem& problem, const RunOptions& options, std::string file) : problem_(problem), options_(options) {
    use_threads(options.threads);  // has to be known before anything allocates work space for each of them
    if (options.ranks != nullptr && options.ranks->size() > 1) {
      leader_.emplace(*options.ranks, problem, options.threads, options.tangents);
    }
    make_chronicle();
    outcome_.title = problem.title;
    outcome_.file = std::move(file);
    outcome_.variable_levels = problem.scheme.levels == Levels::variable;
    if (const auto* lattice = std::get_if<MultisymplecticProblem>(&problem.system)) {
      outcome_.axes = lattice->axes.size();
    }
  }

  Outcome start() {
    recorder_.emplace(record::Writer::create(outcome_.file, layout_of_record(), options_.overwrite, commit_policy()),
                      Digests(chronicle_->layout().datasets.size()));
    try {
      order(Order::start);
      tell(*recorder_, [this](RowSink& sink) { chronicle_->tell_start(sink); });
    } catch (const record::NotFinite& error) {
      return undefined_at_start(error);
    }
    writer().end_level();
    if (leader_ || Clock::now() - begun_ >= short_run) {
      commit();
    }
    return loop();
  }

  /// Nobody else can have written the record since it was claimed: the problem that this driver was made for, the
  /// checkpoint and the rows are of one version.
  Outcome resume(record::Claim claim) {
    auto continued = record::Writer::resume(std::move(claim), chronicle_->layout(), commit_policy(), state_apart());
    Digests digests = restore(continued.checkpoint());
    recorder_.emplace(std::move(continued), std::move(digests));
    const bool stopped = chronicle_->stopped(), at_end = simulation().finished() && !stopped;
    Outcome outcome = loop();
    if (stopped) {
      outcome.warnings.push_back(
          fmt::format("nothing was added: event {} ended the run, which goes no further; run the problem without it",
                      statistics().stopped_by()->name));
    }
    if (at_end) {
      outcome.warnings.push_back(fmt::format(
          "nothing was added: the record goes to t = {:.10g}, and until = {:.10g} is not beyond that; give a "
          "later --until",
          simulation().t(), problem_.scheme.until));
    }
    return outcome;
  }

private:
  /// A run of one process that has ended by then is published once, when it ends: to publish its start would take as
  /// long again.
  static constexpr std::chrono::milliseconds short_run{50};

  [[nodiscard]] Simulation& simulation() { return chronicle_->simulation(); }
  [[nodiscard]] const Statistics& statistics() const { return chronicle_->statistics(); }
  [[nodiscard]] const BridgeCauses& causes() const { return chronicle_->causes(); }
  [[nodiscard]] record::Writer& writer() { return recorder_->writer(); }
  /// The checkpoint goes into the record as the parts of the ranks come, where there are others.
  void stage_checkpoint() {
    writer().stage(make_checkpoint_in_parts(*chronicle_, recorder_->digests(), [this] { order(Order::save); }));
  }
  void commit() {
    if (leader_) {
      stage_checkpoint();
      writer().commit();
    } else {
      writer().commit(make_checkpoint(*chronicle_, recorder_->digests()));
    }
  }

  /// What all ranks do together, where there are others.
  void order(Order order) const {
    if (leader_) {
      leader_->order(order);
    }
  }
  void make_chronicle() {
    order(Order::make);
    chronicle_.emplace(problem_, options_.tangents);
  }
  /// Lets `append` have a sink whose rows go to `sink`.
  template <typename Append>
  void tell(RowSink& sink, const Append& append) {
    if (leader_) {
      GatheringSink gathering(leader_->slab(), chronicle_->layout(), &sink);
      append(gathering);
      gathering.finish();
      gathering.rethrow();
    } else {
      append(sink);
    }
  }

  /// Ranks write long rows of nodes together.
  [[nodiscard]] record::Layout layout_of_record() const {
    record::Layout layout = chronicle_->layout();
    for (record::Dataset& dataset : layout.datasets) {
      dataset.together = leader_ && has_nodes(dataset);
    }
    return layout;
  }

  /// Of a shared lattice no more rows wait in memory than this rank's part of a field takes, or a megabyte.
  [[nodiscard]] record::CommitPolicy commit_policy() const {
    record::CommitPolicy policy{.durable = problem_.output.durable, .first = short_run};
    if (leader_) {
      policy.buffer_bytes =
          std::clamp(leader_->slab().owned() * sizeof(double), std::size_t{1} << 20, policy.buffer_bytes);
    }
    return policy;
  }

  /// The array that is left out of checkpoints as they are read, where ranks share it and none has room for all of it.
  [[nodiscard]] const char* state_apart() const { return leader_ ? "state" : ""; }

  /// \param checkpoint that of the record, but for state_apart()
  Digests restore(const record::Checkpoint& checkpoint) {
    if (!checkpoint.contains(Digest::array)) {
      throw record::Error(outcome_.file,
                          "it was written by an earlier version, whose checkpoints this one does not go on from: run "
                          "its problem again");
    }
    std::optional<Digests> digests;
    if (leader_) {
      const record::Reader record(outcome_.file);
      if (record.has(shared_state)) {
        const std::size_t size = record.rows(shared_state);
        leader_->order_restore(size);
        SharedState source(leader_->slab(), &record);
        StateReader state(source, size);
        digests = restored(checkpoint, state, *chronicle_);
        source.rethrow();
      }
    } else {
      digests = restored(checkpoint, *chronicle_);
    }
    if (!digests) {
      throw record::Error(outcome_.file, "its checkpoint is not that of its problem: the run cannot be continued");
    }
    return *std::move(digests);
  }

  /// Where a level begins that cannot be stored, the run ends with the one before it: the simulation is taken back to
  /// the last checkpoint published, or its start, and repeats the steps since then, so that what is stored last is a
  /// state of the record.
  void go_back_to(std::size_t steps) {
    writer().drop_level();
    make_chronicle();
    Digests digests(chronicle_->layout().datasets.size());
    DigestSink sink(digests);
    if (writer().published()) {
      digests = restore(record::Reader(outcome_.file).checkpoint(state_apart()));
    } else {
      order(Order::start);
      tell(sink, [this](RowSink& rows) { chronicle_->tell_start(rows); });
    }
    while (statistics().steps < steps) {
      order(Order::step);
      const StepReport report = simulation().step();
      if (report.status != Status::success) {
        throw std::logic_error("a step that was taken before cannot be repeated");
      }
      tell(sink, [&](RowSink& rows) {
        chronicle_->tell_step(report, rows);
        static_cast<void>(simulation().node());  // as all ranks do
      });
    }
    recorder_->set_digests(std::move(digests));
  }

  [[nodiscard]] std::string cause_of_undefined() {
    const std::string reason = simulation().integrator().failure_reason();
    return reason.empty() ? "" : fmt::format(" ({})", reason);
  }

  Outcome undefined_at_start(const record::NotFinite& error) {
    recorder_.reset();  // nothing was written
    const auto* orbit = problem_.hamiltonian();
    const Location& place = orbit != nullptr ? orbit->initial.location : problem_.multisymplectic()->initial_location;
    outcome_.status = ExitStatus::failed;
    outcome_.message = fmt::format(
        "{}: a value is not finite at the start, t = {:.10g}{}: {}. A formula, or a derivative of it, is not defined "
        "there: start elsewhere. Nothing was written",
        place.text(), simulation().t(), cause_of_undefined(), explained(error));
    outcome_.file.clear();
    return std::move(outcome_);
  }

  /// "record: value 0 of row 3 of '/states/u' is inf" in the words of a user.
  [[nodiscard]] static std::string explained(const record::NotFinite& error) {
    const std::string_view text = error.what();
    const std::size_t colon = text.find(": ");
    return std::string(colon == std::string_view::npos ? text : text.substr(colon + 2));
  }

  Outcome loop() {
    const auto begin = Clock::now();
    last_progress_ = begin;
    outcome_.warnings = simulation().cautions();
    for (const std::string& sentence : outcome_.warnings) {
      if (options_.caution) {
        options_.caution(sentence);
      }
    }
    while (outcome_.status == ExitStatus::done && !simulation().finished() && !chronicle_->stopped()) {
      one_step();
    }
    outcome_.complete = outcome_.status == ExitStatus::done;
    finish();
    order(Order::finish);
    outcome_.statistics = chronicle_->final_statistics();
    outcome_.wall_seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    add_warnings();
    outcome_.step_potential = simulation().step_potential();
    outcome_.order = simulation().order();
    return std::move(outcome_);
  }

  void finish() {
    std::optional<record::Checkpoint> last;
    if (leader_) {
      stage_checkpoint();
    } else {
      last = make_checkpoint(*chronicle_, recorder_->digests());
    }
    // The last state is always stored. Where it is not one of every n-th it is provisional: `resume` drops it again, so
    // that a run continued is the same as one never stopped.
    order(Order::last);
    tell(*recorder_, [this](RowSink& sink) { chronicle_->tell_last(sink); });
    const auto completion =
        outcome_.complete ? record::Writer::Completion::complete : record::Writer::Completion::interrupted;
    last ? writer().finish(*last, completion) : writer().finish(completion);
  }

  void one_step() {
    if (options_.interrupt != nullptr && options_.interrupt->load()) {
      outcome_.status = ExitStatus::interrupted;
      outcome_.message =
          fmt::format("interrupted at t = {:.10g}; the record is whole up to there: continue with `rubato resume {}`",
                      simulation().t(), outcome_.file);
      return;
    }
    if (statistics().steps >= static_cast<std::size_t>(problem_.scheme.max_steps)) {
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "max_steps = {} reached at t = {:.10g}, before until = {:.10g}: raise scheme.max_steps, or take a larger "
          "step",
          problem_.scheme.max_steps, simulation().t(), problem_.scheme.until);
      return;
    }
    order(Order::step);
    const StepReport report = simulation().step();
    if (report.status != Status::success) {
      const bool singular = report.status == Status::singular || report.status == Status::ill_conditioned;
      outcome_.status = singular ? ExitStatus::singular : ExitStatus::failed;
      outcome_.message = simulation().integrator().explain(report);
      return;
    }
    const std::size_t steps = statistics().steps;
    NodeEnergy node;
    try {
      tell(*recorder_, [&](RowSink& sink) {
        chronicle_->tell_step(report, sink);
        node = simulation().node();
      });
    } catch (const record::NotFinite& error) {
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "{}: a value is not finite at t = {:.10g}{}: {}. The solution left the domain of a formula, or of its "
          "derivatives, or grew without bound; the record ends with the level before",
          problem_.scheme.location.file, simulation().t(), cause_of_undefined(), explained(error));
      go_back_to(steps);
      return;
    }
    writer().end_level();
    if (!std::isfinite(node.energy) || (simulation().has_gamma() && !std::isfinite(node.gamma))) {
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "{}: the node energy or Gamma is not finite at t = {:.10g}: the orbit left the domain of the formula{}",
          problem_.scheme.location.file, simulation().t(), cause_of_undefined());
      return;
    }
    if (writer().commit_due()) {
      commit();
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
    const Statistics& statistics = this->statistics();
    options_.progress(
        {.t = simulation().t(),
         .start = problem_.start(),
         .until = problem_.scheme.until,
         .h = report.h,
         .steps = statistics.steps,
         .bridges = statistics.bridges,
         .energy_deviation = statistics.relative_energy_deviation().value_or(statistics.energy_deviation())});
  }

  void add_warnings() {
    for (std::string& sentence : simulation().warnings()) {
      outcome_.warnings.push_back(std::move(sentence));
    }
    if (chronicle_->undefined_outputs() > 0) {
      outcome_.warnings.push_back(
          fmt::format("at {} of {} output times something is not defined: a formula of [output.quantities] left its "
                      "domain, or the step to that time could not be solved",
                      chronicle_->undefined_outputs(), chronicle_->outputs()));
    }
    const Statistics& statistics = outcome_.statistics;
    const Scheme& scheme = problem_.scheme;
    for (std::string& sentence : statistics.undefined_quantities()) {
      outcome_.warnings.push_back(std::move(sentence));
    }
    if (const int order = simulation().order();
        scheme.lagrangian == LagrangianName::generating && order != *scheme.order) {
      outcome_.warnings.push_back(
          fmt::format("order = {0} rounds up to {1}: with darboux = \"midpoint\" the even coefficients of the "
                      "generating function vanish, so that orders are even; write order = {1}",
                      *scheme.order, order));
    }
    if (statistics.bridge_steps > 0) {
      outcome_.warnings.push_back(about_bridges());
    }
    // What rounding leaves of energies that cancel is no measure of f', their terms are.
    if (const double part = statistics.potential.largest() / simulation().energy_terms(); part > large_potential) {
      outcome_.warnings.push_back(fmt::format(
          "the first step is too long for this orbit: to keep the energy law the step potential had to become "
          "{:.2g}, which is {:.2g} of what the energy is made of; take a smaller step",
          statistics.potential.largest(), part));
    }
    if (const std::optional<double> price = simulation().potential_price(); price && *price >= high_price) {
      const bool takes_scale = problem_.hamiltonian() != nullptr && !problem_.hamiltonian()->fictitious_time;
      outcome_.warnings.push_back(fmt::format(
          "the step potential holds all steps near those where the motion is fastest: at the start it takes about "
          "{:.2g} "
          "times as many as the law would without it; {}step_potential = \"none\" lets steps follow the motion, with "
          "bridges where the law has no solution",
          *price, takes_scale ? "hamiltonian.time_scale has as few, every one of them on the law; " : ""));
    }
    if (statistics.condition.any() && statistics.condition.max > condition_warning) {
      outcome_.warnings.push_back(
          fmt::format("the step condition reached {:.2g}: rounding in H moves the levels by that relative amount; "
                      "larger steps make it smaller",
                      statistics.condition.max));
    }
  }

  /// Why there were bridging steps, by what they show (BridgeCauses), and what to do.
  [[nodiscard]] std::string about_bridges() const {
    const Statistics& statistics = this->statistics();
    const std::string count = fmt::format("{} of {} steps", statistics.bridge_steps, statistics.steps);
    const HamiltonianProblem* orbit = problem_.hamiltonian();
    if (problem_.scheme.potential.kind != StepPotentialChoice::Kind::none) {
      const bool stated = problem_.scheme.potential.kind == StepPotentialChoice::Kind::given;
      return fmt::format(
          "on {} the level equation had no solution in spite of the step potential: {}; these steps are plain ones, "
          "off the law by up to {:.2g}{}; a smaller step or {} may mend it{}",
          count, stated ? "the one that is stated is too weak there" : "the orbit went beyond what that was chosen for",
          statistics.relative_bridge_deviation().value_or(statistics.bridge_deviation()),
          statistics.relative_bridge_deviation() ? " (relative)" : "",
          stated ? "a smaller kappa, or step_potential = \"auto\"," : "a smaller largest_step",
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
          count, causes().steps() == statistics.steps ? "not set yet" : "that of the first step that meets the law");
    }
    const std::string off = fmt::format(
        "{} bridge{} in {} steps, on which the discrete energy is off by up to {:.2g} "
        "(relative); {}",
        statistics.bridges, statistics.bridges == 1 ? "" : "s", statistics.steps,
        statistics.relative_bridge_deviation().value_or(statistics.bridge_deviation()),
        how_it_falls(problem_.scheme, chronicle_->simulation().order()));
    if (causes().crossings() == 0 && !nears_zero()) {
      return fmt::format("the step is too long for this orbit: {}; {}", too_long(), off);
    }
    const bool long_bridges = !causes().from_slopes() && statistics.bridge_steps > 2 * statistics.bridges;
    return fmt::format("{}: {}{}",
                       causes().crossings() > 0 ? told_of_gamma() + " changes sign on this orbit" : nearly_zero(), off,
                       long_bridges ? ". Here a bridge takes many steps, which smaller steps mend too" : "");
  }

  /// Γ, or what the slopes of steps have in its place.
  [[nodiscard]] std::string told_of_gamma() const {
    return causes().from_slopes() ? slope_name(chronicle_->simulation().order()) : "Gamma";
  }

  /// The smallest |Γ| of the run beside the largest.
  [[nodiscard]] bool nears_zero() const {
    constexpr double near = 0.02;
    const Spread& gamma = statistics().gamma;
    return gamma.any() &&
           (gamma.min * gamma.max <= 0.0 || std::min(std::abs(gamma.min), std::abs(gamma.max)) <
                                                near * std::max(std::abs(gamma.min), std::abs(gamma.max)));
  }
  [[nodiscard]] std::string nearly_zero() const {
    const Spread& gamma = statistics().gamma;
    return fmt::format("Gamma nears 0 on this orbit ({:.3g} to {:.3g})", gamma.min, gamma.max);
  }
  [[nodiscard]] std::string too_long() const {
    return fmt::format("{} goes from {:.4g} to {:.4g} in one step", told_of_gamma(), causes().gamma_before(),
                       causes().gamma_after());
  }

  const Problem& problem_;
  const RunOptions& options_;
  std::optional<LatticeLeader> leader_;  ///< before all that ranks have parts of
  std::optional<Chronicle> chronicle_;
  std::optional<Recorder> recorder_;
  const Clock::time_point begun_ = Clock::now();
  Clock::time_point last_progress_;
  Outcome outcome_;
};

}  // namespace

std::vector<std::string> Simulation::law_names() const {
  std::vector<std::string> names;
  std::ranges::transform(laws(), std::back_inserter(names), &Law::name);
  return names;
}

std::unique_ptr<Simulation> make_simulation(const Problem& problem, bool tangents) {
  if (problem.hamiltonian() == nullptr) {
    return make_lattice_simulation(problem, tangents);
  }
  if (tangents) {
    throw ProblemError(problem.hamiltonian()->statement().location,
                       "tangent solutions are carried along a lattice only: leave out --tangents for an orbit");
  }
  return make_orbit_simulation(problem);
}

Outcome run(const Problem& problem, const RunOptions& options) {
  refuse_unshared(problem, options);
  if (const auto* pde = problem.multisymplectic(); pde != nullptr && pde->initial_record) {
    std::error_code ignored;
    if (std::filesystem::equivalent(pde->initial_record->file, options.output.value_or(problem.output.file), ignored)) {
      throw ProblemError(pde->initial_record->location,
                         "the run would replace the record that it begins from; name another with output.file or -o");
    }
  }
  return Driver(problem, options, options.output.value_or(problem.output.file)).start();
}

Outcome resume(const std::string& file, std::optional<double> until, const RunOptions& options) {
  record::Claim claim(file);  // before anything is read: a run that is just ending would change it
  Problem problem;
  RunOptions as_begun = options;
  {
    const record::Reader reader(file);
    as_begun.tangents = reader.has("/laws/multisymplectic_max");
    problem = stored_problem(reader);
  }
  if (until) {
    const std::vector<std::string> settings = {fmt::format("scheme.until={:.17g}", *until)};
    problem = parse_stored(problem.text, file, settings);
  }
  refuse_unshared(problem, as_begun);
  use_threads(options.threads);
  return blame_record(file, [&] { return Driver(problem, as_begun, file).resume(std::move(claim)); });
}

}  // namespace rubato
