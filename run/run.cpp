#include <rubato/run/run.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <memory>

#include <fmt/format.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/base/memory.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/record/no_memory.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/record/run_shape.hpp>
#include <rubato/record/writer.hpp>
#include <rubato/run/gathering_sink.hpp>
#include <rubato/run/lattice_ranks.hpp>
#include <rubato/run/memory_record.hpp>
#include <rubato/run/no_sink.hpp>
#include <rubato/run/pace.hpp>
#include <rubato/run/record_scales.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/run_estimate.hpp>
#include <rubato/run/shared_rows.hpp>
#include <rubato/run/solve.hpp>
#include <rubato/run/threads.hpp>
#include <rubato/run/warnings.hpp>

namespace rubato {

namespace {

using Clock = std::chrono::steady_clock;

std::string about_lost(const figures::Judgement& judgement) {
  return fmt::format("the run reached its end, but its result is {}", figures::text_of(judgement));
}

/// A run under way: the simulation, what is known of it so far, and its record.
class Driver {
public:
  /// \param memory takes the rows in place of a record in `file`; null where there is a file
  Driver(const Problem& problem, const RunOptions& options, std::string file, MemoryRecord* memory = nullptr)
      : problem_(problem), options_(options), memory_(memory), threads_(options.threads, problem) {
    if (options.ranks != nullptr && options.ranks->size() > 1) {
      leader_.emplace(*options.ranks, problem, options.threads, options.tangents);
    }
    require_memory_for(problem, options, 1.0 / (options.ranks == nullptr ? 1 : options.ranks->size()));
    make_observed_run();
    outcome_.title = problem.title;
    outcome_.file = std::move(file);
    outcome_.variable_levels = problem.scheme.levels == Levels::variable;
    if (const auto* lattice = std::get_if<MultisymplecticProblem>(&problem.system)) {
      outcome_.axes = lattice->axes.size();
    }
  }

  /// \param scales further ones of the record
  Outcome start(std::vector<record::Scale> scales = {}, const HalvedMeasure& halved = {}) {
    const Storing storing(options_.storing);
    observed_->meter().set_halved(halved.relative, halved.t);
    if (memory_ != nullptr) {
      require_room();
      memory_->begin(observed_->layout());
    } else {
      about_disk_ = require_disk_for(problem_, outcome_.file, expected_record_bytes(*observed_));
      recorder_.emplace(record::Writer::create(outcome_.file, layout_of_record(std::move(scales)), options_.overwrite,
                                               commit_policy()));
    }
    try {
      order(Order::start);
      write(rows(), [this](RowSink& sink) { observed_->append_start(sink); });
    } catch (const record::NotFinite& error) {
      return undefined_at_start(error);
    }
    end_level();
    if (recorder_ && (leader_ || Clock::now() - begun_ >= short_run)) {
      commit();
    }
    return loop();
  }

