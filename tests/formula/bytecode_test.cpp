#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>

#include "random_formula.hpp"

using namespace rubato::formula;

namespace {

const std::vector<std::string> xyz{"x", "y", "z"};

std::vector<Expression> variables_in(Graph& graph) {
  return {graph.variable("x"), graph.variable("y"), graph.variable("z")};
}

std::vector<double> run(const Bytecode& code, const std::vector<double>& point) {
  ScalarEvaluator evaluator(code);
  std::vector<double> outputs(code.output_count());
  evaluator(point, outputs);
  const std::vector<double> first = outputs;
  std::fill(outputs.begin(), outputs.end(), 0.5);
  evaluator(point, outputs);  // a second run must not see anything of the first
  std::copy(point.begin(), point.end(), evaluator.inputs().begin());
  evaluator.run();
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    REQUIRE(std::bit_cast<std::uint64_t>(first[i]) == std::bit_cast<std::uint64_t>(outputs[i]));
    REQUIRE(std::bit_cast<std::uint64_t>(first[i]) == std::bit_cast<std::uint64_t>(evaluator.output(i)));
  }
  return outputs;
}

bool same(double a, double b) {
  return a == b || (std::isnan(a) && std::isnan(b));
}

/// Instructions of one kind in the code of a formula.
std::size_t count(const std::string& text, OpCode code) {
  Graph graph;
  const std::vector<Expression> variables = variables_in(graph);
  const std::array outputs{parse(text, graph, xyz)};
  const Bytecode bytecode(outputs, variables);
  return static_cast<std::size_t>(std::count_if(bytecode.instructions().begin(), bytecode.instructions().end(),
                                                [&](const Instruction& i) { return i.code == code; }));
}

}  // namespace

TEST_CASE("compiled code computes what the graph says, to the bit") {
  const std::vector<double> point{0.62, -1.37, 2.81};
  std::size_t finite = 0;
  std::size_t wrong_caught = 0;
  CHECK(rc::check("bytecode against the graph", [&] {
    Graph graph;
    const std::vector<Expression> variables = variables_in(graph);
    // Powers are computed by products, which round otherwise than pow; sech and csch are written otherwise here. Both
    // have their own tests.
    std::vector<Expression> outputs;
    for (const Expression e : testing::build(graph, *testing::recipes(25), {.powers = false, .kinks = true})) {
      const std::string text = to_string(e);
      if (text.find("sech") == std::string::npos && text.find("csch") == std::string::npos &&
          text.find('^') == std::string::npos) {
        outputs.push_back(e);
      }
    }
    const std::vector<double> compact = run(Bytecode(outputs, variables, true), point);
    const std::vector<double> spread = run(Bytecode(outputs, variables, false), point);
    for (std::size_t i = 0; i < outputs.size(); ++i) {
      const double expected = testing::evaluate(outputs[i], point);
      RC_ASSERT(same(compact[i], expected));
      RC_ASSERT(same(spread[i], expected));
      finite += std::isfinite(expected) ? 1 : 0;
    }
    if (outputs.size() > 4) {  // the twin: the code of another formula
      wrong_caught += same(compact[3], testing::evaluate(outputs[4], point)) ? 0 : 1;
    }
  }));
  CHECK(finite > 1000);
  CHECK(wrong_caught > 100);
}

TEST_CASE("powers") {
  const auto exponent = GENERATE(2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 13.0, 64.0, 65.0, -1.0, -2.0, -3.0, -8.0, -9.0,
                                 0.5, 1.5, 2.5, -0.5, -1.5, -2.5, 0.3, -4.7);
  Graph graph;
  const std::vector<Expression> variables = variables_in(graph);
  const std::array outputs{pow(variables[0], exponent)};
  const Bytecode code(outputs, variables);
  for (const double x : {0.3, 1.0, 1.7, 2.9}) {
    CAPTURE(exponent, x);
    const double expected = std::pow(x, exponent);
    // |n| products lose at most |n| half roundings, a root and a reciprocal two more each.
    const double tolerance = (0.5 * std::abs(exponent) + 4.0) * std::numeric_limits<double>::epsilon() * expected;
    const double got = run(code, {x, 0.0, 0.0}).front();
    CHECK(std::abs(got - expected) <= tolerance);
    CHECK_FALSE(std::abs(got * (1.0 + 1e-12) - expected) <= tolerance);  // the twin
  }
  if (exponent == std::trunc(exponent)) {
    CHECK(run(code, {-2.0, 0.0, 0.0}).front() == std::pow(-2.0, exponent));
    CHECK(run(code, {0.0, 0.0, 0.0}).front() == std::pow(0.0, exponent));
  } else {
    CHECK(std::isnan(run(code, {-2.0, 0.0, 0.0}).front()));
  }
}

