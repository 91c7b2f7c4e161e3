#pragma once

#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include <rubato/formula/expression.hpp>

/// Arithmetic of vectors within norm and dot. Used by parse.cpp.
namespace rubato::formula {

/// What stands between operators: a number, or, inside norm and dot, a vector, with its components.
struct Operand {
  Expression number = {};
  std::vector<Expression> vector = {};

  [[nodiscard]] bool is_vector() const { return !vector.empty(); }
};

/// Each component of one or two operands; a number stands for every component.
template <typename Function>
Operand by_component(const Operand& a, const Operand& b, Function function) {
  if (!a.is_vector() && !b.is_vector()) {
    return {function(a.number, b.number)};
  }
  Operand result;
  for (std::size_t i = 0; i < std::max(a.vector.size(), b.vector.size()); ++i) {
    result.vector.push_back(function(a.is_vector() ? a.vector[i] : a.number, b.is_vector() ? b.vector[i] : b.number));
  }
  return result;
}

/// Why `symbol` cannot stand between two operands; empty if it can: sums take two vectors of one length, a vector is
/// multiplied by a number, and divided by one.
[[nodiscard]] std::string refusal(char symbol, const Operand& a, const Operand& b);

/// Σ a_i b_i, from left to right; of vectors of one length, at least 1.
[[nodiscard]] Expression scalar_product(std::span<const Expression> a, std::span<const Expression> b);

}  // namespace rubato::formula
