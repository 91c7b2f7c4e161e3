#pragma once

#include <memory>
#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/segment_scheme.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// A composition of Verlet steps for H = T(p) + V(q) with constraints (theory, section 13): with one such step SHAKE
/// and RATTLE. The discrete action has multipliers at the ends of all drifts,
///
///     A = Σ_i [p_i·(q_i - q_{i-1}) - a_i h T(p_i)] - Σ_i b_i h V(q_i) + Σ_i μ_iᵀ g(q_i),
///
/// so that a kick is p -= b_i h ∇V(q_i) + G(q_i)ᵀμ_i, the μ_i such that the drift after it ends where g = 0, and at the
/// last node such that G ∇T(p) = 0. The discrete energy is that of make_splitting_scheme(), since g vanishes at all
/// nodes. The map is symplectic on the tangent bundle of g = 0, and of the composition's order there.
///
/// \throws std::invalid_argument as make_splitting_scheme(); for a composition that is not of Verlet steps; where z_0
/// does not satisfy the constraints, with the values that do; where gradients of constraints are dependent
[[nodiscard]] std::unique_ptr<OneStepScheme> make_constrained_splitting(const Hamiltonian& hamiltonian,
                                                                        const Composition& composition,
                                                                        std::span<const double> z_0);

}  // namespace rubato
