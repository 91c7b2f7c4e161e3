#include <rubato/run/ensemble.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <mutex>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <omp.h>

#include <rubato/figures/members.hpp>
#include <rubato/problem/document.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/record/run_shape.hpp>
#include <rubato/record/writer.hpp>
#include <rubato/run/ensemble_lanes.hpp>
#include <rubato/run/ensemble_member.hpp>
#include <rubato/run/ensemble_ranks.hpp>
#include <rubato/run/observed_run.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/run_estimate.hpp>
#include <rubato/run/threads.hpp>
#include <rubato/run/version.hpp>

namespace rubato {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// The value of an entry as a number; of one that is none, its place among those that the members have.
class EntryColumn {
public:
  EntryColumn(const Ensemble& ensemble, std::size_t entry) {
    for (const auto& member : ensemble.values) {
      const std::string& text = member[entry];
      if (const auto plain = plain_number(text)) {
        numbers_.push_back(*plain);
        continue;
      }
      double number = nan;
      try {
        const Value root = read_document("value = " + text, "");
        number = read_number(root.table()->front().value, "an entry", {});  // what parameters are, members decide
      } catch (const ProblemError&) {
        is_number_ = false;
      }
      numbers_.push_back(number);
    }
    if (!is_number_) {
      number_words(ensemble, entry);
    }
  }
  [[nodiscard]] double at(std::size_t member) const { return numbers_[member]; }
  [[nodiscard]] std::string description(const std::string& path) const {
    return is_number_ ? path : fmt::format("{}: the place, from 0, among {}", path, fmt::join(words_, ", "));
  }

private:
  /// In the order in which members bring them.
  void number_words(const Ensemble& ensemble, std::size_t entry) {
    std::map<std::string_view, std::size_t> places;
    for (std::size_t m = 0; m < numbers_.size(); ++m) {
      const std::string& text = ensemble.values[m][entry];
      const auto [place, is_new] = places.emplace(text, words_.size());
      if (is_new) {
        words_.push_back(text);
      }
      numbers_[m] = static_cast<double>(place->second);
    }
  }

  bool is_number_ = true;
  std::vector<double> numbers_;
  std::vector<std::string> words_;
};

constexpr const char* verdicts_path = "/members/verdict";  ///< records of earlier versions have none
constexpr const char* findings_array = "findings";         ///< of the checkpoint

/// The members of a problem, and their record.
class EnsembleDriver final : private MemberDesk {
public:
  /// \param continued the record to go on with, or to check
  EnsembleDriver(const Problem& problem, const RunOptions& options, std::string file,
                 const record::Reader* continued = nullptr)
      : problem_(problem),
        ensemble_(*problem.ensemble),
        options_(options),
        threads_(options.threads),
        keeps_verdicts_(continued == nullptr || continued->has(verdicts_path)) {
    outcome_.title = problem.title;
    outcome_.file = std::move(file);
    outcome_.members = ensemble_.members();
    outcome_.paths = ensemble_.paths;
    outcome_.values = ensemble_.values;
    // All are read before anything is written; what only the run of one shows ends that one.
    keeps_states_ = keeps_series_ = true;
    const std::size_t read =
        differ_in_starts_alone(problem) ? std::min<std::size_t>(1, ensemble_.members()) : ensemble_.members();
    for (std::size_t m = 0; m < read; ++m) {
      const Problem member = member_problem(problem, m);
      if (m == 0) {
        require_memory_for(member, {.threads = 1},
                           static_cast<double>(std::min<std::size_t>(static_cast<std::size_t>(omp_get_max_threads()),
                                                                     ensemble_.members())));
        names_ = figure_names(member);
        first_ = shape_of(member);
        first_events_ = events_of(member);
        states_ = states_of(member);
      }
      keeps_states_ = keeps_states_ && shape_of(member) == first_;
      keeps_series_ = keeps_series_ && events_of(member) == first_events_;
    }
    for (std::size_t i = 0; i < ensemble_.paths.size(); ++i) {
      columns_.emplace_back(ensemble_, i);
    }
    for (const std::string& name : names_) {
      outcome_.summary.push_back({.name = name});
    }
    make_layout();
  }

