#pragma once

#include <memory>
#include <span>

#include <rubato/ode/lagrangian.hpp>
#include <rubato/ode/segment_scheme.hpp>
#include <rubato/variation/action_quadrature.hpp>

namespace rubato {

/// The discrete Lagrangian of make_lagrangian_scheme() with constraints (theory, section 13): of all polynomials of
/// degree d whose values at the d + 1 control points satisfy g = 0, the one that makes the quadrature of the action
/// stationary,
///
///     ∂S/∂q_i + G(q_i)ᵀμ_i = 0 and g(q_{i+1}) = 0 for i = 0 … d-1, with p_k added to the first,
///     p_{k+1} = ∂S/∂q_d + G(q_d)ᵀμ_d,   G q̇(p_{k+1}) = 0.
///
/// The control points are those of Lobatto: with a Lobatto quadrature these are Jay's Lobatto IIIA and IIIB methods
/// with constraints, with a Gauss quadrature his Gauss–Lobatto methods, of order 2d. The discrete energy E_k = -∂S/∂h
/// has no term of the multipliers, since g vanishes at the control points.
///
/// \throws std::invalid_argument, SingularLagrangianError as momenta(); where q and q̇ do not satisfy the constraints,
/// with the values that do; where gradients of constraints are dependent
[[nodiscard]] std::unique_ptr<OneStepScheme> make_constrained_lagrangian(const Lagrangian& lagrangian,
                                                                         const ActionQuadrature& quadrature,
                                                                         std::span<const double> q,
                                                                         std::span<const double> q_dot);

}  // namespace rubato
