#pragma once

#include <memory>
#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/segment_scheme.hpp>

namespace rubato {

/// Gauss collocation with m stages, order s = 2m (theory, section 8.1):
///
///     Z_i = z_k + h Σ_j a_ij J∇H(Z_j),   z_{k+1} = z_k + h Σ_i b_i J∇H(Z_i),   E_k = Σ_i b_i H(Z_i).
///
/// E_k is the Hamiltonian that generates the family of maps in h, so that with levels from E_k = E the step is
/// symplectic in the extended sense, for any H. For m = 1 this is the midpoint rule.
///
/// The stages are evaluated side by side in vectors, from the collocation polynomial of the last step continued, by
/// fixed-point iteration, of H = T(p) + V(q) on the stages of q alone, and where T is a quadratic form, T_pp = M⁻¹,
/// without those of p between,
///
///     Q_i = q_k + h M⁻¹(c_i p_k - h Σ_j (A²)_ij ∇V(Q_j));
///
/// where that is seen to contract so slowly that it
/// costs more, by simplified Newton iteration with H_zz in the middle of the step (StageNewton, if it has a matrix).
/// Both go on until the next correction would be lost in rounding a thousand times over, or until corrections stagnate,
/// and the increment is kept with what its rounding loses. A step that neither finds is approached through shorter
/// ones, unless it is a trial.
///
/// The slope of E_k comes from the node laws at both ends of the step, E_k - H = (s+1) h^s η + O(h^(s+1)) with signs
/// that agree: dE/dh = s (E_k - (H(z_k) + H(z_{k+1}))/2)/h (1 + O(h²)). There is no node law in closed form.
/// \throws std::invalid_argument if
/// sizes do not fit, `stages` is not in 1 … 8, or H is not finite at z_0
[[nodiscard]] std::unique_ptr<OneStepScheme> make_gauss_scheme(const Hamiltonian& hamiltonian, int stages,
                                                               std::span<const double> z_0);

}  // namespace rubato
