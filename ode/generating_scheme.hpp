#pragma once

#include <memory>
#include <span>

#include <Eigen/Core>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/segment_scheme.hpp>

namespace rubato {

/// The production form of the action of GeneratingAction (theory, section 4): with E_F = (I + JF)/2,
///
///     J δ = ∇Φ_s(w, h),   w = z_k + E_F δ,   E_k = -∂_hΦ_s(w, h)
///
/// for any symmetric F. It is the two-step equation (3.3) started without a parasite. Symplectic at fixed levels; with
/// variable ones it preserves dp∧dq - dE∧dt. F = 0 with order 2 is the midpoint rule, the Euler types with order 1 are
/// the symplectic Euler methods.
///
/// Solver. Let M be the tangent of the exact flow over h. The Newton matrix of δ + J∇Φ_s(z + E_F δ, h) = 0 is the
/// inverse of I + (M - I)E_F up to the truncation error of Φ_s, so that a residual -r is corrected by r + (M - I)E_F r
/// where (M - I)v is the difference of two Taylor steps of a low order: no Hessian of Φ, no matrix, and corrections
/// that contract by 1e-4 and better. The start is the orbit of the last step, continued (OrbitContinuation), or a
/// Taylor step; where it is within 1e-12 or so, one expansion is all that a step takes. The iteration ends when what
/// the next correction can be expected to be is below rounding, or when corrections stagnate. The expectation is the
/// size of the last correction times the error of the tangent, times the largest factor by which that proved too small
/// so far, times ten.
///
/// Rounding. What a start misses is a smooth function of time: whatever of its correction is dropped, by leaving out
/// the tangent or by rounding δ, has the same sign step after step and makes the energy drift, by 6e-19 a step for the
/// outer Solar System. So every residual is corrected with its tangent, what rounding takes from δ is kept beside it,
/// and z is summed with compensation finer than that. Then a run's energy error is a random walk of the steps'
/// rounding.
///
/// Γ stands for -24 φ^(s+1) with s the order (theory, section 4).
/// \throws std::invalid_argument as GeneratingAction; if z_0 has not 2n entries or is not finite, or H has no Taylor
/// expansion there
[[nodiscard]] std::unique_ptr<OneStepScheme> make_generating_scheme(const Hamiltonian& hamiltonian,
                                                                    const Eigen::MatrixXd& F, int order,
                                                                    std::span<const double> z_0);

}  // namespace rubato