  EnsembleOutcome start() {
    recorder_.emplace(record::Writer::create(outcome_.file, layout_, options_.overwrite, policy()));
    return loop();
  }

  EnsembleOutcome resume(record::Claim claim) {
    auto writer = record::Writer::resume(std::move(claim), layout_, policy());
    const record::Reader reader(outcome_.file);
    take_stored(reader);
    recorder_.emplace(std::move(writer));
    return loop();
  }

  EnsembleOutcome check(const record::Reader& reader) {
    stored_ = reader.rows("/members/number");
    if (record::is_of_earlier_version(reader)) {
      outcome_.finished = stored_;
      outcome_.message = "an earlier version wrote it: its members were not run again, its checksums were compared";
      return altered_or(std::move(outcome_), reader);
    }
    compared_with_ = &reader;
    finished_only_ = stored_;
    EnsembleOutcome outcome = loop();
    outcome.compared = compared_;
    for (std::size_t i = 0; i < rows_.size() && outcome.status != ExitStatus::contradiction; ++i) {
      const std::string& path = layout_.datasets[i].path;
      if (rows_[i] < reader.rows(path)) {
        outcome.status = ExitStatus::contradiction;
        outcome.message = fmt::format("{} contradicts itself: {} has {} rows, and runs of the members give {}",
                                      outcome.file, path, reader.rows(path), rows_[i]);
      }
    }
    return altered_or(std::move(outcome), reader);
  }

private:
  using Clock = std::chrono::steady_clock;

  /// The outcome of a check, unless a checksum contradicts it.
  [[nodiscard]] static EnsembleOutcome altered_or(EnsembleOutcome outcome, const record::Reader& reader) {
    if (const auto altered = reader.altered(); outcome.status != ExitStatus::contradiction && !altered.empty()) {
      outcome.status = ExitStatus::contradiction;
      outcome.message = fmt::format("{} contradicts itself: {} is not what was written, by its checksum in the record",
                                    outcome.file, altered.front());
    }
    return outcome;
  }

  [[nodiscard]] record::CommitPolicy policy() const {
    return {.durable = problem_.output.durable, .locking = locking_of(options_)};
  }

  /// What has to be the same for states of different members to be rows of one dataset.
  [[nodiscard]] static std::vector<std::int64_t> shape_of(const Problem& problem) {
    if (const HamiltonianProblem* orbit = problem.hamiltonian()) {
      return {static_cast<std::int64_t>(orbit->q.size())};
    }
    std::vector<std::int64_t> shape;
    for (const GridAxis& axis : problem.multisymplectic()->axes) {
      shape.push_back(axis.nodes());
    }
    return shape;
  }
  /// The same of their crossings, beside the shape of states.
  [[nodiscard]] static std::vector<std::string> events_of(const Problem& problem) {
    std::vector<std::string> names;
    for (const StatedEvent& event : problem.events) {
      names.push_back(event.name);
      names.emplace_back(event.stop_after > 0 ? "stops" : "");
      for (const OutputQuantity& quantity : event.quantities) {
        names.push_back(quantity.name);
      }
    }
    return names;
  }
  /// What is kept of a member: its last state, its crossings, what is reported at output times.
  [[nodiscard]] static record::Layout states_of(const Problem& problem) {
    const ObservedRun observed(problem, false);
    record::Layout states;
    states.scales = observed.layout().scales;
    std::ranges::copy_if(observed.layout().datasets, std::back_inserter(states.datasets), is_last_state);
    std::ranges::copy_if(observed.layout().datasets, std::back_inserter(states.datasets), is_kept_whole);
    return states;
  }