  /// Nobody else can have written the record since it was claimed: the problem that this driver was made for, the
  /// checkpoint and the rows are of one version.
  Outcome resume(record::Claim claim) {
    const Storing storing(options_.storing);
    auto continued = record::Writer::resume(std::move(claim), observed_->layout(), commit_policy(), state_apart());
    restore(continued.take_checkpoint());
    recorder_.emplace(std::move(continued));
    const bool stopped = observed_->stopped(), at_end = simulation().finished() && !stopped;
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

  [[nodiscard]] Simulation& simulation() { return observed_->simulation(); }
  [[nodiscard]] const Statistics& statistics() const { return observed_->statistics(); }
  [[nodiscard]] const OffLawCauses& causes() const { return observed_->causes(); }
  [[nodiscard]] record::Writer& writer() { return recorder_->writer(); }
  /// Takes the rows of the run.
  [[nodiscard]] RowSink& rows() { return memory_ != nullptr ? static_cast<RowSink&>(*memory_) : *recorder_; }
  void end_level() {
    if (memory_ != nullptr) {
      memory_->end_level();
    } else if (recorder_->take_appended()) {
      writer().end_level();
    }
  }
  [[nodiscard]] bool published() { return recorder_ && writer().published(); }
  /// It goes into the file as it is made, of other ranks as their parts come.
  [[nodiscard]] record::CheckpointInParts checkpoint(std::function<figures::Measures()> measures) const {
    return make_checkpoint(
        *observed_, [this] { order(Order::save); }, std::move(measures));
  }
  void commit() {
    writer().commit(checkpoint([this] { return observed_->meter().measures(); }));
  }

  /// What all ranks do together, where there are others.
  void order(Order order) const {
    if (leader_) {
      leader_->order(order);
    }
  }
  void make_observed_run() {
    order(Order::make);
    observed_.emplace(problem_, options_.tangents);
  }
  /// Lets `append` have a sink whose rows go to `sink`.
  template <typename Append>
  void write(RowSink& sink, const Append& append) {
    if (leader_) {
      GatheringSink gathering(leader_->slab(), observed_->layout(), &sink);
      append(gathering);
      gathering.finish();
      gathering.rethrow();
    } else {
      append(sink);
    }
  }

  /// \throws ProblemError if the rows of a run in memory certainly do not fit there
  void require_room() const {
    constexpr double little = 1e8;  // there is as much, and to look takes time
    if (const auto bytes = record::expected_bytes(observed_->layout());
        bytes && *bytes > little && stores_as_expected(problem_)) {
      try {
        require_memory(*bytes, "the rows of the run");
      } catch (const std::invalid_argument& error) {
        throw ProblemError(problem_.output.location,
                           fmt::format("{}; store less (output.every), or in a file", error.what()));
      }
    }
  }

  /// Ranks write long rows of nodes together.
  [[nodiscard]] record::Layout layout_of_record(std::vector<record::Scale> scales) const {
    record::Layout layout = observed_->layout();
    std::ranges::move(scales, std::back_inserter(layout.scales));
    for (record::Dataset& dataset : layout.datasets) {
      dataset.together = leader_ && has_nodes(dataset);
    }
    return layout;
  }

  /// Of a shared lattice no more rows wait in memory than this rank's part of a field takes, or a megabyte.
  [[nodiscard]] record::CommitPolicy commit_policy() const {
    record::CommitPolicy policy{.interval = options_.commit_interval,
                                .durable = problem_.output.durable,
                                .first = short_run,
                                .locking = locking_of(options_)};
    if (leader_) {
      policy.buffer_bytes =
          std::clamp(leader_->slab().owned() * sizeof(double), std::size_t{1} << 20, policy.buffer_bytes);
    }
    return policy;
  }

  /// The array that is left out of checkpoints as they are read, where ranks share it and none has room for all of it.
  [[nodiscard]] const char* state_apart() const { return leader_ ? "state" : ""; }

  /// \param checkpoint that of the record, but for state_apart()
  void restore(const record::Checkpoint& checkpoint) {
    bool restored = false;
    if (leader_) {
      const record::Reader record(outcome_.file);
      if (record.has(shared_state)) {
        const std::size_t size = record.rows(shared_state);
        leader_->order_restore(size);
        SharedState source(leader_->slab(), &record);
        StateReader state(source, size);
        restored = rubato::restore(checkpoint, state, *observed_);
        source.rethrow();
      }
    } else {
      restored = rubato::restore(checkpoint, *observed_);
    }
    if (!restored) {
      throw record::Error(outcome_.file, "its checkpoint is not that of its problem: the run cannot be continued");
    }
  }

  /// Where a level begins that cannot be stored, the run ends with the one before it: the simulation is taken back to
  /// the last checkpoint published, or its start, and repeats the steps since then, so that what is stored last is a
  /// state of the record.
  void go_back_to(std::size_t steps) {
    const Interruptible to_the_end(nullptr);
    memory_ != nullptr ? memory_->drop_level() : writer().drop_level();
    make_observed_run();
    NoSink sink;
    if (published()) {
      restore(record::Reader(outcome_.file).checkpoint(state_apart()));
    } else {
      order(Order::start);
      write(sink, [this](RowSink& rows) { observed_->append_start(rows); });
    }
    while (statistics().steps < steps) {
      order(Order::step);
      observed_->take(steps - statistics().steps);
      if (simulation().taken().empty()) {
        throw std::logic_error("a step that was taken before cannot be repeated");
      }
      write(sink, [this](RowSink& rows) { observed_->append_steps(rows); });
    }
  }

  [[nodiscard]] std::string cause_of_undefined() {
    const std::string reason = simulation().integrator().failure_reason();
    return reason.empty() ? "" : fmt::format(" ({})", reason);
  }

  Outcome undefined_at_start(const record::NotFinite& error) {
    recorder_.reset();  // nothing was written
    if (memory_ != nullptr) {
      memory_->drop_level();
    }
    const auto* orbit = problem_.hamiltonian();
    const Location& place = orbit != nullptr ? orbit->initial.location : problem_.multisymplectic()->initial_location;
    outcome_.status = ExitStatus::failed;
    outcome_.message = fmt::format(
        "{}: a value is not finite at the start, t = {:.10g}{}: {}. A formula, or a derivative of it, is not defined "
        "there: start elsewhere. Nothing was written",
        place.text(), simulation().t(), cause_of_undefined(), explained(error));
    outcome_.file.clear();
    judge_early_end();
    return std::move(outcome_);
  }

  /// By nothing but that it failed.
  void judge_early_end() {
    outcome_.statistics.measures.end = simulation().t();
    outcome_.statistics.measures.end_wanted = problem_.scheme.until;
    outcome_.judgement = figures::judge(outcome_.statistics);
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
    if (!about_disk_.empty()) {
      outcome_.warnings.push_back(about_disk_);
    }
    for (const std::string& sentence : outcome_.warnings) {
      if (options_.caution) {
        options_.caution(sentence);
      }
    }
    while (outcome_.status == ExitStatus::done && !simulation().finished() && !observed_->stopped()) {
      try {
        next_steps();
      } catch (const std::bad_alloc&) {
        if (leader_) {
          throw;
        }
        return out_of_memory();
      } catch (const record::NoMemory&) {
        if (leader_) {
          throw;
        }
        return out_of_memory();
      }
    }
    outcome_.complete = outcome_.status == ExitStatus::done;
    if (has_failed(outcome_.status)) {
      observed_->meter().end_early(simulation().t(), problem_.scheme.until);
    }
    finish();
    order(Order::finish);
    outcome_.statistics = observed_->final_statistics();
    if (leader_) {
      outcome_.statistics.measures = observed_->meter().measures();
    }
    outcome_.judgement = figures::judge(outcome_.statistics);
    if (outcome_.complete && outcome_.judgement.verdict == figures::Verdict::lost) {
      outcome_.status = ExitStatus::lost;
      outcome_.message = about_lost(outcome_.judgement);
    }
    outcome_.wall_seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    for (std::string& sentence : warnings_of(problem_, *observed_, outcome_.statistics)) {
      outcome_.warnings.push_back(std::move(sentence));
    }
    outcome_.step_potential = simulation().step_potential();
    outcome_.order = simulation().order();
    return std::move(outcome_);
  }

  /// The record stays as it was committed last.
  Outcome out_of_memory() {
    reserve_ = {};
    outcome_.status = ExitStatus::failed;
    outcome_.message = fmt::format("{}: not enough memory after t = {:.10g}, where the process held {:.3g} GB; ",
                                   problem_.scheme.location.file, simulation().t(), peak_memory() * 1e-9);
    if (memory_ != nullptr) {
      memory_->drop_level();
      outcome_.message += "levels up to there are kept";
    } else if (published()) {
      outcome_.message +=
          fmt::format("the record is whole up to its last commit: continue with `rubato resume {}`", outcome_.file);
    } else {
      outcome_.message += "nothing was written: take fewer cells";
      outcome_.file.clear();
    }
    outcome_.statistics = statistics();  // the final ones take memory to compute
    judge_early_end();
    return std::move(outcome_);
  }

  void finish() {
    if (memory_ != nullptr) {
      observed_->append_last(*memory_);
      memory_->end_level();
      return;
    }
    // Ranks keep the measures of the last level in the sample.
    writer().stage(
        checkpoint([this] { return leader_ ? observed_->meter().measures() : observed_->final_measures(); }));
    // The last state is always stored. Where it is not one of every n-th it is provisional: `resume` drops it again, so
    // that a run continued is the same as one never stopped.
    order(Order::last);
    write(*recorder_, [this](RowSink& sink) { observed_->append_last(sink); });
    writer().finish(outcome_.complete ? record::Writer::Completion::complete : record::Writer::Completion::interrupted);
  }

  void interrupted() {
    outcome_.status = ExitStatus::interrupted;
    outcome_.message = fmt::format("interrupted at t = {:.10g}; ", simulation().clock());
    outcome_.message +=
        memory_ != nullptr
            ? "levels up to there are kept"
            : fmt::format("the record is whole up to there: continue with `rubato resume {}`", outcome_.file);
  }

  void next_steps() {
    if (options_.interrupt != nullptr && options_.interrupt->load()) {
      interrupted();
      return;
    }
    const std::size_t steps = statistics().steps, most = static_cast<std::size_t>(problem_.scheme.max_steps);
    if (steps >= most) {
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "max_steps = {} reached at t = {:.10g}, before until = {:.10g}: raise scheme.max_steps, or take a larger "
          "step",
          problem_.scheme.max_steps, simulation().t(), problem_.scheme.until);
      return;
    }
    const std::size_t last = std::min(most, steps + pace_.steps());
    const Interruptible here(leader_ ? nullptr : options_.interrupt);  // ranks look ahead together, to the end
    do {
      order(Order::step);
      const StepReport& report = observed_->take(last - statistics().steps);
      if (!simulation().taken().empty() && !append_steps()) {
        return;
      }
      if (simulation().interrupted()) {
        interrupted();
        return;
      }
      if (report.status != Status::success) {
        const bool singular = report.status == Status::singular || report.status == Status::ill_conditioned;
        outcome_.status = singular ? ExitStatus::singular : ExitStatus::failed;
        outcome_.message = simulation().integrator().explain(report);
        return;
      }
    } while (statistics().steps < last && !simulation().finished() && !observed_->stopped() && !Interruptible::asked());
    pace_.look();
    if (recorder_ && writer().commit_due()) {
      commit();
    }
    show_progress(simulation().report());
  }

