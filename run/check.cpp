#include <rubato/run/check.hpp>
#include <rubato/run/conclusion.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/record/run_shape.hpp>
#include <rubato/run/checkpoint_check.hpp>
#include <rubato/run/lattice_check.hpp>
#include <rubato/run/lattice_ranks.hpp>
#include <rubato/run/level_check.hpp>
#include <rubato/run/orbit_check.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/solve.hpp>
#include <rubato/run/threads.hpp>

namespace rubato {

namespace {

/// What a run of the problem shows, in its order. \throws record::Error where the problem cannot be run
void make_observed_run(const record::Reader& reader, const Problem& problem, const LatticeLeader* leader,
                       std::optional<ObservedRun>& observed) {
  try {
    if (leader != nullptr) {
      leader->order(Order::make);
    }
    observed.emplace(problem, reader.has("/laws/multisymplectic_max"));
  } catch (const ProblemError& error) {
    throw record::Error(reader.file(), fmt::format("the problem in it cannot be run ({})", error.what()));
  }
}

figures::Names names_in(const record::Reader& reader, const ObservedRun& observed) {
  figures::Names names{.invariants = observed.simulation().invariant_names(),
                       .totals = observed.simulation().total_names(),
                       .residuals = observed.simulation().law_names(),
                       .exact = {},
                       .events = {}};
  for (const auto& [name, event] : observed.statistics().events) {
    names.events.push_back(name);
  }
  for (const record::Dataset& dataset : observed.layout().datasets) {
    constexpr std::string_view group = "/exact/";
    if (dataset.path.starts_with(group) && reader.has(dataset.path)) {
      names.exact.push_back(dataset.path.substr(group.size()));
    }
  }
  return names;
}

class RecordCheck {
public:
  RecordCheck(const record::Reader& reader, const CheckOptions& options)
      : reader_(reader), options_(options), problem_(stored_problem(reader)), threads_(0, problem_) {
    outcome_.title = problem_.title;
    outcome_.file = reader.file().string();
    outcome_.variable_levels = problem_.scheme.levels == Levels::variable;
    outcome_.complete = reader.header().finished;
  }

  Outcome run() {
    try {
      recompute();
    } catch (const figures::Mismatch& mismatch) {  // with the problem, whatever else is true of the record
      findings_.add({.dataset = mismatch.dataset(), .reason = mismatch.reason()});
    }
    conclude(reader_, findings_, outcome_);
    return std::move(outcome_);
  }

private:
  void recompute() {
    const StoredLevels levels(reader_, problem_);
    share();
    const LatticeLeader* const leader = leader_ ? &*leader_ : nullptr;
    std::optional<ObservedRun> observed;
    make_observed_run(reader_, problem_, leader, observed);
    is_of_earlier_version_ = record::is_of_earlier_version(reader_);
    const figures::Names names = names_in(reader_, *observed);
    const CheckpointDisagreements checkpoint = check_checkpoint(reader_, levels, names, *observed, leader, findings_);
    check_levels(reader_, levels, problem_, checkpoint, findings_);
    check_action(*observed);
    const bool has_gamma = observed->simulation().has_gamma();
    observed.reset();  // the states need its room
    const Spread equation = problem_.hamiltonian() != nullptr
                                ? check_orbit(reader_, levels, problem_, has_gamma, findings_)
                                : check_lattice_of(levels, has_gamma);
    if (options_.replay && !is_of_earlier_version_) {
      replay(reader_, levels, problem_, findings_);
    } else if (!findings_.doubtful().empty()) {
      resolve_doubts(levels);
    }
    outcome_.statistics = levels.rows_every == 1 ? figures::statistics_of_rows(reader_, names, findings_.corrections())
                                                 : figures::stored_statistics(reader_, names);
    outcome_.statistics.laws_every = static_cast<std::size_t>(problem_.laws.every);
    outcome_.judgement = figures::judge(outcome_.statistics);
    if (equation.count() > 0.0) {
      outcome_.statistics.residuals.push_back({"step_equation", equation});
    }
    const std::vector<std::string> undefined = outcome_.statistics.undefined_quantities();
    outcome_.warnings.insert(outcome_.warnings.end(), undefined.begin(), undefined.end());
    if (!levels.complete() && (!options_.replay || is_of_earlier_version_)) {
      outcome_.warnings.push_back(about_parts(levels));
    }
    if (!checkpoint.is_checked) {
      outcome_.warnings.push_back(fmt::format(
          "the record was written by an earlier version: its checkpoint, and what cannot be recomputed from its "
          "states, was not checked{}",
          options_.replay ? "; its steps were not taken again" : ""));
    }
  }

