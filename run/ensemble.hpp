#pragma once

#include <string>
#include <vector>

#include <rubato/figures/members.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/member_verdicts.hpp>
#include <rubato/run/run.hpp>

/// Many runs of one problem: [ensemble] of its file.
///
/// Every member is a run of its own, with its own levels, made by one thread from beginning to end, so that it is the
/// same bit by bit as a run of that problem alone, whatever else goes on. Its levels are not kept: the record has, for
/// every member, the values it was given, how it ended, every figure that the table of a run has, and its last state.
namespace rubato {

/// A figure over all members that have it.
struct EnsembleFigure {
  std::string name;  ///< as in the JSON of a run: "discrete_energy/max_relative_deviation"
  figures::Distribution values = {};
};

struct EnsembleOutcome {
  /// The gravest of the members', or that of the whole; ExitStatus::lost only if it is that of every member that
  /// reached its end.
  ExitStatus status = ExitStatus::done;
  std::string title;
  std::string file;
  std::size_t members = 0;                       ///< that the problem has
  std::size_t finished = 0;                      ///< that the record has
  std::vector<std::string> paths;                ///< of the entries that differ
  std::vector<std::vector<std::string>> values;  ///< of every member
  std::vector<ExitStatus> statuses;              ///< of those finished
  std::vector<std::vector<double>> figures;      ///< of those finished, one number for each of `summary`
  std::vector<EnsembleFigure> summary;
  MemberVerdicts findings;  ///< the warnings and verdicts of those finished
  std::string message;      ///< why it ended early, or the first member that did; empty when all is well
  std::optional<double> wall_seconds;
  std::size_t compared = 0;  ///< by `check`
};

/// True if the record is one of an ensemble.
[[nodiscard]] bool is_ensemble(const record::Reader& reader);

/// Runs every member and writes the record. Members are published in the order of their numbers; a member that fails
/// does not end the others. \throws as run(): ProblemError names the member, before anything is written
[[nodiscard]] EnsembleOutcome run_ensemble(const Problem& problem, const RunOptions& options = {});
/// Goes on with the members that the record has not got yet: it is then what it would have been. \throws as resume()
[[nodiscard]] EnsembleOutcome resume_ensemble(const std::string& file, const RunOptions& options = {});
/// Runs every member again and compares bit by bit.
[[nodiscard]] EnsembleOutcome check_ensemble(const std::string& file, const RunOptions& options = {});

/// One JSON object: `members`, and each figure of a run as {min, max, mean, median, lower_quartile, upper_quartile,
/// worst}.
[[nodiscard]] std::string to_json(const EnsembleOutcome& outcome);
/// The table that a person reads; with `rows`, first a line for every member.
[[nodiscard]] std::string to_table(const EnsembleOutcome& outcome, bool rows);

}  // namespace rubato