  void make_layout() {
    const std::string axis = "/members/number";
    layout_.title = problem_.title;
    layout_.problem = problem_.text;
    layout_.version = std::string(version());
    layout_.compiler = std::string(compiler());
    layout_.threads = omp_get_max_threads();
    layout_.compression = problem_.output.compression;
    layout_.datasets = {
        {axis, axis, {}, record::Type::i64, "number of the member"},
        {"/members/status", axis, {}, record::Type::i32, "how it ended: 0 complete, or an exit status"}};
    if (keeps_verdicts_) {
      layout_.datasets.push_back({verdicts_path, axis, {}, record::Type::i32, "verdict: 0 good, 1 doubtful, 2 lost"});
    }
    for (std::size_t i = 0; i < ensemble_.paths.size(); ++i) {
      layout_.datasets.push_back({"/members/values/" + ensemble_.paths[i],
                                  axis,
                                  {},
                                  record::Type::f64,
                                  columns_[i].description(ensemble_.paths[i])});
    }
    for (const std::string& name : names_) {
      layout_.datasets.push_back(
          {"/members/" + name, axis, {}, record::Type::f64, "figure of the member, as a run of it reports", true});
    }
    if (keeps_states_) {
      layout_.scales = states_.scales;
      for (const record::Dataset& state : states_.datasets) {
        if (!is_last_state(state)) {
          continue;
        }
        record::Dataset& last = layout_.datasets.emplace_back(state);
        last.path = "/members/last/" + state.path.substr(std::string_view("/states/").size());
        last.axis = axis;
        last.description = fmt::format("{} at the last level of the member", state.description);
        last.may_be_undefined = true;
      }
    }
    for (record::Dataset& dataset : layout_.datasets) {
      dataset.expected_rows = ensemble_.members();
    }
    if (keeps_series_) {
      add_series();
    }
    rows_.assign(layout_.datasets.size(), 0);
  }

  /// Of every event the crossings of all members, one after the other, each with the number of its member; and so what
  /// is reported at output times. Fields of members that have grids of their own are left out.
  void add_series() {
    for (const record::Dataset& dataset : states_.datasets) {
      if (!is_kept_whole(dataset)) {
        continue;
      }
      if (!keeps_states_ && !dataset.dimensions.empty()) {
        series_.push_back(left_out);
        continue;
      }
      series_.push_back(layout_.datasets.size());
      layout_.datasets.push_back(dataset);
      layout_.datasets.back().may_be_undefined = true;
      layout_.datasets.back().expected_rows = std::nullopt;
      if (dataset.path == dataset.axis) {
        members_of_.push_back(layout_.datasets.size());
        layout_.datasets.push_back({dataset.axis.substr(0, dataset.axis.size() - 1) + "member",
                                    dataset.axis,
                                    {},
                                    record::Type::i64,
                                    "number of the member"});
      }
    }
  }

  void append_series(const std::vector<std::vector<double>>& series) {
    auto members = members_of_.begin();
    for (std::size_t i = 0; i < series_.size(); ++i) {
      if (series_[i] == left_out) {
        continue;
      }
      const record::Dataset& dataset = layout_.datasets[series_[i]];
      const std::size_t size = record::row_size(layout_, dataset);
      for (std::size_t at = 0; at < series[i].size(); at += size) {
        append(series_[i], std::span<const double>(series[i]).subspan(at, size));
        if (dataset.path == dataset.axis) {
          append(*members, static_cast<double>(written_));
        }
      }
      members += dataset.path == dataset.axis ? 1 : 0;
    }
  }

  // ---- running ------------------------------------------------------------------------------------------------------

