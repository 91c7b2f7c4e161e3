#pragma once

#include <span>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// How far formulas of place are off what a grid holds of them, over their size: along each axis, between nodes,
///
///     rms |f(x + θΔx) - (1 - θ) f(x) - θ f(x + Δx)| / rms |f - mean f|,    θ = 0.382 and 1/2,
///
/// the largest, of the formulas of [initial] that name no fields, and of ∂S/∂z at `typical` fields where S names a
/// coordinate. Waves of three nodes or more have 0.5 at most; one that the grid takes for another has 0.9 or more, and
/// so has what falls between the nodes. Not a number where there is no such formula.
/// \param typical one value for each field
[[nodiscard]] double lost_between_nodes(const Problem& problem, const MultisymplecticSystem& system,
                                        const grids::Grid& grid, std::span<const double> typical);

}  // namespace rubato
