#pragma once

#include <map>
#include <optional>
#include <utility>

#include <rubato/formula/expression.hpp>

/// Formulas of complex numbers, written by their real and imaginary parts.
namespace rubato {

/// A complex number of formulas; no imaginary part: 0.
struct Complex {
  formula::Expression re;
  std::optional<formula::Expression> im;
};

/// A formula with variables that are not real, such as i and psi, in its real and imaginary part. Known of complex
/// numbers are sums, products, quotients, powers with natural exponents, and exp.
class ComplexParts {
public:
  /// \param parts what variables stand for that are not real, by their nodes
  ComplexParts(formula::Graph& graph, std::map<formula::NodeIndex, Complex> parts)
      : graph_(graph), parts_(std::move(parts)) {}

  /// \throws std::invalid_argument at another function of a complex number
  [[nodiscard]] Complex operator()(formula::Expression e);

private:
  [[nodiscard]] Complex of(formula::Operation operation, const Complex& a, const Complex& b);

  formula::Graph& graph_;
  std::map<formula::NodeIndex, Complex> parts_;  ///< and what was found
};

}  // namespace rubato
