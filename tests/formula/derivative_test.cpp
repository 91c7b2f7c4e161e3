#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <ginac/ginac.h>

#include <rubato/formula/expression.hpp>
#include <rubato/formula/parse.hpp>

#include "random_formula.hpp"

using namespace rubato::formula;
using rubato::formula::testing::evaluate;

namespace {

using Real = long double;
using Point = std::vector<Real>;
const std::vector<std::string> xyz{"x", "y", "z"};

std::vector<Expression> variables_in(Graph& graph) {
  return {graph.variable("x"), graph.variable("y"), graph.variable("z")};
}

struct Difference {
  Real value, tolerance;
};

/// Central differences at h and h/2, extrapolated: D = (4 D(h/2) - D(h))/3 = f' + O(h⁴). Where the series is in its
/// asymptotic range, |D(h/2) - D(h)| ≈ h² f'''/8 is far above the remaining error h⁴ f⁽⁵⁾/480: it is the tolerance.
/// Added is the rounding of f and of its parts, which may cancel from sizes up to about 1e4 here (the numbers go from
/// 1e-3 to 1e5): 1e-17 ≈ 90·2⁻⁶³ of them, over h. Where the tolerance is not small, there is no verdict.
std::optional<Difference> central_difference(Expression f, Point point, std::size_t variable) {
  const Real h = 1e-3L;
  const auto at = [&](Real shift) {
    Point shifted = point;
    shifted[variable] += shift;
    return evaluate(f, shifted);
  };
  const Real size = std::abs(at(h)) + std::abs(at(-h));
  const Real wide = (at(h) - at(-h)) / (2 * h);
  const Real narrow = (at(h / 2) - at(-h / 2)) / h;
  const Real wide_enough = std::abs(wide - narrow);
  const Real value = (4 * narrow - wide) / 3;
  const Real tolerance = wide_enough + 1e-17L * (size + 1e4L) / h;
  if (!std::isfinite(value) || !(tolerance < 1e-4L * (std::abs(value) + 1e-2L))) {
    return std::nullopt;
  }
  return Difference{value, tolerance};
}

/// Nothing if the differences give no verdict.
std::optional<bool> is_derivative(Expression f, Expression candidate, const Point& point, std::size_t variable) {
  const auto difference = central_difference(f, point, variable);
  const Real value = evaluate(candidate, point);
  const std::vector<double> rounded(point.begin(), point.end());
  const double double_value = evaluate(candidate, rounded);
  if (!difference || !std::isfinite(value) || !std::isfinite(double_value)) {
    return std::nullopt;
  }
  // The candidate's own rounding is below its change from double to long double, which rounds 2048 times finer.
  const Real rounding = std::abs(double_value - value) + 1e-18L;
  return std::abs(value - difference->value) <= difference->tolerance + rounding;
}

}  // namespace

TEST_CASE("gradients and Hessians of random formulas agree with central differences") {
  const Point point{0.62L, 0.37L, 0.81L};
  std::size_t firsts = 0;
  std::size_t seconds = 0;
  std::size_t wrong_caught = 0;
  CHECK(rc::check("derivatives against differences", [&] {
    Graph graph;
    const std::vector<Expression> variables = variables_in(graph);
    const Expression f = testing::build(graph, *testing::recipes(12), {.powers = true, .kinks = false}).back();
    RC_LOG() << to_string(f) << '\n';
    const std::vector<Expression> first = gradient(f, variables);
    const std::vector<Expression> second = hessian_upper(f, variables);
    std::size_t entry = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      if (const auto verdict = is_derivative(f, first[i], point, i)) {
        RC_ASSERT(*verdict);
        ++firsts;
        if (!first[i].is_constant(0.0)) {  // the twin: the derivative, wrong by a tenth
          wrong_caught += is_derivative(f, first[i] * 1.1, point, i) == false ? 1 : 0;
        }
      }
      RC_ASSERT(derivative(f, variables[i]) == first[i]);
      for (std::size_t j = i; j < 3; ++j, ++entry) {
        if (const auto verdict = is_derivative(first[i], second[entry], point, j)) {
          RC_ASSERT(*verdict);
          ++seconds;
        }
      }
    }
  }));
  CHECK(firsts > 500);
  CHECK(seconds > 1000);
  CHECK(wrong_caught > 100);
}