  /// Stores the steps taken. \return whether the run goes on
  bool append_steps() {
    const std::size_t steps = statistics().steps, count = simulation().taken().size();
    try {
      write(rows(), [this](RowSink& sink) { observed_->append_steps(sink); });
    } catch (const record::NotFinite& error) {
      if (count > 1) {  // which of them it is shows one by one
        pace_.keep_to_one();
        go_back_to(steps);
        return false;
      }
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "{}: a value is not finite at t = {:.10g}{}: {}. The solution left the domain of a formula, or of its "
          "derivatives, or grew without bound; the record ends with the level before",
          problem_.scheme.location.file, simulation().t(), cause_of_undefined(), explained(error));
      go_back_to(steps);
      return false;
    }
    end_level();
    if (!simulation().is_defined()) {
      outcome_.status = ExitStatus::failed;
      outcome_.message = fmt::format(
          "{}: the node energy or Gamma is not finite at t = {:.10g}: the orbit left the domain of the formula{}",
          problem_.scheme.location.file, simulation().t(), cause_of_undefined());
      return false;
    }
    return true;
  }

  void show_progress(const StepReport& report) {
    if (!options_.progress) {
      return;
    }
    const auto now = Clock::now();
    if (now - last_progress_ < options_.progress_interval) {
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
         .off_law = statistics.off_law_steps,
         .energy_deviation = statistics.relative_energy_deviation().value_or(statistics.energy_deviation())});
  }

