#pragma once

#include <array>
#include <string>
#include <string_view>

#include <rubato/problem/problem.hpp>

namespace rubato {

/// How the form of an equation is written.
enum class FormStyle { text, toml, latex };
inline constexpr std::array<std::string_view, 3> form_styles = {"text", "toml", "latex"};

/// What the program made of a field equation, or what it has found about one that is stated by M, K and S: the
/// Lagrangian and the Hamiltonian density, the rows of M z_t + Σ K_a z_{x_a} = ∇S(z), M, K and S, constraints and
/// multipliers, symmetries with their densities (translations, linear and affine ones, scalings, Galilei's), the
/// dispersion relation of waves about 0, and which schemes take it, or why not. As toml: [multisymplectic] and the
/// symmetries that were found, to put into a problem file in place of [field]. As latex: the mathematical part. \throws
/// std::invalid_argument for an orbit
[[nodiscard]] std::string form_of(const Problem& problem, FormStyle style);

}  // namespace rubato
