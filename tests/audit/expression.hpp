#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace audit {

/// A formula as the generator of problems builds it: printed for the problem file, evaluated here, and nothing in
/// common with how the library reads and evaluates what was printed.
class Expression {
public:
  enum class Kind { number, variable, add, subtract, multiply, divide, integer_power, real_power, sin, cos, exp, log };

  Expression(double number);  // NOLINT: numbers are formulas
  static Expression variable(std::size_t index);

  friend Expression operator+(const Expression& a, const Expression& b) { return {Kind::add, a, b}; }
  friend Expression operator-(const Expression& a, const Expression& b) { return {Kind::subtract, a, b}; }
  friend Expression operator*(const Expression& a, const Expression& b) { return {Kind::multiply, a, b}; }
  friend Expression operator/(const Expression& a, const Expression& b) { return {Kind::divide, a, b}; }
  friend Expression sin(const Expression& a) { return {Kind::sin, a}; }
  friend Expression cos(const Expression& a) { return {Kind::cos, a}; }
  friend Expression exp(const Expression& a) { return {Kind::exp, a}; }
  friend Expression log(const Expression& a) { return {Kind::log, a}; }
  /// a^exponent, an integer of at least 1
  static Expression raised(const Expression& a, int exponent);
  /// a^exponent for a > 0
  static Expression raised(const Expression& a, double exponent);

  [[nodiscard]] std::string text(std::span<const std::string> names) const;

  /// The formula with other formulas in the place of its variables.
  [[nodiscard]] Expression with(std::span<const Expression> values) const;

  template <typename T>
  [[nodiscard]] T operator()(std::span<const T> variables) const {
    return evaluate(*node_, variables);
  }

  /// True if a variable numbered first … end - 1 is in it.
  [[nodiscard]] bool depends_on(std::size_t first, std::size_t end) const;
  /// The sum of those terms of the outermost sum for which `keep` is true.
  [[nodiscard]] Expression terms_where(const std::function<bool(const Expression&)>& keep) const;

  /// The numbers among the terms of the outermost sum, added up.
  [[nodiscard]] double added_constant() const { return added_constant(*node_); }

  /// Σ |term| over the terms of the outermost sum that are no constants.
  template <typename T>
  [[nodiscard]] long double sum_of_magnitudes(std::span<const T> variables) const {
    return sum_of_magnitudes(*node_, variables);
  }

private:
  struct Node {
    Kind kind = Kind::number;
    double number = 0.0;    ///< or the exponent of a real power
    std::size_t index = 0;  ///< of a variable, or the exponent of an integer power
    std::shared_ptr<const Node> left = nullptr, right = nullptr;
  };

  Expression(Kind kind, const Expression& a);
  Expression(Kind kind, const Expression& a, const Expression& b);
  explicit Expression(std::shared_ptr<const Node> node) : node_(std::move(node)) {}

  template <typename T>
  static T evaluate(const Node& node, std::span<const T> variables) {
    const auto left = [&] { return evaluate(*node.left, variables); };
    const auto right = [&] { return evaluate(*node.right, variables); };
    switch (node.kind) {
      case Kind::number: return constant(variables[0], node.number);
      case Kind::variable: return variables[node.index];
      case Kind::add: return left() + right();
      case Kind::subtract: return left() - right();
      case Kind::multiply: return left() * right();
      case Kind::divide: return left() / right();
      case Kind::integer_power: {
        const T base = left();
        T result = base;
        for (std::size_t i = 1; i < node.index; ++i) {
          result = result * base;
        }
        return result;
      }
      case Kind::real_power: return power(left(), static_cast<long double>(node.number));
      case Kind::sin: return sin(left());
      case Kind::cos: return cos(left());
      case Kind::exp: return exp(left());
      case Kind::log: return log(left());
    }
    return variables[0];
  }

  static double added_constant(const Node& node) {
    const bool sum = node.kind == Kind::add || node.kind == Kind::subtract;
    return node.kind == Kind::number ? node.number
           : sum ? added_constant(*node.left) + (node.kind == Kind::add ? 1 : -1) * added_constant(*node.right)
                 : 0.0;
  }

  template <typename T>
  static long double sum_of_magnitudes(const Node& node, std::span<const T> variables) {
    if (node.kind == Kind::add || node.kind == Kind::subtract) {
      return sum_of_magnitudes(*node.left, variables) + sum_of_magnitudes(*node.right, variables);
    }
    return node.kind == Kind::number ? 0.0L : magnitude_of(node, variables);
  }
  /// The same of a sum in a product; numbers count there.
  template <typename T>
  static long double magnitude_of(const Node& node, std::span<const T> variables) {
    switch (node.kind) {
      case Kind::add:
      case Kind::subtract: return magnitude_of(*node.left, variables) + magnitude_of(*node.right, variables);
      case Kind::multiply: return magnitude_of(*node.left, variables) * magnitude_of(*node.right, variables);
      case Kind::divide: return magnitude_of(*node.left, variables) / magnitude(evaluate(*node.right, variables));
      default: return magnitude(evaluate(node, variables));
    }
  }

  template <typename T>
  static T constant(const T& like, double number) {
    if constexpr (requires { like.shape(); }) {
      return T(like.shape(), static_cast<long double>(number));
    } else {
      return T(static_cast<long double>(number));
    }
  }

  [[nodiscard]] int precedence() const;
  [[nodiscard]] std::string inside(std::span<const std::string> names, int precedence) const;

  std::shared_ptr<const Node> node_;
};

}  // namespace audit
