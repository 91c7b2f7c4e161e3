#pragma once

#include <complex>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <rubato/ode/step_error.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/run.hpp>

namespace rubato {

/// A point of the branch that [solve] continue asks for.
struct BranchRow {
  double parameter = 0.0, duration = 0.0, energy = 0.0;
  bool is_fold = false;
};

/// How a boundary-value problem ended.
struct SolveOutcome {
  ExitStatus status = ExitStatus::done;
  std::string title;
  std::string file;                               ///< the record; empty where none was written
  BoundaryValueSolution solution;                 ///< of a lattice without nodes, which the record has
  std::size_t start = 0, starts = 1;              ///< the guess that was tried last, from 1, and how many there are
  figures::Statistics statistics;                 ///< of its levels and steps
  bool closes = false;                            ///< it is a periodic orbit
  std::vector<std::complex<double>> multipliers;  ///< of one that closes (SecondVariation); empty where not known
  std::optional<std::size_t> index;               ///< Morse's: of fixed ends, or of periodic orbits
  std::vector<double> conjugate_points;           ///< times
  std::string parameter;                          ///< of the branch
  std::vector<BranchRow> branch;                  ///< the last one is the solution
  std::optional<StepError> error;                 ///< of an orbit, by half the step
  std::vector<std::string> dependent;             ///< its conditions that say the same in part (OpenDirections)
  figures::Judgement judgement;                   ///< the verdict
  std::optional<double> closing;                  ///< of a lattice: |z_N - z_0| of its run, beside the largest value
  std::string message;                            ///< why there is no solution, with the remedy; empty if there is
  std::vector<std::string> warnings;
  double wall_seconds = 0.0;

  /// True if there is a solution, whatever it is worth.
  [[nodiscard]] bool found() const { return !file.empty(); }
};

/// Solves the boundary-value problem that [solve] states, and writes the orbit as a record that is laid out as that of
/// a run, with what is known of the solution under /solve. Where Newton's method fails nothing is written. \throws
/// ProblemError, record::AlreadyExists (wrong input: nothing is written); record::Error
[[nodiscard]] SolveOutcome solve_problem(const Problem& problem, const RunOptions& options = {});

[[nodiscard]] std::string to_json(const SolveOutcome& outcome);
[[nodiscard]] std::string to_table(const SolveOutcome& outcome);

/// True if a record is that of a boundary-value problem, as solve_problem() writes it.
[[nodiscard]] bool is_solution(const record::Reader& reader);

/// Recomputes all that the record of a boundary-value problem shows from its states, and what these leave of its
/// equations. \throws record::Error
[[nodiscard]] Outcome check_solution(const record::Reader& reader);

}  // namespace rubato
