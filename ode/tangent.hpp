#pragma once

#include <span>

#include <Eigen/Core>

#include <rubato/ode/hamiltonian.hpp>

/// \file
/// Tangents of the one-step production map of the midpoint 𝕃, and the two-forms they preserve (theory, sections 2.1 and
/// 2.3). The tangent of the two-step map of any action is two_step_tangent() of variation/total_variation.hpp.

namespace rubato {

/// dp∧dq = Σ_i dp_i∧dq_i on z = (q, p): the 2n × 2n matrix W with (dp∧dq)(u, v) = uᵀ W v, W = [[0, -I], [I, 0]].
[[nodiscard]] Eigen::MatrixXd canonical_two_form(std::size_t degrees_of_freedom);

/// dp∧dq - dE∧dt on (q, p, t, E), of 2n + 2 rows.
[[nodiscard]] Eigen::MatrixXd extended_two_form(std::size_t degrees_of_freedom);

/// ∂z_1/∂z_0 of the midpoint step z_1 = z_0 + h J∇H(z̄) of a given length h (fixed levels):
///
///     (I - ½hJH_zz(z̄)) δz_1 = (I + ½hJH_zz(z̄)) δz_0.
///
/// It preserves dp∧dq. The step is given by both its ends, which have to satisfy it: a pair that does not gives the
/// tangent of no step.
/// \throws std::invalid_argument unless both have 2n entries, h ≠ 0 is finite, H, ∇H, H_zz are finite at z̄, and the
/// matrix on the left is regular
[[nodiscard]] Eigen::MatrixXd fixed_level_tangent(HamiltonianEvaluator& hamiltonian, std::span<const double> z_0,
                                                  std::span<const double> z_1, double h);

/// Tangent of (z_0, t_0, E) ↦ (z_1, t_0 + h, E), where the level is solved for together with the step (variable
/// levels): z_1 = z_0 + h f, f = J∇H(z̄), and H(z̄) = E. With g = ∇H(z̄),
///
///     [[I - ½hJH_zz, -f], [½gᵀ, 0]] (δz_1, δh) = ((I + ½hJH_zz) δz_0, δE - ½g·δz_0),   δt_1 = δt_0 + δh.
///
/// It preserves dp∧dq - dE∧dt, and its block ∂z_1/∂z_0 at fixed E, which has ∂h/∂z in it, preserves dp∧dq. The matrix
/// on the left degenerates where the step does: |∂h/∂z| ~ 1/(hΓ).
/// \return (2n + 2) × (2n + 2), rows and columns in the order (z, t, E)
/// \throws as fixed_level_tangent
[[nodiscard]] Eigen::MatrixXd variable_level_tangent(HamiltonianEvaluator& hamiltonian, std::span<const double> z_0,
                                                     std::span<const double> z_1, double h);

}  // namespace rubato
