#pragma once

#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/lattice_action.hpp>

/// \file
/// The discrete actions of the schemes for M z_t + Σ_a K_a z_{x_a} = ∇S(z) (theory, section 5): one density,
///
///     L = ½ zᵀ(M D_t z + Σ_a K_a D_a z) - S(z),
///
/// and a stencil for each scheme that says what z and D_ρ z are in a cell. With Λ_t = M, Λ_a = K_a and Λ = Λ₊ - Λ₊ᵀ,
/// ½ zᵀΛ_ρD_ρz and -(D_ρz)ᵀΛ₊_ρz differ by a difference, which no variation sees; where the system has a bare potential
/// the second form is taken, in which it does not appear.

namespace rubato {

/// The box: z the mean of the corners of a cell, D_ρ their mean differences.
[[nodiscard]] LatticeAction box_action(const MultisymplecticSystem& system);

/// Fourier: z the mean of two levels at a node, D_a the spectral derivative. A slab's action is not a sum of parts that
/// read neighbouring nodes alone; its variations are taken in the same way. In the second form always: to the spectral
/// derivative the two differ in their currents, by aliasing.
[[nodiscard]] LatticeAction fourier_action(const MultisymplecticSystem& system);

/// Euler box: z at the base corner of a cell, D_ρ forward differences from there: zᵀM₊δ_t⁺z + Σ_a zᵀK₊δ_a⁺z - S(z).
/// Or the same without S.
[[nodiscard]] LatticeAction euler_box_action(const MultisymplecticSystem& system, bool with_S = true);

}  // namespace rubato
