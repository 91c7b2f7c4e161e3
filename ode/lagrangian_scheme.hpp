#pragma once

#include <memory>
#include <span>

#include <rubato/ode/lagrangian.hpp>
#include <rubato/ode/segment_scheme.hpp>
#include <rubato/variation/action_quadrature.hpp>

namespace rubato {

/// The discrete Lagrangian L_d(q_k, q_{k+1}, h) of an ActionQuadrature as a one-step map of (q, p), by the discrete
/// Legendre transform (theory, section 7; Marsden and West 2001, section 1.5)
///
///     p_k = -D_1 L_d,   p_{k+1} = D_2 L_d,   E_k = -∂L_d/∂h = Σ_j b_j E(q, q̇ at c_j h),   E = q̇·∂L/∂q̇ - L.
///
/// With levels from E_k = E it is the stationary point of the total variation of Σ L_d, symplectic in the extended
/// sense (theory, sections 2 and 8). The polynomial's values are found by Newton's method with the Hessian of L in
/// every iteration, from the last step's polynomial continued; increments are kept with what their rounding loses.
///
/// One Gauss point is the midpoint rule for H, whose node law, with Γ = fᵀH_zz f, it has. The
/// others have no node law in closed form; the slope of E_k comes from the energies of both ends (make_gauss_scheme).
/// node() reads H(q, p) by LegendreTransform; velocities() are those of that. Where L has constraints it is
/// make_constrained_lagrangian().
/// \throws std::invalid_argument, SingularLagrangianError as momenta()
[[nodiscard]] std::unique_ptr<OneStepScheme> make_lagrangian_scheme(const Lagrangian& lagrangian,
                                                                    const ActionQuadrature& quadrature,
                                                                    std::span<const double> q,
                                                                    std::span<const double> q_dot);

}  // namespace rubato