  EnsembleOutcome loop() {
    const Storing storing(options_.storing);
    const auto begin = Clock::now();
    show_progress();
    next_ = written_;
    if (recorder_ && written_ == 0) {
      recorder_->writer().commit(checkpoint());
    }
    end_ = finished_only_.value_or(ensemble_.members());
    {
      const OtherRanks others(options_.ranks, {.problem = problem_, .figures = names_, .threads = options_.threads},
                              *this);
      run_members(problem_, names_, *this);
    }
    if (error_) {
      std::rethrow_exception(error_);
    }
    const bool complete = written_ == ensemble_.members();
    if (recorder_) {
      recorder_->writer().finish(
          checkpoint(), complete ? record::Writer::Completion::complete : record::Writer::Completion::interrupted);
    }
    if (!complete && compared_with_ == nullptr) {
      outcome_.status = ExitStatus::interrupted;
      outcome_.message = fmt::format("interrupted after {} of {} members; continue with `rubato resume {}`", written_,
                                     ensemble_.members(), outcome_.file);
    }
    if (complete && compared_with_ == nullptr && outcome_.findings.all_lost()) {
      outcome_.status = ExitStatus::lost;
      outcome_.message = fmt::format("{}{}every member that reached its end is lost: {}", outcome_.message,
                                     outcome_.message.empty() ? "" : "; ", outcome_.findings.verdict_text("members"));
    }
    outcome_.finished = written_;
    summarise();
    outcome_.wall_seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    return std::move(outcome_);
  }

  [[nodiscard]] std::optional<std::size_t> next() override {
    const std::scoped_lock lock(mutex_);
    if (halted() || next_ >= end_) {
      return std::nullopt;
    }
    return next_++;
  }
  void hand_in(std::size_t member, MemberResult result) override {
    const std::scoped_lock lock(mutex_);
    if (!error_) {
      waiting_.emplace(member, std::move(result));
      publish();
    }
  }
  /// The first error is that of the whole.
  void fail(std::exception_ptr error) override {
    const std::scoped_lock lock(mutex_);
    error_ = error_ ? error_ : std::move(error);
    halted_ = true;
  }
  void halt() override { halted_ = true; }
  [[nodiscard]] bool halted() const override {
    return halted_.load() || (options_.interrupt != nullptr && options_.interrupt->load());
  }
  [[nodiscard]] const std::atomic<bool>* interrupt() const override { return options_.interrupt; }

  /// What is finished goes into the record in the order of the members.
  void publish() {
    for (auto first = waiting_.begin(); first != waiting_.end() && first->first == written_; first = waiting_.begin()) {
      take(first->second);
      waiting_.erase(first);
    }
    if (recorder_ && recorder_->writer().commit_due()) {
      recorder_->writer().commit(checkpoint());
    }
    show_progress();
  }

  void take(MemberResult& result) {
    const std::size_t member = written_;
    std::size_t next = 0;
    append(next++, static_cast<double>(member));
    append(next++, static_cast<double>(result.status));
    if (keeps_verdicts_) {
      append(next++, static_cast<double>(result.judgement.verdict));
    }
    for (const EntryColumn& column : columns_) {
      append(next++, column.at(member));
    }
    for (const double figure : result.figures) {
      append(next++, figure);
    }
    if (keeps_states_) {
      for (const std::vector<double>& state : result.states) {
        append(next++, std::span<const double>(state));
      }
    }
    append_series(result.series);
    if (recorder_) {
      recorder_->writer().end_level();
    }
    if (std::ranges::find(series_, left_out) != series_.end()) {
      result.warnings.emplace_back(
          "members have different grids, so that their fields at output times are not stored: run one alone for them, "
          "or report quantities, which are");
    }
    outcome_.findings.add(member, "", result.warnings, result.judgement,
                          is_end(result.status) ? RunEnd::complete : RunEnd::failed);
    write(result.status, result.message, std::move(result.figures));
  }
  /// Whether a run with this status reached its end.
  [[nodiscard]] static bool is_end(ExitStatus status) {
    return status == ExitStatus::done || status == ExitStatus::lost;
  }

