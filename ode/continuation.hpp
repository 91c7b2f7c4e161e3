#pragma once

#include <optional>
#include <string>
#include <vector>

#include <rubato/ode/boundary_value.hpp>

namespace rubato {

/// A solution on a branch, and the parameter there.
struct BranchPoint {
  double parameter = 0.0;
  bool is_fold = false;  ///< the parameter turns round here
  BoundaryValueSolution solution = {};
};

/// Solutions along a branch, in their order.
struct Branch {
  std::vector<BranchPoint> points = {};
  Status status = Status::not_converged;
  std::string message = {};  ///< why it ended before the goal; empty if it came there

  [[nodiscard]] bool complete() const { return status == Status::success; }
};

/// What changes along a branch: the duration, the energy, or component i of the first node. A parameter λ of H is such
/// a component: make λ a coordinate whose momentum does not occur in H, so that it is constant, and let that momentum
/// begin at 0.
struct BranchParameter {
  StationaryAction::Parameter target = StationaryAction::Parameter::none;
  std::optional<std::size_t> component = std::nullopt;  ///< in place of a target; no end condition may fix it
};

struct ContinuationOptions {
  /// Of the start. Duration and energy are held along a branch in a component, and neither in one of them.
  BoundaryValueOptions newton = {};
  BranchParameter parameter = {};
  double to = 0.0;  ///< the branch ends where the parameter comes to this
  std::size_t most_points = 500;
  /// Of the parameter, in the first step; with its sign the branch sets out, be it away from `to`. Absent: a twentieth
  /// of the way.
  std::optional<double> step = std::nullopt;
};

/// Follows a branch of solutions from one of them until the parameter comes to `to`, through folds.
///
/// Each step predicts along the tangent by a length of arc and corrects with the unknown held that the tangent moves
/// most (local parameterisation; Rheinboldt and Burkardt, ACM Transactions on Mathematical Software 9 (1983) 215), so
/// that Newton's matrix stays sparse and regular in folds. Folds are located to the tolerance of the solver, as zeros
/// of the parameter's component of the tangent. The step potential and the scales are those of the start.
///
/// Breaks down: at bifurcations the branch taken is that of the tangent before; solutions that are not isolated for
/// other reasons than symmetries are not distinguished.
/// \throws std::invalid_argument unless the parameter is one of the three, as make_segment_equation()
[[nodiscard]] Branch follow_branch(const Hamiltonian& hamiltonian, EndConditions ends,
                                   const BoundaryValueSolution& start, const ContinuationOptions& options);

}  // namespace rubato
