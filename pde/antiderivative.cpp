#include <rubato/pde/antiderivative.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include <rubato/pde/polynomials.hpp>

namespace rubato {

namespace {

using formula::Expression;
using formula::Operation;

class Antiderivative {
public:
  explicit Antiderivative(Expression u) : graph_(*u.graph()), u_(u) {}

  [[nodiscard]] std::optional<Expression> integral_of(Expression e) {
    if (!has(e)) {
      return e * u_;
    }
    if (e == u_) {
      return 0.5 * pow(u_, 2.0);
    }
    const formula::Node node = graph_.node(e.index());
    const Expression a(&graph_, node.a), b(&graph_, node.b);
    const auto scaled = [&](std::optional<Expression> integral, Expression factor) {
      return integral ? std::optional(factor * *integral) : std::nullopt;
    };
    switch (node.operation) {
      case Operation::add:
      case Operation::subtract: {
        const auto one = integral_of(a), other = integral_of(b);
        if (!one || !other) {
          return std::nullopt;
        }
        return node.operation == Operation::add ? *one + *other : *one - *other;
      }
      case Operation::negate: return scaled(integral_of(a), graph_.constant(-1.0));
      case Operation::multiply:
        return !has(a) ? scaled(integral_of(b), a) : !has(b) ? scaled(integral_of(a), b) : of_quotient(e);
      case Operation::divide: return !has(b) ? scaled(integral_of(a), 1.0 / b) : of_quotient(e);
      case Operation::max:
      case Operation::min: {  // one-sided: a rope that only pulls
        const Expression other = a.is_constant(0.0) ? b : a;
        const Expression slope = formula::derivative(other, u_);
        if ((!a.is_constant(0.0) && !b.is_constant(0.0)) || has(slope)) {
          return std::nullopt;
        }
        return pow(e, 2.0) / (2.0 * slope);
      }
      default: break;
    }
    // A function of a u + b.
    const Expression slope = formula::derivative(a, u_);
    if (has(slope)) {
      return of_quotient(e);
    }
    switch (node.operation) {
      case Operation::power:
        if (b.is_constant(-1.0)) {
          return log(abs(a)) / slope;
        }
        if (b.is_constant()) {
          return pow(a, b.constant_value() + 1.0) / ((b.constant_value() + 1.0) * slope);
        }
        return std::nullopt;
      case Operation::sqrt: return pow(a, 1.5) / (1.5 * slope);
      case Operation::tan: return -log(abs(cos(a))) / slope;
      case Operation::tanh: return log(cosh(a)) / slope;
      case Operation::log: return a * (log(a) - 1.0) / slope;
      case Operation::sin: return -cos(a) / slope;
      case Operation::cos: return sin(a) / slope;
      case Operation::exp: return exp(a) / slope;
      case Operation::sinh: return cosh(a) / slope;
      case Operation::cosh: return sinh(a) / slope;
      default: return std::nullopt;
    }
  }

private:
  [[nodiscard]] bool has(Expression e) const {
    const std::vector<std::size_t> variables = formula::variables_of(e);
    return std::ranges::find(variables, graph_.node(u_.index()).a) != variables.end();
  }
  [[nodiscard]] Expression at(Expression e, Expression value) const {
    return formula::substitute(std::array{e}, graph_, std::array{u_}, std::array{value}).front();
  }

