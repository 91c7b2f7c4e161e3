#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <rubato/ode/boundary_value.hpp>

namespace rubato {

/// What the conditions of a boundary-value problem leave open at its solution: the directions along which it can be
/// moved without leaving the equations, to first order.
struct OpenDirections {
  std::size_t count = 0;
  bool duration = false, energy = false;  ///< what changes along one of them
  /// Of `count` > 0 the conditions that say the same in part, for people: those with a share in a combination of the
  /// equations that vanishes. Empty where there is none.
  std::vector<std::string> dependent = {};
};

/// Whether all directions count. Of closed orbits and connections the phase is open in any case, and rotations or
/// translations may be: of these only directions count along which the duration or the energy changes.
enum class OpenAlong { any, duration_or_energy };

/// Finds them as small singular values of the equations, whose right singular vectors they are: values that are
/// rounding errors, and values that change from the solution to that with half the step (StepError). The latter are due
/// to the discretisation alone: what they determine is no property of the motion. All other small singular values keep
/// their size, since equations and unknowns are scaled as functions of the time.
[[nodiscard]] OpenDirections open_directions(const Hamiltonian& hamiltonian, const EndConditions& ends,
                                             const NodesOfOrbit& solution, const NodesOfOrbit& halved,
                                             const BoundaryValueOptions& options, OpenAlong which);

}  // namespace rubato
