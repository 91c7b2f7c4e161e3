// Formulas as sums: the constants added to them, the size of their terms, and their rounding errors.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <rubato/formula/parse.hpp>
#include <rubato/formula/reachable.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/formula/sum.hpp>

using namespace rubato::formula;

namespace {

constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();

Expression parsed(Graph& graph, const std::string& text) {
  const ParseContext context{.resolve = [&](std::string_view name) { return std::optional(graph.variable(name)); },
                             .known_names = {}};
  return parse(text, graph, context);
}

/// The formula in the 64 bits of long double, node by node: shares nothing with the evaluation in doubles.
long double exactly(Expression expression, double x, double y) {
  const Graph& graph = *expression.graph();
  const std::vector<Expression> roots = {expression};
  std::vector<long double> value(graph.size());
  for (const NodeIndex index : reachable(roots)) {
    const Node& node = graph.node(index);
    const long double a = value[node.a];
    const long double b = value[node.b];
    switch (node.operation) {
      case Operation::constant: value[index] = node.value; break;
      case Operation::variable: value[index] = graph.variable_name(node.a) == "x" ? x : y; break;
      case Operation::add: value[index] = a + b; break;
      case Operation::subtract: value[index] = a - b; break;
      case Operation::multiply: value[index] = a * b; break;
      case Operation::divide: value[index] = a / b; break;
      case Operation::negate: value[index] = -a; break;
      case Operation::power: value[index] = std::pow(a, b); break;
      case Operation::sin: value[index] = std::sin(a); break;
      case Operation::cos: value[index] = std::cos(a); break;
      case Operation::tan: value[index] = std::tan(a); break;
      case Operation::exp: value[index] = std::exp(a); break;
      case Operation::log: value[index] = std::log(a); break;
      case Operation::sqrt: value[index] = std::sqrt(a); break;
      case Operation::cbrt: value[index] = std::cbrt(a); break;
      case Operation::tanh: value[index] = std::tanh(a); break;
      case Operation::sinh: value[index] = std::sinh(a); break;
      case Operation::cosh: value[index] = std::cosh(a); break;
      case Operation::atan: value[index] = std::atan(a); break;
      case Operation::atan2: value[index] = std::atan2(a, b); break;
      case Operation::abs: value[index] = std::abs(a); break;
      default: FAIL("an operation that this test does not know");
    }
  }
  return value[expression.index()];
}

}  // namespace

TEST_CASE("constants that are added to a formula are taken out of it, and leave the rest as it would be without them") {
  struct Case {
    std::string with, without;
    double constant;
  };
  const std::vector<Case> cases = {
      {"x^2/2 - cos(y) + 3", "x^2/2 - cos(y)", 3.0},
      {"3 + x^2/2 - cos(y)", "x^2/2 - cos(y)", 3.0},
      {"x^2/2 + 3 - cos(y) - 1", "x^2/2 - cos(y)", 2.0},
      {"x^2/2 + (1 - cos(y))", "x^2/2 + (-cos(y))", 1.0},
      {"(x^2 + 6)/2 - cos(y)", "x^2/2 - cos(y)", 3.0},
      {"-(x^2 - 5) + y", "-x^2 + y", 5.0},
      {"2*(x*y + 4*(1 + sin(x)))", "2*(x*y + 4*sin(x))", 8.0},
      {"(3 - x)*0.5", "(-x)*0.5", 1.5},
      {"7 - 2 + x", "x", 5.0},
  };
  for (const Case& example : cases) {
    INFO(example.with);
    Graph graph;
    const auto [rest, constant] = separate_constant(parsed(graph, example.with));
    CHECK(rest == parsed(graph, example.without));
    CHECK(constant == example.constant);
  }
}

TEST_CASE("constants that are not added to a formula stay in it") {
  for (const char* const text :
       {"x^2/2 - cos(y)", "sin(x + 3)", "(x + 1)*(y + 2)", "1/(x + 3)", "(x + 1)^2", "x*y/3"}) {
    INFO(text);
    Graph graph;
    const Expression expression = parsed(graph, text);
    const auto [rest, constant] = separate_constant(expression);
    CHECK(rest == expression);
    CHECK(constant == 0.0);
  }
  Graph graph;
  const auto [rest, constant] = separate_constant(parsed(graph, "4 - 1"));
  CHECK(rest.is_constant(0.0));
  CHECK(constant == 3.0);
}

