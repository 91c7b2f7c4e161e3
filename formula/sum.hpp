#pragma once

#include <vector>

#include <rubato/formula/expression.hpp>

/// The sum that a formula is at its top: what H or S is as a sum of energies, each of which has a size of its own,
/// while the zero of the sum is anybody's choice.
namespace rubato::formula {

/// A formula and the constant that was added to it.
struct WithoutConstant {
  Expression rest;
  double constant = 0.0;  ///< the formula is rest + constant
};

/// Takes out the constants that are added to, or subtracted from, the rest of the formula: through sums, differences,
/// signs, and products and quotients with constants. `p^2/2 - cos(q) + 3` is rest + 3, and so is `(p^2 + 6)/2 -
/// cos(q)`; those within functions or products with variables stay where they are. The rest is associated as it was, so
/// that formulas that differ by a constant alone have rests of the same value to the last bit. Nothing is changed if
/// there is no such constant; a formula that is a constant itself leaves 0.
[[nodiscard]] WithoutConstant separate_constant(Expression expression);

/// Whether a product with a sum is one term, as it is evaluated, or the terms of the product multiplied out.
enum class Products { kept, expanded };

/// Formulas whose sum is `expression`: through sums, differences, signs, and products and quotients with constants,
/// which each term then has; where products are expanded, through products of sums and quotients of a sum, too. A power
/// or a function of a sum is one term. Of what has more than some 100,000 terms, the rest stays as it is.
[[nodiscard]] std::vector<Expression> terms_of(Expression expression, Products products = Products::kept);

/// The part of the magnitudes of a sum's terms that counts where they cancel.
inline constexpr double part_that_counts = 0.03;

/// The sum of these, at least one. Short sums are added up from left to right. Of long ones the two halves are added,
/// term by term, until one is left: their rounding grows with the logarithm of their length (Higham, Accuracy and
/// Stability of Numerical Algorithms, 4.1), and several at a time can be added side by side.
[[nodiscard]] Expression folded_sum(std::vector<Expression> terms);

}  // namespace rubato::formula
