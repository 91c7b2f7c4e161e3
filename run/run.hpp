#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/disagreement.hpp>

namespace rubato::ranks {
class Communicator;
}

namespace rubato {

using figures::Named;
using figures::Statistics;

/// Exit statuses of the program (and of a run).
enum class ExitStatus {
  done = 0,
  wrong_input = 2,
  singular = 3,
  failed = 4,
  file_error = 5,
  contradiction = 6,  ///< `check`: the record contradicts itself
  lost = 7,           ///< the run reached its end, and its verdict is "lost"
  interrupted = 130,
};

/// True if a run with this status ended by a failure, before its end.
[[nodiscard]] constexpr bool has_failed(ExitStatus status) {
  return status == ExitStatus::singular || status == ExitStatus::failed;
}

struct Progress {
  double t, start, until, h;
  std::size_t steps, off_law;
  double energy_deviation;  ///< relative, where that says something
  std::size_t members = 0;  ///< of an ensemble: how many it has; t is then the number of those that are done
};

/// While it lives, a run stores levels (RunOptions::storing).
class Storing {
public:
  explicit Storing(std::atomic<bool>* flag) : flag_(flag), before_(flag != nullptr && flag->exchange(true)) {}
  ~Storing() {
    if (flag_ != nullptr) {
      *flag_ = before_;
    }
  }
  Storing(const Storing&) = delete;
  Storing& operator=(const Storing&) = delete;

private:
  std::atomic<bool>* flag_;
  bool before_;
};

struct RunOptions {
  std::optional<std::string> output = std::nullopt;  ///< in place of the problem's [output] file
  bool overwrite = false;
  bool lock = true;  ///< false: on file systems without locks; no other run may write the record then
  int threads = 0;   ///< 0: OpenMP's default
  /// Carries two random tangent solutions along a lattice and reports the multisymplectic residual. `resume` goes on as
  /// the run began.
  bool tangents = false;
  /// Set from a signal handler to end the run cleanly after the present level, or in its look-ahead.
  const std::atomic<bool>* interrupt = nullptr;
  /// Set by a run from the creation of its record to its last level: what ends the process then has to do so by
  /// `interrupt`, or levels are lost. May be null.
  std::atomic<bool>* storing = nullptr;
  /// Called after a level (of an ensemble, after a member) if `progress_interval` has passed since the last call.
  std::function<void(const Progress&)> progress = {};
  std::chrono::milliseconds progress_interval{100};
  /// At least this long between two versions of the record: what a kill loses at most, beside a twentieth of the time.
  std::chrono::milliseconds commit_interval{2000};
  /// The ranks that share the run, of which this process is number 0 and the others carry out help_rank_0(); null for
  /// none. The members of an ensemble are handed out to all of them, and a lattice is shared in slabs; what cannot be
  /// shared is refused.
  ranks::Communicator* ranks = nullptr;
  /// Called at the start with each warning that is known then; all are in Outcome::warnings as well.
  std::function<void(const std::string&)> caution = {};
};

/// How a run ended.
struct Outcome {
  ExitStatus status = ExitStatus::done;
  std::string title;
  std::string file;  ///< the record; empty where none could be written
  Statistics statistics;
  bool variable_levels = true;
  std::size_t axes = 0;                ///< of a lattice's grid
  bool complete = false;               ///< true if `until` was reached
  std::string message;                 ///< why it ended early, with the remedy; empty when it did not
  std::vector<std::string> warnings;   ///< each one sentence, with the remedy
  figures::Judgement judgement;        ///< the verdict
  StepPotential step_potential = {};   ///< of the run; none before its first step
  int order = 2;                       ///< of the scheme
  std::optional<double> wall_seconds;  ///< of this process; absent for `check`

  // Of `check` only:
  std::size_t compared = 0;                 ///< numbers that were recomputed and compared
  std::size_t disagreement_count = 0;       ///< of these those that disagree,
  std::vector<Disagreement> disagreements;  ///< the first ones of each dataset
};

/// Runs a problem and writes its record. Numerical failure is an Outcome; the record then holds every level computed.
/// \throws ProblemError, record::AlreadyExists (wrong input: nothing is written); record::Error, FileError
[[nodiscard]] Outcome run(const Problem& problem, const RunOptions& options = {});

/// Continues a record from its last complete level, bit for bit as if it had never stopped. `until` replaces the
/// problem's. \throws as run
[[nodiscard]] Outcome resume(const std::string& file, std::optional<double> until, const RunOptions& options = {});

/// One JSON object (interface, section 3): doubles with 17 digits, absent keys where they do not apply, never NaN.
[[nodiscard]] std::string to_json(const Outcome& outcome);

/// The table a person reads.
[[nodiscard]] std::string to_table(const Outcome& outcome);

}  // namespace rubato