  const Problem& problem_;
  const RunOptions& options_;
  MemoryRecord* const memory_;
  const ThreadCount threads_;            ///< before what allocates work space for each
  std::optional<LatticeLeader> leader_;  ///< before all that ranks have parts of
  std::optional<ObservedRun> observed_;
  std::optional<Recorder> recorder_;
  const Clock::time_point begun_ = Clock::now();
  Clock::time_point last_progress_;
  Pace pace_{options_.progress_interval};
  Outcome outcome_;
  std::string about_disk_;  ///< a warning; empty for none
  /// Memory for the report that memory ran out. Blocks of this size come from the heap, which keeps them when they are
  /// freed: larger ones go back to the system, which may give nothing any more.
  std::unique_ptr<char[]> reserve_ = std::make_unique<char[]>(std::size_t{96} << 10);
};

}  // namespace

const StepReport& Simulation::take(std::size_t most) {
  const bool needs_gamma = has_gamma();
  taken_.clear();
  is_defined_ = true;
  interrupted_ = false;
  most = std::min(most, levels_kept());
  try {
    while (taken_.size() < most && is_defined_ && (taken_.empty() || !(finished() || Interruptible::asked()))) {
      const StepReport report = step(taken_.size());
      if (report.status != Status::success) {
        return report_ = report;
      }
      const NodeEnergy now = node();
      taken_.push_back({report, energy_rounding(), {.t = t(), .node_energy = now.energy, .gamma = now.gamma}});
      is_defined_ = std::isfinite(now.energy) && (!needs_gamma || std::isfinite(now.gamma));
    }
    report_ = taken_.back().report;
  } catch (const Interrupted&) {
    interrupted_ = true;
  }
  return report_;
}

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
  return run_with_scales(problem, options, {});
}