  /// Into the record, or compared with it.
  void append(std::size_t dataset, double value) { append(dataset, std::span<const double>(&value, 1)); }
  void append(std::size_t dataset, std::span<const double> row) {
    const record::Dataset& description = layout_.datasets[dataset];
    if (recorder_) {
      if (description.type == record::Type::f64) {
        recorder_->append(record::Column{dataset}, row);
      } else {
        recorder_->append(record::Column{dataset}, static_cast<std::int64_t>(row.front()));
      }
      return;
    }
    const std::size_t number = rows_[dataset]++;
    if (number >= compared_with_->rows(description.path)) {
      contradict(fmt::format("{} has no row {}, and a run of member {} gives one", description.path, number, written_));
      return;
    }
    const std::vector<double> stored = compared_with_->read(description.path, number, 1);
    const bool same = std::ranges::equal(stored, row, [](double a, double b) { return a == b || (a != a && b != b); });
    compared_ += row.size();
    if (!same) {
      contradict(fmt::format("{} of member {} is not what a run of it gives", description.path, written_));
    }
  }
  void contradict(const std::string& reason) {
    if (outcome_.status != ExitStatus::contradiction) {
      outcome_.status = ExitStatus::contradiction;
      outcome_.message = fmt::format("{} contradicts itself: {}", outcome_.file, reason);
    }
  }

  void write(ExitStatus status, const std::string& message, std::vector<double> figures) {
    const std::size_t member = written_++;
    outcome_.figures.push_back(std::move(figures));
    outcome_.statuses.push_back(status);
    // The gravest of the members is that of the ensemble; only a contradiction, of the record itself, is graver.
    if (compared_with_ == nullptr && !is_end(status) && status > outcome_.status) {
      outcome_.status = status;
    }
    if (!is_end(status)) {
      if (failed_++ == 0) {
        first_failure_ =
            message.empty() ? "" : fmt::format("member {} ({}): {}", member, ensemble_.described(member), message);
      }
    }
    if (failed_ > 0 && compared_with_ == nullptr) {
      outcome_.message = fmt::format("{} of {} members ended early{}{}", failed_, written_,
                                     first_failure_.empty() ? "" : "; the first: ", first_failure_);
    }
  }

  void summarise() {
    for (std::size_t i = 0; i < outcome_.summary.size(); ++i) {
      std::vector<double> column;
      for (const std::vector<double>& member : outcome_.figures) {
        column.push_back(member[i]);
      }
      outcome_.summary[i].values = figures::distribution_of(column);
    }
  }

  void show_progress() {
    if (!options_.progress || Clock::now() - last_progress_ < options_.progress_interval) {
      return;
    }
    last_progress_ = Clock::now();
    options_.progress({.t = static_cast<double>(written_),
                       .start = 0.0,
                       .until = static_cast<double>(ensemble_.members()),
                       .h = 1.0,
                       .steps = written_,
                       .off_law = 0,
                       .energy_deviation = 0.0,
                       .members = ensemble_.members()});
  }

  // ---- the record ---------------------------------------------------------------------------------------------------

  [[nodiscard]] record::Checkpoint checkpoint() const { return {{findings_array, outcome_.findings.saved()}}; }

  /// The members that the record has already.
  void take_stored(const record::Reader& reader) {
    const std::size_t members = reader.rows("/members/number");
    const std::vector<std::int64_t> status = reader.read_integers("/members/status");
    std::vector<std::vector<double>> columns;
    for (const std::string& name : names_) {
      columns.push_back(reader.read("/members/" + name));
    }
    if (members > ensemble_.members() || status.size() != members) {
      throw record::Error(outcome_.file,
                          fmt::format("it has {} members; its problem has {}", members, ensemble_.members()));
    }
    std::vector<std::int64_t> verdicts(members, 0);
    if (keeps_verdicts_) {
      verdicts = reader.read_integers(verdicts_path);
      const record::Checkpoint checkpoint = reader.checkpoint();
      if (const auto found = checkpoint.find(findings_array); found != checkpoint.end()) {
        if (const auto* text = std::get_if<std::string>(&found->second)) {
          outcome_.findings.restore(*text);
        }
      }
    }
    for (std::size_t m = 0; m < members; ++m) {
      outcome_.findings.add_verdict(static_cast<figures::Verdict>(verdicts.at(m)),
                                    is_end(static_cast<ExitStatus>(status[m])) ? RunEnd::complete : RunEnd::failed);
      std::vector<double> figures;
      for (const std::vector<double>& column : columns) {
        figures.push_back(column.at(m));
      }
      write(static_cast<ExitStatus>(status[m]), "", std::move(figures));
    }
  }

