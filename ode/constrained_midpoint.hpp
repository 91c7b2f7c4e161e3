#pragma once

#include <memory>
#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/segment_scheme.hpp>

namespace rubato {

/// The midpoint rule for any H(q, p) with constraints at the nodes (theory, section 13): with p⁺ = p_k - G(q_k)ᵀμ and
/// the middle z̄ of (q_k, p⁺) and (q_{k+1}, p⁻),
///
///     (q_{k+1}, p⁻) - (q_k, p⁺) = h J∇H(z̄),   g(q_{k+1}) = 0,
///     p_{k+1} = p⁻ - G(q_{k+1})ᵀν,   G H_p = 0 at the end.
///
/// The discrete energy is H(z̄). Order 2.
///
/// \throws std::invalid_argument as make_midpoint_scheme(); where z_0 does not satisfy the constraints, with the values
/// that do; where gradients of constraints are dependent
[[nodiscard]] std::unique_ptr<OneStepScheme> make_constrained_midpoint(const Hamiltonian& hamiltonian,
                                                                       std::span<const double> z_0);

}  // namespace rubato