Outcome run_with_scales(const Problem& problem, const RunOptions& options, std::vector<record::Scale> scales,
                        const HalvedMeasure& halved) {
  refuse_unshared(problem, options);
  if (const auto* pde = problem.multisymplectic(); pde != nullptr && pde->initial_record) {
    std::error_code ignored;
    if (std::filesystem::equivalent(pde->initial_record->file, options.output.value_or(problem.output.file), ignored)) {
      throw ProblemError(pde->initial_record->location,
                         "the run would replace the record that it begins from; name another with output.file or -o");
    }
  }
  return Driver(problem, options, options.output.value_or(problem.output.file)).start(std::move(scales), halved);
}

Outcome run(const Problem& problem, MemoryRecord& record, const RunOptions& options) {
  refuse_unshared(problem, options);
  return Driver(problem, options, {}, &record).start();
}

Outcome resume(const std::string& file, std::optional<double> until, const RunOptions& options) {
  record::Claim claim(file, locking_of(options));  // before anything is read: a run that is just ending would change it
  Problem problem;
  RunOptions as_begun = options;
  std::vector<std::string> settings;
  {
    const record::Reader reader(file);
    if (is_solution(reader)) {
      throw record::Error(file,
                          "it is the solution of a boundary-value problem, which does not go on; to integrate from "
                          "one of its states, run a problem with [initial] from");
    }
    as_begun.tangents = reader.has("/laws/multisymplectic_max");
    problem = stored_problem(reader);
    record::refuse_earlier_version(reader);
    if (problem.levels.every != problem.output.every && !figures::stored_last_level(reader)) {
      settings.push_back(fmt::format("levels.every={}", problem.levels.every));  // as the version that wrote it
    }
    if (until) {
      settings.push_back(fmt::format("scheme.until={:.17g}", *until));
    }
    if (!settings.empty()) {
      problem = parse_stored(problem.text, file, settings);
      keep_to_version_of(reader, problem);
    }
  }
  refuse_unshared(problem, as_begun);
  return blame_record(file, [&] { return Driver(problem, as_begun, file).resume(std::move(claim)); });
}

}  // namespace rubato