  /// The measure of the verdict that the problem alone determines.
  void check_action(ObservedRun& observed) {
    const std::string path(figures::measures_path);
    const bool is_stated = problem_.scheme.density != nullptr || problem_.scheme.lagrangian == LagrangianName::custom;
    if (!is_stated || !reader_.has(path) || is_of_earlier_version_) {
      return;
    }
    constexpr double errors_of_differences = 1e-5;
    figures::Measures found;
    observed.simulation().measure(0, found);
    std::size_t place = 0, of_action = 0;
    figures::Measures::visit(found, [&](const double& value) {
      of_action = &value == &found.action ? place : of_action;
      ++place;
    });
    const double action = figures::measures_of(reader_.read(path)).action;
    findings_.compare(
        path, of_action, {}, action, found.action, [] { return errors_of_differences; }, "from L and the equation");
  }

  /// What a record without every level leaves to be believed.
  [[nodiscard]] std::string about_parts(const StoredLevels& levels) const {
    std::size_t recomputed = 0;
    for (std::size_t row = 1; row < levels.state_level.size(); ++row) {
      recomputed += levels.step_to(row) && !levels.evolving_alone ? 1 : 0;
    }
    std::vector<std::string> kept;
    if (levels.sparse) {
      const std::string which =
          problem_.output.states ? fmt::format("every {}-th state", levels.every) : "the last state";
      kept.push_back(levels.evolving_alone ? which + " of the fields that evolve" : which + " and its predecessor");
    }
    if (levels.rows_every > 1) {
      kept.push_back(fmt::format("a row of every {}-th level", levels.rows_every));
    }
    return fmt::format(
        "the record keeps {}: {} of {} steps were recomputed; {} (--replay takes all steps again)",
        fmt::join(kept, ", and "), recomputed, levels.steps(),
        levels.rows_every > 1
            ? "extremes, means and counts are of all steps, as the checkpoint has them: the rows lie within them"
            : "the others were compared with their checksums only");
  }

  /// Steps that were not found again from their states: whether the run taken again leads there, to the bit. If that
  /// leaves the record before it comes to them (on another machine, or of another version), they stay unverified.
  void resolve_doubts(const StoredLevels& levels) {
    const std::vector<std::size_t>& rows = findings_.doubtful();
    const std::size_t reproduced =
        is_of_earlier_version_ ? 0 : reproduced_states(reader_, levels, problem_, rows.back());
    const bool contradicts = std::ranges::find(rows, reproduced) != rows.end();
    for (const std::size_t row : rows) {
      if (contradicts && row >= reproduced) {
        findings_.add({.dataset = "/states",
                       .row = row,
                       .reason = "neither the equation of the step nor the run taken again leads there"});
      }
    }
    outcome_.warnings.push_back(
        fmt::format("{} of {} steps were not found again from the states around them; {}", rows.size(), levels.steps(),
                    contradicts                ? "the run taken again does not lead there"
                    : reproduced > rows.back() ? "the run taken again leads there, to the bit"
                                               : "they were not verified: the run taken again has other bits"));
  }

  /// With other ranks, where they could have run the problem together.
  void share() {
    if (options_.replay) {
      return;
    }
    const RunOptions run{.tangents = reader_.has("/laws/multisymplectic_max"), .ranks = options_.ranks};
    try {
      refuse_unshared(problem_, run);
      if (run.ranks != nullptr && run.ranks->size() > 1) {
        leader_.emplace(*run.ranks, problem_, 0, run.tangents);
      }
    } catch (const ProblemError&) {
      // Then rank 0 does it alone.
    }
  }

  Spread check_lattice_of(const StoredLevels& levels, bool has_gamma) {
    return leader_ ? leader_->check(reader_, levels, has_gamma, findings_)
                   : check_lattice({nullptr, &reader_}, levels, problem_, has_gamma, findings_);
  }

  const record::Reader& reader_;
  CheckOptions options_;
  bool is_of_earlier_version_ = false;
  Problem problem_;
  const ThreadCount threads_;
  std::optional<LatticeLeader> leader_;  ///< before all that ranks have parts of
  Disagreements findings_;
  Outcome outcome_;
};

}  // namespace

Outcome check(const std::string& file, const CheckOptions& options) {
  const record::Reader reader(file, record::Altered::reported);
  if (is_solution(reader) && reader.has("/states/coordinate")) {  // of a lattice it is that of a run
    return blame_record(file, [&] { return check_solution(reader); });
  }
  return blame_record(file, [&] { return RecordCheck(reader, options).run(); });
}

}  // namespace rubato
