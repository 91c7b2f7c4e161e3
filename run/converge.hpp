#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/run/member_verdicts.hpp>
#include <rubato/run/run.hpp>

/// How accurate a run is: what the laws do not show, since they can be perfect on an orbit that is wrong.
namespace rubato {

/// What refining the step, or the grid, changed of one quantity at the end.
struct Refinement {
  double coarse = 0.0, fine = 0.0;  ///< largest differences: of 1 and 1/2, of 1/2 and 1/4
  /// log2(coarse/fine); absent where differences are rounding, or do not fall.
  [[nodiscard]] std::optional<double> order() const;
  /// Of the problem as it stands, by Richardson: coarse times 2^p/(2^p - 1) with the observed order p; the coarse
  /// difference itself where there is none.
  [[nodiscard]] double error() const;
};

struct Convergence {
  std::string name;    ///< of a coordinate, a momentum or a field, or of [output.quantities]
  double size = 0.0;   ///< its largest magnitude at the end
  double scale = 0.0;  ///< the largest size among its kind: coordinates, momenta or fields; of a quantity its own
  Refinement step;
  std::optional<Refinement> grid;  ///< of a lattice
  std::optional<double> exact;     ///< largest difference of the run as it stands from [exact], at its last level
  /// False where errors of step and grid are a small part of the difference from [exact]: then [exact] does not solve
  /// the problem.
  [[nodiscard]] bool explains_exact() const;
};

struct ConvergenceOutcome {
  ExitStatus status = ExitStatus::done;
  std::string message = {};
  bool ended = false;            ///< true if all runs reached their end, so that there is something to compare
  MemberVerdicts findings = {};  ///< their warnings and verdicts
  std::string title;
  double until = 0.0;
  bool in_fictitious_time = false;  ///< `until` is
  double step = 0.0;
  std::size_t steps = 0;  ///< that the run with the whole step took
  /// With which grids were compared: a quarter of `step` where the whole is too long for the finer ones.
  std::optional<double> grid_step = {};
  std::vector<Convergence> quantities = {};
  /// The step that would reach the tolerance asked for in every quantity relative to its size, if the order held.
  std::optional<double> step_for_tolerance = {};
  std::optional<double> tolerance;
  double wall_seconds = 0.0;
};

/// What `converge` refines, and to which time it runs.
struct ConvergeScope {
  std::optional<double> until = {};  ///< in place of the problem's
  bool grids = true;                 ///< true if the spacings of a lattice are halved as well
};

/// \throws ProblemError for an ensemble, for step = "auto", and where ranks share the run; `command` says so
void require_refinable(const Problem& problem, const RunOptions& options, std::string_view command);

/// Runs the problem to `until` with its step, a half and a quarter of it, and a lattice also with half and a quarter of
/// its spacings (with the next odd numbers of cells where the problem's are odd), and compares the states and what
/// [output.quantities] holds at `until` (dense output; of other grids at the nodes of the problem's, by trigonometric
/// interpolation). Where the step is too long for the finer grids, all grids are compared with a quarter of it. Nothing
/// is written. \throws ProblemError for step = "auto", an ensemble, or a problem whose fields a
/// record has not at its levels
[[nodiscard]] ConvergenceOutcome converge(const Problem& problem, std::optional<double> tolerance,
                                          const RunOptions& options = {}, const ConvergeScope& scope = {});

[[nodiscard]] std::string to_json(const ConvergenceOutcome& outcome);
[[nodiscard]] std::string to_table(const ConvergenceOutcome& outcome);

}  // namespace rubato
