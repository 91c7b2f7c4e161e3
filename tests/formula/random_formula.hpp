#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include <rapidcheck.h>

#include <rubato/formula/expression.hpp>

/// Random formulas, and an evaluation of the graph that shares nothing with the library's.
namespace rubato::formula::testing {

/// One seed for every run unless RC_PARAMS says otherwise, so that a failure can be seen again.
inline const bool seeded = setenv("RC_PARAMS", "seed=271828 max_success=400", 0) == 0;

/// Picks of (operation, first argument, second argument): all shrinkable small numbers.
using Recipe = std::vector<std::tuple<int, int, int>>;

inline rc::Gen<Recipe> recipes(std::size_t longest) {
  const auto pick = rc::gen::inRange(0, 1000);
  return rc::gen::resize(static_cast<int>(longest), rc::gen::container<Recipe>(rc::gen::tuple(pick, pick, pick)));
}

inline const std::array<std::string, 3> names{"x", "y", "z"};
inline const std::array<double, 10> numbers{0.5, 2.0, 3.0, -1.5, 0.1, 1e-3, 7.0, -2.0, 0.0, 1e5};
inline const std::array<double, 11> exponents{2.0, 3.0, -1.0, -2.0, 0.5, 1.5, -0.5, 5.0, 10.0, -7.0, 0.0};

struct Choice {
  bool powers = true;
  bool kinks = true;  ///< abs, sign, min, max
};

inline bool is_kink(Operation operation) {
  return operation == Operation::abs || operation == Operation::sign || operation == Operation::min ||
         operation == Operation::max;
}

/// All formulas made on the way, the last being the deepest.
inline std::vector<Expression> build(Graph& graph, const Recipe& recipe, Choice choice = {}) {
  std::vector<Operation> operations;
  for (auto code = static_cast<int>(Operation::add); code <= static_cast<int>(Operation::max); ++code) {
    const auto operation = static_cast<Operation>(code);
    if ((choice.powers || operation != Operation::power) && (choice.kinks || !is_kink(operation))) {
      // The four operations of arithmetic bind formulas together: they come oftener.
      operations.insert(operations.end(), code <= static_cast<int>(Operation::divide) ? 4U : 1U, operation);
    }
  }
  std::vector<Expression> made;
  for (const std::string& name : names) {
    made.push_back(graph.variable(name));
  }
  const auto at = [](const auto& list, int pick) { return list[static_cast<std::size_t>(pick) % list.size()]; };
  for (const auto& [what, first, second] : recipe) {
    const Operation operation = at(operations, what);
    const Expression a = at(made, first);
    if (arity(operation) == 1) {
      made.push_back(graph.make(operation, a));
    } else if (operation == Operation::power && second % 3 != 0) {
      made.push_back(pow(a, at(exponents, second)));
    } else {
      const Expression b = second % 4 == 0 ? graph.constant(at(numbers, second / 4)) : at(made, second);
      made.push_back(first % 7 == 0 ? graph.make(operation, b, a) : graph.make(operation, a, b));
    }
  }
  return made;
}

/// The value of the graph at a point, in the number type T.
template <typename T>
T evaluate(Expression formula, const std::vector<T>& point) {
  const Graph& graph = *formula.graph();
  std::vector<T> v(formula.index() + 1);
  for (NodeIndex i = 0; i <= formula.index(); ++i) {
    const Node& node = graph.node(i);
    const T a = arity(node.operation) >= 1 ? v[node.a] : T(0);
    const T b = arity(node.operation) == 2 ? v[node.b] : T(0);
    using std::abs, std::sin, std::cos, std::tan, std::exp, std::log, std::sqrt;
    switch (node.operation) {
      case Operation::constant: v[i] = static_cast<T>(node.value); break;
      case Operation::variable: v[i] = node.a < point.size() ? point[node.a] : T(0); break;
      case Operation::add: v[i] = a + b; break;
      case Operation::subtract: v[i] = a - b; break;
      case Operation::multiply: v[i] = a * b; break;
      case Operation::divide: v[i] = a / b; break;
      case Operation::negate: v[i] = -a; break;
      case Operation::power: v[i] = std::pow(a, b); break;
      case Operation::sin: v[i] = sin(a); break;
      case Operation::cos: v[i] = cos(a); break;
      case Operation::tan: v[i] = tan(a); break;
      case Operation::asin: v[i] = std::asin(a); break;
      case Operation::acos: v[i] = std::acos(a); break;
      case Operation::atan: v[i] = std::atan(a); break;
      case Operation::atan2: v[i] = std::atan2(a, b); break;
      case Operation::sinh: v[i] = std::sinh(a); break;
      case Operation::cosh: v[i] = std::cosh(a); break;
      case Operation::tanh: v[i] = std::tanh(a); break;
      case Operation::asinh: v[i] = std::asinh(a); break;
      case Operation::acosh: v[i] = std::acosh(a); break;
      case Operation::atanh: v[i] = std::atanh(a); break;
      case Operation::exp: v[i] = exp(a); break;
      case Operation::log: v[i] = log(a); break;
      case Operation::sqrt: v[i] = sqrt(a); break;
      case Operation::cbrt: v[i] = std::cbrt(a); break;
      case Operation::abs: v[i] = abs(a); break;
      case Operation::sech: v[i] = 1 / std::cosh(a); break;
      case Operation::csch: v[i] = 1 / std::sinh(a); break;
      case Operation::sign: v[i] = std::isnan(a) ? a : static_cast<T>((a > 0) - (a < 0)); break;
      case Operation::min: v[i] = std::isnan(a) || std::isnan(b) ? a + b : std::min(a, b); break;
      case Operation::max: v[i] = std::isnan(a) || std::isnan(b) ? a + b : std::max(a, b); break;
      default: v[i] = std::numeric_limits<double>::quiet_NaN(); break;  // later ones: special_test.cpp
    }
  }
  return v[formula.index()];
}

}  // namespace rubato::formula::testing
