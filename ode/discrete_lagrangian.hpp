#pragma once

#include <string_view>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/variation/formula_action.hpp>

/// \file
/// Discrete Lagrangians 𝕃 on a segment, stated as formulas. The action of the segment is A = (t_1 - t_0)·𝕃 (3.1), on
/// the corner vector (t_0, q_0, p_0, t_1, q_1, p_1); all that follows from it is in variation/total_variation.hpp.

namespace rubato {

/// (3.15): A = p̄·(q_1 - q_0) - h H(z̄), z̄ = (z_0 + z_1)/2, h = t_1 - t_0. E = H(z̄).
[[nodiscard]] FormulaAction midpoint_action(const Hamiltonian& hamiltonian);

/// (3.23): A = p_0·(q_1 - q_0) - h H(z̄). Genuinely two-step, E = H(z̄). As an initial-value method it is violently
/// unstable (theory, section 2.2): on the oscillator of frequency ω a rounding error is multiplied by about -16/(hω)²
/// in every step. It is meant for stationary-action boundary-value problems.
[[nodiscard]] FormulaAction forward_action(const Hamiltonian& hamiltonian);

/// Any 𝕃, as a formula in t_0, t_1 and, for each coordinate and momentum `name` of `hamiltonian`, name_0 and name_1; A
/// = (t_1 - t_0)·𝕃. \throws formula::ParseError
[[nodiscard]] FormulaAction lagrangian_action(const Hamiltonian& hamiltonian, std::string_view L,
                                              const Hamiltonian::Parameters& parameters = {});

/// The action of 𝕃 - c, and the constant c that was added to 𝕃 (formula::separate_constant): the same steps, with a
/// discrete energy E larger by c. \throws formula::ParseError
struct ReducedAction {
  FormulaAction action;
  double constant = 0.0;
};
[[nodiscard]] ReducedAction reduced_lagrangian_action(const Hamiltonian& hamiltonian, std::string_view L,
                                                      const Hamiltonian::Parameters& parameters = {});

/// True if A depends on t_0 and t_1 through t_1 - t_0 alone: ∂A/∂t_0 + ∂A/∂t_1 = 0, tried at points scattered about
/// `corners`. If not, the discrete energy is not constant and (3.4) is its balance.
[[nodiscard]] bool is_autonomous(DiscreteAction& action, std::span<const double> corners);

}  // namespace rubato
