// Formulas as sums: the constants added to them, the size of their terms, and what rounding makes of them.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/assemble.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/reachable.hpp>
#include <rubato/formula/rolled_rounding.hpp>
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

TEST_CASE("the bound as a formula is that of the evaluator, bit for bit") {
  struct Case {
    std::string formula;
    bool has_formula;
  };
  const std::vector<Case> cases = {
      {"x^2/2 - cos(y)", true},
      {"(x^2 + y^2)/2 + x^2*y - y^3/3", true},
      {"x^2/2 - 1/sqrt(x^2 + y^2)", true},
      {"(x^2 + 2*y^2 - 2*x*y*cos(x-y))/(2*(1+sin(x-y)^2)) - 2*cos(x) - cos(y)", true},
      {"exp(x)*sin(y) - abs(x*y) + log(1 + x^2) - 3/x^5", true},
      {"atan2(y, x) + x^7", false},
      {"x^1.7 + y", false},
  };
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-2.0, 2.0);
  for (const auto& [text, has_formula] : cases) {
    INFO(text);
    Graph graph;
    const std::vector<Expression> inputs = {graph.variable("x"), graph.variable("y")};
    const Bytecode code = sum_size_code(parsed(graph, text), inputs);
    CHECK(rounding_code(code).has_value() == has_formula);
    SumSizeEvaluator plain(code), prepared(code);
    prepared.prepare();
    double last = 0.0;
    for (int k = 0; k < 100; ++k) {
      const double at[] = {std::abs(uniform(random)), uniform(random)};
      const double errors[] = {std::abs(uniform(random)), k % 10 == 0 ? 0.0 : std::abs(uniform(random))};
      const SumSize expected = plain(at, errors), found = prepared(at, errors);
      CHECK(found.terms == expected.terms);
      CHECK(found.rounding == expected.rounding);
      CHECK(found.rounding != last);  // the twin: elsewhere it is another
      last = found.rounding;
    }
  }
}

/// What is asked of a bound that is found in another way: the same at many points, and another one elsewhere.
void check_same_bounds(const Bytecode& code, int evaluations) {
  SumSizeEvaluator plain(code), prepared(code);
  prepared.prepare();
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<double> at(code.input_count()), errors(at.size());
  double last = 0.0;
  bool same = true, moves = true;
  for (int k = 0; k < evaluations; ++k) {
    std::ranges::generate(at, [&] { return uniform(random); });
    std::ranges::generate(errors, [&] { return std::abs(uniform(random)); });
    const SumSize expected = plain(at, errors), found = prepared(at, errors);
    same = same && found.terms == expected.terms && found.rounding == expected.rounding;
    moves = moves && found.rounding != last;  // the twin: elsewhere it is another
    last = found.rounding;
  }
  CHECK(same);
  CHECK(moves);
}

std::vector<Expression> many_variables(Graph& graph, std::size_t count) {
  std::vector<Expression> result;
  for (std::size_t i = 0; i < count; ++i) {
    result.push_back(graph.variable(fmt::format("q{}", i)));
  }
  return result;
}

TEST_CASE("the bound of a long formula stays what it was when machine code of it is made") {
  Graph graph;
  const std::vector<Expression> q = many_variables(graph, 40);
  std::mt19937 random(3);
  std::uniform_int_distribution<std::size_t> any(0, q.size() - 1);
  Expression sum = q.front() * q.front();
  for (int i = 0; i < 500; ++i) {  // of no order that could be rolled up
    sum += q[any(random)] * q[any(random)] + 0.25 * (q[any(random)] - q[any(random)]) * q[any(random)];
  }
  const Bytecode code = sum_size_code(sum, q);
  REQUIRE(code.instructions().size() > 1000);  // no code at once
  REQUIRE(rounding_code(code).has_value());
  REQUIRE_FALSE(RolledRounding::of(code).has_value());
  check_same_bounds(code, 3100);  // it pays from 3000 on
}