  const Problem& problem_;
  const Ensemble& ensemble_;
  const RunOptions& options_;
  const ThreadCount threads_;
  std::vector<std::string> names_;
  std::vector<EntryColumn> columns_;
  std::vector<std::int64_t> first_;
  record::Layout states_, layout_;
  std::vector<std::string> first_events_;
  bool keeps_verdicts_ = true;
  bool keeps_states_ = false;                     ///< all members have states of one shape
  bool keeps_series_ = false;                     ///< events of one
  std::vector<std::size_t> series_, members_of_;  ///< numbers of their datasets, and of those with the members'
  static constexpr std::size_t left_out = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> rows_;  ///< of each dataset, that were compared
  std::optional<Recorder> recorder_;
  const record::Reader* compared_with_ = nullptr;
  std::size_t stored_ = 0, compared_ = 0, failed_ = 0;
  std::optional<std::size_t> finished_only_;
  std::string first_failure_;

  std::mutex mutex_;  ///< of all that follows, and of the outcome
  std::size_t next_ = 0, end_ = 0, written_ = 0;
  std::map<std::size_t, MemberResult> waiting_;  ///< finished before one with a smaller number
  std::exception_ptr error_;
  std::atomic<bool> halted_ = false;
  Clock::time_point last_progress_;
  EnsembleOutcome outcome_;
};

Problem stored_ensemble(const record::Reader& reader) {
  return blame_record(reader.file().string(), [&] {
    const std::string file = reader.file().string();
    Problem problem = parse_recorded(reader.header().problem, file);
    if (!problem.ensemble) {
      throw record::Error(reader.file(), "it has members, and its problem has no [ensemble]");
    }
    if (constexpr auto reported = "/members/step_potential/max";
        problem.scheme.usual_potential && reader.has(reported)) {
      const std::vector<double> largest = reader.read(reported);
      if (!largest.empty() && std::ranges::all_of(largest, [](double value) { return std::isnan(value); })) {
        // From before there was a usual potential.
        return parse_recorded(reader.header().problem, file, std::array<std::string, 1>{"scheme.step_potential=none"});
      }
    }
    return problem;
  });
}

}  // namespace

bool is_ensemble(const record::Reader& reader) {
  return reader.has("/members/number");
}

EnsembleOutcome run_ensemble(const Problem& problem, const RunOptions& options) {
  if (options.tangents) {
    throw ProblemError(problem.ensemble->location,
                       "tangent solutions are not carried along an ensemble: leave out --tangents");
  }
  return EnsembleDriver(problem, options, options.output.value_or(problem.output.file)).start();
}

EnsembleOutcome resume_ensemble(const std::string& file, const RunOptions& options) {
  record::Claim claim(file, locking_of(options));
  const record::Reader reader(file);
  record::refuse_earlier_version(reader);
  const Problem problem = stored_ensemble(reader);
  return blame_record(file, [&] { return EnsembleDriver(problem, options, file, &reader).resume(std::move(claim)); });
}

EnsembleOutcome check_ensemble(const std::string& file, const RunOptions& options) {
  const record::Reader reader(file, record::Altered::reported);
  const Problem problem = stored_ensemble(reader);
  return blame_record(file, [&] { return EnsembleDriver(problem, options, file, &reader).check(reader); });
}

}  // namespace rubato