  /// Of a polynomial divided by a power of a u + b, or of u times a function of u².
  [[nodiscard]] std::optional<Expression> of_quotient(Expression e) {
    const auto [above, below] = fraction(e);
    if (auto integral = of_rational(above, below)) {
      return integral;
    }
    const auto even = by_square(e);
    const auto integral = even && even->is_odd ? integral_of(even->factor) : std::nullopt;
    return integral ? std::optional(0.5 * at(*integral, pow(u_, 2.0))) : std::nullopt;
  }
  /// Numerator and denominator.
  [[nodiscard]] std::pair<Expression, Expression> fraction(Expression e) {
    const formula::Node node = graph_.node(e.index());
    const Expression a(&graph_, node.a), b(&graph_, node.b);
    if (node.operation == Operation::multiply || node.operation == Operation::divide) {
      const auto one = fraction(a), other = fraction(b);
      return node.operation == Operation::multiply ? std::pair(one.first * other.first, one.second * other.second)
                                                   : std::pair(one.first * other.second, one.second * other.first);
    }
    if (node.operation == Operation::power && b.is_constant() && b.constant_value() < 0.0) {
      return {graph_.constant(1.0), pow(a, -b.constant_value())};
    }
    return {e, graph_.constant(1.0)};
  }
  [[nodiscard]] std::optional<Expression> of_rational(Expression above, Expression below) {
    double n = 1.0;
    if (const formula::Node node = graph_.node(below.index()); node.operation == Operation::power) {
      const Expression exponent(&graph_, node.b);
      if (!exponent.is_constant()) {
        return std::nullopt;
      }
      n = exponent.constant_value();
      below = Expression(&graph_, node.a);
    }
    const Expression slope = formula::derivative(below, u_);
    const std::map<formula::NodeIndex, std::size_t> number{{u_.index(), 0}};
    const auto polynomial = Polynomials(graph_, number)(above);
    if (has(slope) || slope.is_constant(0.0) || !polynomial || polynomial->empty()) {
      return std::nullopt;
    }
    std::vector<Expression> coefficients(polynomial->rbegin()->first.size() + 1, graph_.constant(0.0));
    for (const auto& [monomial, coefficient] : *polynomial) {
      coefficients[monomial.size()] = coefficient;
    }
    // By powers of u - root, below being slope (u - root).
    const Expression root = -at(below, graph_.constant(0.0)) / slope;
    Expression sum = graph_.constant(0.0);
    for (std::size_t k = 0; k < coefficients.size(); ++k) {
      for (std::size_t j = coefficients.size() - 1; j-- > k;) {
        coefficients[j] = coefficients[j] + root * coefficients[j + 1];
      }
      const double power = static_cast<double>(k) - n + 1.0;
      sum = sum + coefficients[k] / pow(slope, static_cast<double>(k) + 1.0) *
                      (power == 0.0 ? log(abs(below)) : pow(below, power) / power);
    }
    return sum;
  }

  /// A function of u², or u times one. The variable of the factor is u as well, and stands for u².
  struct OfSquare {
    bool is_odd = false;
    Expression factor;
  };
  [[nodiscard]] std::optional<OfSquare> by_square(Expression e) {
    if (!has(e)) {
      return OfSquare{false, e};
    }
    if (e == u_) {
      return OfSquare{true, graph_.constant(1.0)};
    }
    const formula::Node node = graph_.node(e.index());
    const auto a = by_square(Expression(&graph_, node.a));
    if (!a) {
      return std::nullopt;
    }
    if (formula::arity(node.operation) == 1) {
      return a->is_odd && node.operation != Operation::negate
                 ? std::nullopt
                 : std::optional(OfSquare{a->is_odd, graph_.make(node.operation, a->factor)});
    }
    const auto b = by_square(Expression(&graph_, node.b));
    if (!b) {
      return std::nullopt;
    }
    const Expression made = graph_.make(node.operation, a->factor, b->factor);
    switch (node.operation) {
      case Operation::add:
      case Operation::subtract: return a->is_odd == b->is_odd ? std::optional(OfSquare{a->is_odd, made}) : std::nullopt;
      case Operation::multiply: return OfSquare{a->is_odd != b->is_odd, a->is_odd && b->is_odd ? u_ * made : made};
      case Operation::divide: return OfSquare{a->is_odd != b->is_odd, !a->is_odd && b->is_odd ? made / u_ : made};
      default: break;
    }
    if (!a->is_odd && !b->is_odd) {
      return OfSquare{false, made};
    }
    const double exponent =
        node.operation == Operation::power && b->factor.is_constant() ? b->factor.constant_value() : 0.5;
    if (b->is_odd || exponent != std::floor(exponent)) {
      return std::nullopt;
    }
    const double squares = std::floor(0.5 * exponent);
    return OfSquare{exponent != 2.0 * squares, made * pow(u_, squares)};
  }

  formula::Graph& graph_;
  Expression u_;
};

}  // namespace

std::optional<formula::Expression> antiderivative(formula::Expression e, formula::Expression u) {
  return Antiderivative(u).integral_of(e);
}

}  // namespace rubato
