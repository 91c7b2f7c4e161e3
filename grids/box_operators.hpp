#pragma once

#include <array>

#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// What a box operator does along one axis, with z_{i+1} taken cyclically:
enum class Along {
  identity,    ///< z_i
  next,        ///< z_{i+1}
  average,     ///< A: (z_i + z_{i+1})/2, to cell centres
  difference,  ///< D: (z_{i+1} - z_i)/Δx
};

/// The product of one operator for each axis (x, y, z; those beyond the grid's dimension must be `identity`), as
/// A_x A_y or D_x A_y: the four (eight) corners' means and mean differences of the box scheme (theory, section 5).
using BoxOperator = std::array<Along, 3>;

/// The coordinate that `along`, no difference, makes of the nodes' along an axis. The upper node of the last cell is at
/// `to`, not at `from`: no cell lies across the seam.
[[nodiscard]] double coordinate(const Axis& axis, std::size_t cell, Along along);

/// out = op z, nodes to cells. One pass: the corners are added with their signs first and scaled once, so that
/// differences of equal values are exactly zero. in and out may not overlap. Same result for every number of threads.
void apply(const Grid& grid, const BoxOperator& op, const double* in, double* out);

/// out = opᵀ r, cells to nodes: ⟨op z, r⟩ = ⟨z, opᵀ r⟩.
void apply_adjoint(const Grid& grid, const BoxOperator& op, const double* in, double* out);

/// Solves A w = b along one axis, that is (w_i + w_{i+1})/2 = b_i cyclically, in O(N) by the exact recurrence
/// w_0 = b_0 - b_1 + … + b_{N-1}, w_{i+1} = 2 b_i - w_i. in and out may be the same.
///
/// Throws std::invalid_argument for an even number of cells, where A has the kernel (-1)^i. ‖A⁻¹‖ = N in the maximum
/// norm, and the recurrence forgets nothing: a relative error ε of b comes out as up to N ε, slowly varying times
/// (-1)^i. The recurrence itself is run in compensated arithmetic and adds only one rounding.
void invert_average(const Grid& grid, int axis, const double* in, double* out);

}  // namespace rubato::grids
