#pragma once

#include <memory>
#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/segment_scheme.hpp>

namespace rubato {

/// The production form of the midpoint 𝕃 (3.15), A = p̄·(q_1-q_0) - h H(z̄) (theory, section 2.1): with the defect
///
///     d_k = δ_k - h_k J∇H(z̄_k),   E_k = H(z̄_k),   z̄_k = z_k + δ_k/2,
///
/// the two-step equation (3.3) is d_k + d_{k-1} = 0; started with d_0 = 0 it is d_k = 0, the implicit midpoint rule,
/// for any levels. This form does not accumulate the parasite d_k = (-1)^k d_0. Order 2; symplectic at fixed levels;
/// with variable ones it preserves dp∧dq - dE∧dt, and at fixed E dp∧dq with ∂h/∂z included.
///
/// The increment δ is solved by simplified Newton, with (I - ½h J H_zz)⁻¹ factored once a step at the predicted
/// midpoint and again when it contracts poorly, within its band where few degrees of freedom meet in an entry of H_zz
/// (HessianBand), until the corrections stagnate. z is summed with compensation. \throws
/// std::invalid_argument if z_0 has not 2n entries, is not finite, or H or ∇H is not finite there
[[nodiscard]] std::unique_ptr<OneStepScheme> make_midpoint_scheme(const Hamiltonian& hamiltonian,
                                                                  std::span<const double> z_0);

}  // namespace rubato
