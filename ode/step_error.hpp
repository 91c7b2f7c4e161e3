#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <rubato/ode/boundary_value.hpp>

namespace rubato {

/// What the length of its steps leaves uncertain of the solution of a boundary-value problem.
struct StepError {
  BoundaryValueSolution halved;  ///< the solution with steps of half the length; not found() where there is none near
  /// Estimates |Δ| 2^s/(2^s - 1) at order s, from the differences Δ of both solutions. Of each coordinate and momentum
  /// the largest over the nodes; 0 of a duration or an energy that is given.
  ///@{
  std::vector<double> components = {};
  double duration = 0.0, energy = 0.0;
  ///@}
  /// The largest of `components` beside the range of its coordinate or momentum along the orbit (see step_error()), or
  /// of the duration beside itself, and the level and component there. Infinite where no solution was found.
  double relative = 0.0;
  std::size_t level = 0, component = 0;
};

/// Solves a boundary-value problem again with every step in two halves, beginning from its solution, and compares.
///
/// The halves are of equal length, so that every second node is a node of the solution: levels, free or not, are held
/// in their ratios, and the duration stays free where it is. The boundary-value problem has no sensitivity to its start
/// to hide the error, and solutions of the discrete equations alone, far from any orbit, are found out: they move, or
/// have no counterpart.
///
/// A range counts as at least a thousandth of the largest one among coordinates, or among momenta: a component that
/// hardly moves consists of errors.
/// \param solution found() by solve_boundary_value() with the same arguments
[[nodiscard]] StepError step_error(const Hamiltonian& hamiltonian, const EndConditions& ends,
                                   const NodesOfOrbit& solution, const BoundaryValueOptions& options);

}  // namespace rubato