TEST_CASE("derivatives agree with GiNaC's") {
  const auto text =
      GENERATE(as<std::string>{},  //
               "x^3*y - z/x", "sin(x*y)*cos(z)", "tan(x)*asin(y/2) + acos(z/3)", "atan(x*y*z)", "atan2(y, x)*z",
               "sinh(x)*cosh(y)*tanh(z)", "asinh(x*y) + acosh(1 + x^2) + atanh(z/4)", "exp(-x^2 - y^2)*log(z + x)",
               "1/sqrt((x - y)^2 + (y - z)^2 + z^2)", "x^y^z", "(x^2 + y^2)^(-3/2)", "(x + y)^2.5/(x*y*z)^(1/3)",
               "2^x*y^(-2)*z^0.7", "x/(y/(z/(x + y)))", "(x*y + y*z + z*x)^4", "exp(sin(x + cos(y*z)))*x*y*z");
  CAPTURE(text);
  Graph graph;
  const std::vector<Expression> variables = variables_in(graph);
  const Expression f = parse(text, graph, xyz);

  GiNaC::symtab table;
  std::vector<GiNaC::symbol> symbols;
  GiNaC::exmap at;
  const std::array<double, 3> point{0.62, 0.37, 0.81};
  for (std::size_t i = 0; i < 3; ++i) {
    symbols.emplace_back(xyz[i]);
    table[xyz[i]] = symbols[i];
    at[symbols[i]] = GiNaC::numeric(point[i]);
  }
  // GiNaC's parser reads a^b^c from the left.
  const GiNaC::ex oracle = GiNaC::parser(table)(text == "x^y^z" ? "x^(y^z)" : text);
  const auto exact = [&](const GiNaC::ex& formula) {
    return GiNaC::ex_to<GiNaC::numeric>(formula.subs(at).evalf()).to_double();
  };
  const Point where(point.begin(), point.end());
  // GiNaC works with 17 digits; both sides lose at most some tens of roundings in these formulas: 1e-13.
  const auto close = [&](Expression ours, const GiNaC::ex& theirs) {
    const double expected = exact(theirs);
    return std::abs(static_cast<double>(evaluate(ours, where)) - expected) <= 1e-13 * (1.0 + std::abs(expected));
  };
  CHECK(close(f, oracle));
  CHECK_FALSE(close(f + 1e-9, oracle));
  const std::vector<Expression> first = gradient(f, variables);
  const std::vector<Expression> second = hessian_upper(f, variables);
  std::size_t entry = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(close(first[i], oracle.diff(symbols[i])));
    for (std::size_t j = i; j < 3; ++j, ++entry) {
      CAPTURE(i, j);
      CHECK(close(second[entry], oracle.diff(symbols[i]).diff(symbols[j])));
    }
  }
}

TEST_CASE("derivatives take their simplest form") {
  Graph graph;
  const Expression x = graph.variable("x");
  const auto d = [&](const std::string& text) { return to_string(derivative(parse(text, graph, xyz), x)); };
  CHECK(d("x^2/2") == "x");
  CHECK(d("x^2") == "2*x");
  CHECK(d("x^3") == "3*x^2");
  CHECK(d("x^0") == "0");
  CHECK(d("sqrt(x)") == "0.5*(1/sqrt(x))");
  CHECK(d("exp(2*x)") == "2*exp(2*x)");
  CHECK(d("-cos(x)") == "sin(x)");
  CHECK(d("1/x") == "-(1/x)^2");
  CHECK(d("y*z") == "0");
  CHECK(d("sign(x)*y") == "0");
  CHECK(d("abs(x)") == "sign(x)");
  CHECK(d("x - x") == "0");
}

TEST_CASE("derivatives at special points") {
  Graph graph;
  const std::vector<Expression> variables = variables_in(graph);
  const auto first = [&](const std::string& text, Real x, Real y = 1.0L) {
    return static_cast<double>(evaluate(derivative(parse(text, graph, xyz), variables[0]), Point{x, y, 1.0L}));
  };
  CHECK(first("x^2", 0.0L) == 0.0);
  CHECK(first("x^3", 0.0L) == 0.0);
  CHECK(first("x^2", -3.0L) == -6.0);
  CHECK(first("x^y", 0.0L, 2.0L) == 0.0);       // no logarithm of the base for the derivative along the base
  CHECK(first("(-2)^y*x", 1.0L, 2.0L) == 4.0);  // nor where the exponent is not the variable
  CHECK(first("abs(x)", 0.0L) == 0.0);          // kinks: the mean of both sides
  CHECK(first("min(x, 0)", 0.0L) == 0.5);
  CHECK(first("max(x, y)", 1.0L, 1.0L) == 0.5);
  CHECK(first("max(x, y)", 2.0L, 1.0L) == 1.0);
  CHECK(first("min(x, y)", 2.0L, 1.0L) == 0.0);
  // A part that does not depend on the variable is absent, however undefined it is.
  CHECK(first("x + log(y)", 1.0L, -1.0L) == 1.0);
  CHECK(first("x^2 + sqrt(y)", 1.0L, -1.0L) == 2.0);
}

TEST_CASE("the Hessian of a sparse system is sparse") {
  Graph graph;
  std::vector<Expression> variables;
  const std::size_t n = 40;
  for (std::size_t i = 0; i < n; ++i) {
    variables.push_back(graph.variable(fmt::format("q{}", i)));
  }
  Expression chain = graph.constant(0.0);
  for (std::size_t i = 0; i + 1 < n; ++i) {
    chain += 1.0 - cos(variables[i + 1] - variables[i]) + pow(variables[i], 4.0) / 4;
  }
  const std::vector<Expression> upper = hessian_upper(chain, variables);
  std::size_t entry = 0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i; j < n; ++j, ++entry) {
      CHECK(upper[entry].is_constant(0.0) == (j > i + 1));
    }
  }
}

TEST_CASE("differentiation refuses what is not a variable") {
  Graph graph;
  Graph other;
  const Expression x = graph.variable("x");
  CHECK_THROWS_AS(derivative(x * x, x * x), std::invalid_argument);
  CHECK_THROWS_AS(derivative(x * x, other.variable("x")), std::invalid_argument);
  CHECK_THROWS_AS(gradient(x, std::array{x, x}), std::invalid_argument);
  CHECK_THROWS_AS(gradient(Expression(), std::array{x}), std::invalid_argument);
}