TEST_CASE("rolled up, the bound of a chain stays what it was, and those of all it consists of") {
  if (!is_arithmetic(OpCode::add)) {
    return;  // nothing is rolled up on such a machine
  }
  constexpr std::size_t masses = 203;
  Graph graph;
  const std::vector<Expression> q = many_variables(graph, masses + 1);
  const auto of_all = [&](const std::function<Expression(Expression, Expression)>& energy) {
    Expression sum = q[0] * q[0];
    for (std::size_t i = 0; i + 2 <= masses; ++i) {
      sum += energy(q[i], q[i + 1]);
    }
    return sum;
  };
  const Expression g = q.back();  // what all have in common
  const Expression sums[] = {
      of_all([](Expression a, Expression b) { return (b - a) * (b - a) / 2.0 + 0.25 * (b - a) * (b - a) * (b - a); }),
      of_all([](Expression a, Expression b) { return (b - a) * (b - a); }),  // terms in a row
      of_all([](Expression a, Expression b) { return sqrt(1.0 + a * a) - abs(a * b) / (2.0 + pow(b, 4)); }),
      of_all([&](Expression a, Expression b) { return g * a * a + g * g * b; }),
      of_all([](Expression a, Expression b) { return 1.0 - cos(b - a) + exp(-(a * a)); }),
      of_all([](Expression a, Expression b) { return max(a, b) * a + where(a > b, a * a, b * b * b); }),
  };
  int rolled_up = 0;
  for (const Expression sum : sums) {
    const Bytecode code = sum_size_code(sum, q);
    std::optional<RolledRounding> rolled = RolledRounding::of(code);
    if (!rolled) {
      continue;
    }
    ++rolled_up;
    RoundingEvaluator plain(code);
    RolledRounding copy = *rolled;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    std::vector<double> at(q.size()), errors(q.size());
    bool same = true, copied = true;
    for (int k = 0; k < 20; ++k) {
      std::ranges::generate(at, [&] { return uniform(random); });
      std::ranges::generate(errors, [&] { return std::abs(uniform(random)); });
      errors[static_cast<std::size_t>(k)] = 0.0;
      plain.run(at, errors);
      rolled->run(at, errors);
      copy.run(at, errors);
      for (std::size_t i = 0; i < code.output_count(); ++i) {
        same = same && rolled->value(i) == plain.value(i) && rolled->bound(i) == plain.bound(i);
        copied = copied && copy.bound(i) == rolled->bound(i);
      }
    }
    CHECK(same);
    CHECK(copied);
    CHECK(rolled->bound(0) > 0.0);
    at[7] += 0.5;  // the twin: elsewhere it is another
    rolled->run(at, errors);
    CHECK(rolled->bound(0) != plain.bound(0));
    check_same_bounds(code, rolled_up == 1 ? 10'100 : 10);  // machine code is made after 10 000
  }
  CHECK(rolled_up >= 4);
}

TEST_CASE("rolled up, a bound that no number tells is left to the evaluator") {
  if (!is_arithmetic(OpCode::add)) {
    return;
  }
  Graph graph;
  const std::vector<Expression> q = many_variables(graph, 300);
  Expression sum = q[0];
  for (std::size_t i = 0; i < 150; ++i) {
    sum += q[i] / q[i + 150] + q[i] * q[i] * q[i];
  }
  const Bytecode code = sum_size_code(sum, q);
  std::optional<RolledRounding> rolled = RolledRounding::of(code);
  REQUIRE(rolled.has_value());
  SumSizeEvaluator plain(code), prepared(code);
  prepared.prepare();
  // 1/q is infinite where q is subnormal, and so would be its product with an error of 0.
  std::vector<double> at(q.size(), 0.5), errors(q.size(), 0.0);
  at[20] = 0.0;
  at[170] = 1e-310;
  errors[3] = 1.0;
  rolled->run(at, errors);
  CHECK_FALSE(std::isfinite(rolled->bound(0)));
  CHECK(prepared(at, errors).rounding == plain(at, errors).rounding);
  CHECK(std::isfinite(prepared(at, errors).rounding));
}

TEST_CASE("a bound that is not finite as a formula is left to the evaluator") {
  Graph graph;
  const std::vector<Expression> inputs = {graph.variable("x"), graph.variable("y")};
  const Bytecode code = sum_size_code(parsed(graph, "log(x)*y + 2"), inputs);
  SumSizeEvaluator plain(code), prepared(code);
  prepared.prepare();
  // 1/x is infinite where x is subnormal, and so would be its product with an error of 0.
  const double at[] = {1e-310, 0.0}, errors[] = {0.0, 1.0};
  REQUIRE(rounding_code(code).has_value());
  ScalarEvaluator formula(*rounding_code(code));
  const double all[] = {at[0], at[1], errors[0], errors[1]};
  double outputs[3];
  formula(all, outputs);
  CHECK_FALSE(std::isfinite(outputs[2]));
  CHECK(prepared(at, errors).rounding == plain(at, errors).rounding);
  CHECK(std::isfinite(prepared(at, errors).rounding));
}