TEST_CASE("instructions are reduced and fused") {
  CHECK(count("x^2", OpCode::square) == 1);
  CHECK(count("x*y + z", OpCode::multiply_add) == 1);
  CHECK(count("x*y - z", OpCode::multiply_subtract) == 1);
  CHECK(count("z - x*y", OpCode::negative_multiply_add) == 1);
  CHECK(count("x*y + z*(x*y)", OpCode::multiply) == 1);  // a product used twice stands alone
  CHECK(count("sin(x)*cos(x)", OpCode::sincos) == 1);
  CHECK(count("sin(x)*cos(x)", OpCode::sin) == 0);
  CHECK(count("sin(x)*cos(y)", OpCode::sincos) == 0);
  CHECK(count("x/4", OpCode::divide) == 0);
  CHECK(count("x/3", OpCode::divide) == 1);
  CHECK(count("x^1.5", OpCode::power) == 0);
  CHECK(count("x^20", OpCode::integer_power) == 1);
  CHECK(count("x^y", OpCode::power) == 1);
}

TEST_CASE("products in a sum are rounded: nothing is contracted") {
  // (1 + ε)² - (1 + 2ε) is ε² exactly, and 0 if the square is rounded first.
  Graph graph;
  const std::vector<Expression> variables = variables_in(graph);
  const double x = 1.0 + std::numeric_limits<double>::epsilon();
  const std::array outputs{variables[0] * variables[1] - variables[2]};
  CHECK(run(Bytecode(outputs, variables), {x, x, 2.0 * x - 1.0}).front() == 0.0);
  CHECK(std::fma(x, x, -(2.0 * x - 1.0)) != 0.0);  // the twin: what a contracted product would give
}

TEST_CASE("outputs may be inputs, constants and repeated") {
  Graph graph;
  const std::vector<Expression> variables = variables_in(graph);
  const Expression zero = graph.constant(0.0);
  const Expression sum = variables[0] + variables[1];
  const std::vector<Expression> outputs{variables[2],        zero,        zero, zero, zero, zero, sum, sum,
                                        graph.constant(2.5), variables[0]};
  for (const bool reuse : {true, false}) {
    CHECK(run(Bytecode(outputs, variables, reuse), {1.0, 2.0, 4.0}) ==
          std::vector<double>{4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 3.0, 2.5, 1.0});
  }
}

TEST_CASE("registers are used again") {
  Graph graph;
  const std::vector<Expression> variables = variables_in(graph);
  Expression chain = variables[0];
  for (int i = 0; i < 100; ++i) {
    chain = sin(chain) * variables[1] / 3.0;
  }
  const std::array outputs{chain};
  CHECK(Bytecode(outputs, variables, true).register_count() <= 3 + 1 + 2);
  CHECK(Bytecode(outputs, variables, false).register_count() == 3 + 1 + 300);
}

TEST_CASE("the Hessian of the N-body problem takes as few instructions as code written by hand") {
  const std::size_t bodies = 5;
  Graph graph;
  std::vector<Expression> q;
  for (std::size_t i = 0; i < 3 * bodies; ++i) {
    q.push_back(graph.variable(fmt::format("q{}", i)));
  }
  Expression potential = graph.constant(0.0);
  for (std::size_t i = 0; i < bodies; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      Expression r2 = graph.constant(0.0);
      for (std::size_t k = 0; k < 3; ++k) {
        const Expression d = q[3 * i + k] - q[3 * j + k];
        r2 += d * d;
      }
      potential -= (1.0 + static_cast<double>(i * j)) / sqrt(r2);
    }
  }
  std::vector<Expression> outputs{potential};
  for (const auto& part : {gradient(potential, q), hessian_upper(potential, q)}) {
    outputs.insert(outputs.end(), part.begin(), part.end());
  }
  // By hand, for each pair: 3 differences, 5 for the square of the distance, root, quotient, potential, 1 to sum it,
  // 3 for the two weights, 3 + 6 for the gradient, 3 + 6 + 3 for the block, 12 + 6 to put it in its places: 54.
  const std::size_t by_hand = 54 * bodies * (bodies - 1) / 2;
  const std::size_t instructions = Bytecode(outputs, q).instructions().size();
  CAPTURE(instructions, by_hand);
  CHECK(2 * instructions <= 3 * by_hand);
}

TEST_CASE("compiling refuses what it cannot evaluate") {
  Graph graph;
  Graph other;
  const std::vector<Expression> variables = variables_in(graph);
  const std::array outputs{variables[0] * variables[1]};
  CHECK_THROWS_WITH(Bytecode(outputs, std::array{variables[0]}), Catch::Contains("'y'"));
  CHECK_THROWS_AS(Bytecode(outputs, std::array{variables[0], variables[1], variables[0]}), std::invalid_argument);
  CHECK_THROWS_AS(Bytecode(outputs, std::array{variables[0] + 1, variables[1]}), std::invalid_argument);
  CHECK_THROWS_AS(Bytecode(outputs, std::array{other.variable("x")}), std::invalid_argument);
  CHECK_THROWS_AS(Bytecode(std::array{Expression()}, variables), std::invalid_argument);
}
