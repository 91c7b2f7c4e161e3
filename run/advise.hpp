#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rubato/figures/verdict.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/run.hpp>
#include <rubato/run/scheme_variants.hpp>

/// Which scheme, which step? Trials of the schemes that take a problem, ranked by their cost at equal error.
namespace rubato {

/// A scheme with its step, and what its trials show.
struct AdvisedScheme {
  SchemeEntries entries = {};  ///< without the step; none for the problem as it stands
  double step = 0.0;
  std::vector<std::pair<std::string, std::int64_t>> cells = {};  ///< of a lattice, along each axis

  /// Errors at the end of the trials by converge(), relative to Convergence::scale; absent without an estimate.
  std::optional<double> step_error = {}, grid_error = {};
  std::optional<double> order = {};  ///< observed, of the step
  /// False where the step or the cells follow from the last trial by the order.
  bool measured = true;
  figures::Verdict verdict = figures::Verdict::good;  ///< of the trial
  std::string failure = {};                           ///< why there is no estimate; empty where there is one

  std::optional<double> seconds = {};  ///< of the whole run, by estimate_run()
  /// Seconds at an error that is exactly the target, by the order; at most that of any scheme that takes longer for a
  /// larger error, so that none is dominated by one below it.
  std::optional<double> cost = {};
};

/// What advise() returns.
struct Advice {
  ExitStatus status = ExitStatus::done;
  std::string message = {};
  std::string title;
  double until = 0.0;                                             ///< the end of the trials
  bool whole_run = true;                                          ///< true if that is the end of the run
  double target = 0.0;                                            ///< the error at which schemes are compared
  AdvisedScheme present;                                          ///< the problem as it stands
  std::vector<AdvisedScheme> schemes = {};                        ///< by cost; those without one last
  std::vector<std::pair<std::string, std::string>> refused = {};  ///< methods that do not take the problem, and why
};

/// Tries the schemes that take a problem (scheme_variants()), each with the step and the number of cells at which
/// converge() estimates the target error. Of the variants of a family the one with the fewest stages over the run is
/// kept. Seconds, and with them the order of the list, depend on the machine; all else is reproducible.
/// \param tolerance the target, relative to Convergence::scale; absent: the error of the problem as it stands, but at
/// least 1e-10 and at most 1e-3
/// \throws ProblemError as require_refinable()
[[nodiscard]] Advice advise(const Problem& problem, std::optional<double> tolerance, const RunOptions& options = {});

[[nodiscard]] std::string to_json(const Advice& advice);
[[nodiscard]] std::string to_table(const Advice& advice);

}  // namespace rubato
