#pragma once

#include <array>
#include <span>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// The formulas with functions that are put together of pieces on other branches than those that hold: with numbers
/// s(a) = -s(-a), 1 or -1, that change fast with a,
///
///     sign a → s(a),   |a| → s(a) a,   max(a, b) → ½ (a + b + s(a - b)(a - b)),   where(a > 0, b, c) → ½ ((1 + s(a)) b
///     + (1 - s(a)) c),
///
/// min alike, ⌊a⌋ by a function with ⌊a + 1⌋ = ⌊a⌋ + 1, and exp, sinh, erf and their like of `scale` times their
/// arguments. Identities such as |-a| = |a|, |a|² = a², max + min = a + b and eᵃeᵇ = eᵃ⁺ᵇ hold on all branches. So what
/// is 0 at random points is 0, as max(0, x - 9) is not, which is 0 there by chance. Formulas with loops stay as they
/// are. \param into the graph of the results
[[nodiscard]] std::vector<Expression> on_other_branches(std::span<const Expression> formulas, Graph& into,
                                                        double scale);

/// True if the formulas are the same on all branches and at any scale.
[[nodiscard]] bool have_one_branch(std::span<const Expression> formulas);

/// Scales to look at one after the other: with the second exp(-1000 (x - 9)²) is not lost to underflow.
inline constexpr std::array branch_scales = {1.0, 1e-5};

}  // namespace rubato::formula