TEST_CASE("the size of a sum is its value, or where its terms cancel a part of their magnitudes") {
  Graph graph;
  const Expression sum = parsed(graph, "x^2/2 - 3*(cos(y) - x*y) + y");
  const std::vector<Expression> inputs = {graph.variable("x"), graph.variable("y")};
  SumSizeEvaluator size(sum_size_code(sum, inputs));
  const double x = 1.25, y = -0.75;
  const double at[] = {x, y};
  CHECK(size(at).terms == Approx(std::abs(x * x / 2 - 3 * (std::cos(y) - x * y) + y)).epsilon(1e-14));
  // Where they cancel, a part of the sum of their magnitudes.
  SumSizeEvaluator cancelling(sum_size_code(parsed(graph, "2*x - y*y + 3"), inputs));
  const double zero[] = {0.5, 2.0};
  CHECK(cancelling(zero).terms == Approx(0.03 * (1.0 + 4.0 + 3.0)).epsilon(1e-14));
}

TEST_CASE("the running error bound bounds what rounding makes of a formula, and not by much more") {
  const std::vector<std::string> formulas = {
      "x^2/2 - cos(y)",
      "(x^2 + 2*y^2 - 2*x*y*cos(x-y))/(2*(1+sin(x-y)^2)) - 2*cos(x) - cos(y)",
      "1/sqrt(x^2 + y^2) - x*y",
      "exp(x)*sin(y) - tanh(x*y) + log(1 + x^2)",
      "(x - y)^3 - (x^3 - 3*x^2*y + 3*x*y^2 - y^3)",
      "atan2(y, x) + atan(x) - cbrt(x*y) + x^7",
      "sqrt(1 + x^2) - sqrt(1 + y^2) + sinh(x)/cosh(y)",
      "x^1.7 + abs(y)^2.5 + tan(x)",
      "1000*(x - 0.3) + y - 1000*x",
  };
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0.05, 2.0);
  double total = 0.0;
  for (const std::string& text : formulas) {
    INFO(text);
    Graph graph;
    const std::vector<Expression> inputs = {graph.variable("x"), graph.variable("y")};
    const std::vector<Expression> outputs = {parsed(graph, text)};
    RoundingEvaluator evaluator{Bytecode(outputs, inputs)};
    ScalarEvaluator plain{Bytecode(outputs, inputs)};
    double worst = 0.0;  // error over bound
    for (int i = 0; i < 2000; ++i) {
      const double at[] = {uniform(random), uniform(random)};
      const double errors[] = {0.0, 0.0};
      evaluator.run(at, errors);
      double value = 0.0;
      plain(at, {&value, 1});
      REQUIRE(evaluator.value(0) == value);
      const auto error = static_cast<double>(std::abs(value - exactly(outputs[0], at[0], at[1])));
      worst = std::max(worst, error / (unit * evaluator.bound(0)));
    }
    CHECK(worst <= 1.0);
    // A bound fifty times larger than what happens among 2000 points would say nothing.
    CHECK(worst > 0.02);
    total += worst;
  }
  CHECK(total / static_cast<double>(formulas.size()) > 0.1);
}

TEST_CASE("errors of the inputs are carried along") {
  Graph graph;
  const std::vector<Expression> inputs = {graph.variable("x"), graph.variable("y")};
  const std::vector<Expression> outputs = {parsed(graph, "x*x*y - sin(x)/y")};
  RoundingEvaluator evaluator{Bytecode(outputs, inputs)};
  const double at[] = {0.8, 1.7};
  const double none[] = {0.0, 0.0};
  evaluator.run(at, none);
  const double own = evaluator.bound(0);
  // So large that what the operations round at is nothing beside them: |∂f/∂x| 1e6 + |∂f/∂y| 1e7 of the terms.
  const double errors[] = {1e6, 1e7};
  evaluator.run(at, errors);
  const double by_x = 2.0 * 0.8 * 1.7 + std::cos(0.8) / 1.7;
  const double by_y = 0.8 * 0.8 + std::sin(0.8) / (1.7 * 1.7);
  CHECK(evaluator.bound(0) - own == Approx(1e6 * by_x + 1e7 * by_y).epsilon(1e-6));
}

TEST_CASE("where a derivative is infinite the size of the terms stands in for the bound") {
  Graph graph;
  const std::vector<Expression> inputs = {graph.variable("x")};
  SumSizeEvaluator size(sum_size_code(parsed(graph, "acos(x) + 2"), inputs));
  const double at[] = {1.0};
  const SumSize at_edge = size(at);
  CHECK(std::isfinite(at_edge.rounding));
  CHECK(at_edge.terms == 2.0);
}
