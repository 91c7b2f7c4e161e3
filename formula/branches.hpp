#pragma once

#include <array>
#include <span>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// Formulas whose piecewise functions take branches at random. With a sign s(a) = -s(-a) that changes fast with a,
///
///     sign a → s(a),    |a| → s(a) a,    max(a, b) → ½ (a + b + s(a - b)(a - b)),
///     where(a > 0, b, c) → ½ ((1 + s(a)) b + (1 - s(a)) c),
///
/// and min alike. ⌊a⌋ becomes a function with ⌊a + 1⌋ = ⌊a⌋ + 1, and exp, sinh, erf and their like take `scale` times
/// their arguments. Identities such as |-a| = |a|, |a|² = a², max + min = a + b and eᵃeᵇ = eᵃ⁺ᵇ hold on all branches.
/// max(0, x - 9) is 0 near 0 on one branch alone, so that a test at random points there does not take it for 0.
/// Formulas with loops are not changed.
/// \param into the graph of the results
[[nodiscard]] std::vector<Expression> on_other_branches(std::span<const Expression> formulas, Graph& into,
                                                        double scale);

/// True if the formulas are the same on all branches and at any scale.
[[nodiscard]] bool have_one_branch(std::span<const Expression> formulas);

/// True if a formula has a piecewise function of some of the variables: |x|, max(x, y), where(x > 0, …). Derivatives
/// that are constants then are so on each piece alone.
[[nodiscard]] bool is_piecewise(Expression formula, std::span<const Expression> variables);

/// Scales to look at one after the other: with the second exp(-1000 (x - 9)²) is not lost to underflow.
inline constexpr std::array branch_scales = {1.0, 1e-5};

/// The formulas on other branches at each of these scales, as functions of `variables`, or of all variables that they
/// have in the order in which these were made: an identity holds if all of them hold it at random points.
/// \throws std::invalid_argument as Bytecode
///@{
[[nodiscard]] std::vector<ScalarEvaluator> evaluators_on_branches(std::span<const Expression> formulas,
                                                                  std::span<const Expression> variables);
[[nodiscard]] std::vector<ScalarEvaluator> evaluators_on_branches(std::span<const Expression> formulas);
///@}

}  // namespace rubato::formula
