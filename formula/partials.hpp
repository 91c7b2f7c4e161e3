#pragma once

#include <vector>

#include <rubato/formula/expression.hpp>

/// Local derivatives of the operations, and the arithmetic in which derivatives are assembled. Used by
/// differentiate.cpp.
namespace rubato::formula {

/// coefficient · factor, where an empty factor stands for 1. Keeping numbers apart from nodes lets them multiply out
/// before anything is built: the derivative of x²/2 is x, not 0.5·(2·x).
struct Scaled {
  double coefficient = 1.0;
  Expression factor = {};

  [[nodiscard]] bool is_zero() const { return coefficient == 0.0; }
};

[[nodiscard]] Scaled scaled(Graph& graph, Expression expression);  ///< with its numerical factor split off
[[nodiscard]] Scaled times(Graph& graph, const Scaled& x, const Scaled& y);
[[nodiscard]] Scaled square(Graph& graph, const Scaled& x);
[[nodiscard]] Expression materialize(Graph& graph, const Scaled& x);

/// The sum of the terms (reordered on the way): equal factors are collected, and the sum is canonical up to a factor,
/// so that a sum and its negative share one node. The sum of no terms is 0.
[[nodiscard]] Scaled sum_of(Graph& graph, std::vector<Scaled>& terms);

/// φ_a and φ_b of the node φ(a, b); what is not asked for is zero.
struct FirstPartials {
  Scaled a{0.0}, b{0.0};
};
[[nodiscard]] FirstPartials first_partials(Graph& graph, NodeIndex index, bool of_a, bool of_b);

/// φ_aa, φ_ab and φ_bb, zero where they vanish identically.
struct SecondPartials {
  Scaled aa{0.0}, ab{0.0}, bb{0.0};
};
[[nodiscard]] SecondPartials second_partials(Graph& graph, NodeIndex index, bool of_a, bool of_b);

}  // namespace rubato::formula
