#pragma once

#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/formula_action.hpp>

namespace rubato {

/// The discrete action of the box scheme on one cell of a lattice in one space dimension, as a function of the
/// coordinates (t, x) and the values of its four corners (theory, section 5): on the bilinearly mapped quadrilateral,
///
///     A = ½ z̄ᵀ[M(δ₁z δ₂x - δ₂z δ₁x) + K(δ₂z δ₁t - δ₁z δ₂t)] - (δ₁t δ₂x - δ₁x δ₂t) S(z̄),
///
/// z̄ the mean of the corners, δ₁ the mean difference in the direction of time, δ₂ in that of space. On a rectangle it
/// is A = hΔx [½ z̄ᵀ(M D_t z + K D_x z) - S(z̄)]. Corners are ordered (t_k,x_i), (t_k,x_{i+1}), (t_{k+1},x_i),
/// (t_{k+1},x_{i+1}).
///
/// This states the scheme; its variations are taken by total_variation.hpp. Varying values gives Σ_cells hΔx/4 R = 0
/// with the cell residual R = M D_t z + K D_x z - ∇S(z̄), of which the production form R = 0 is the solution that starts
/// so (see LatticeScheme).
/// \throws std::invalid_argument unless the system has one space direction
[[nodiscard]] FormulaAction box_cell_action(const MultisymplecticSystem& system);

}  // namespace rubato
