// Machine code computes what the interpreter computes, bit for bit.

#include <catch2/catch.hpp>

#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/machine_code.hpp>
#include <rubato/formula/parse.hpp>

#include "engines.hpp"
#include "random_formula.hpp"

using namespace rubato::formula;
using testing::batch_disagreements;
using testing::disagreements;

namespace {

using Points = std::vector<std::vector<double>>;
const std::vector<std::string> names{"x", "y", "z"};

/// Whether this build on this machine makes machine code; where not, the comparisons would compare nothing.
bool has_machine_code() {
  Graph graph;
  const std::array x{graph.variable("x")};
  return ScalarEvaluator(Bytecode(x, x)).is_machine_code();
}

const std::vector<double>& special_numbers() {
  constexpr double infinite = std::numeric_limits<double>::infinity();
  static const std::vector<double> numbers{0.0,
                                           -0.0,
                                           1.0,
                                           -1.0,
                                           0.5,
                                           -2.0,
                                           3.75,
                                           infinite,
                                           -infinite,
                                           std::numeric_limits<double>::quiet_NaN(),
                                           5e-324,
                                           -5e-324,
                                           1e-310,
                                           0x1p-1022,
                                           1e300,
                                           -1e300,
                                           1.7976931348623157e308,
                                           1e-200,
                                           1e5,
                                           -1e22,
                                           708.5,
                                           -745.5};
  return numbers;
}

/// Every triple of some special numbers, and others of all sizes.
Points points_of_three() {
  Points points;
  const std::vector<double>& numbers = special_numbers();
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    for (std::size_t j = 0; j < numbers.size(); ++j) {
      points.push_back({numbers[i], numbers[j], numbers[(3 * i + 7 * j) % numbers.size()]});
    }
  }
  std::mt19937_64 random(20261123);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 200; ++k) {
    const double size = std::exp((k % 4) * normal(random));
    points.push_back({size * normal(random), size * normal(random), size * normal(random)});
  }
  return points;
}

std::vector<Expression> variables_of_three(Graph& graph) {
  return {graph.variable("x"), graph.variable("y"), graph.variable("z")};
}

}  // namespace

TEST_CASE("every function in machine code is the interpreter's, to the bit, on every kind of number") {
  if (!has_machine_code()) {
    WARN("no machine code here: nothing compared");
    return;
  }
  const std::vector<std::string> formulas{"x + y",
                                          "x - y",
                                          "x*y",
                                          "x/y",
                                          "-x",
                                          "x*y + z",
                                          "z + x*y",
                                          "x*y - z",
                                          "z - x*y",
                                          "x^2 + y",
                                          "y - x^2",
                                          "x^2 - x",
                                          "x*y + x",
                                          "y - x*y",
                                          "x/4",
                                          "x^2",
                                          "x^3",
                                          "x^4",
                                          "x^5",
                                          "x^7",
                                          "x^8",
                                          "x^9",
                                          "x^13",
                                          "x^64",
                                          "x^(-1)",
                                          "x^(-2)",
                                          "x^(-7)",
                                          "x^(-9)",
                                          "x^(-64)",
                                          "x^0.5",
                                          "x^1.5",
                                          "x^(-2.5)",
                                          "x^0.3",
                                          "x^y",
                                          "y^x",
                                          "sin(x)",
                                          "cos(x)",
                                          "sin(x) + cos(x)",
                                          "sin(x)*y - z*cos(x)",
                                          "tan(x)",
                                          "asin(x)",
                                          "acos(x)",
                                          "atan(x)",
                                          "atan2(x, y)",
                                          "atan2(y, x)",
                                          "sinh(x)",
                                          "cosh(x)",
                                          "tanh(x)",
                                          "asinh(x)",
                                          "acosh(x)",
                                          "atanh(x)",
                                          "exp(x)",
                                          "log(x)",
                                          "sqrt(x)",
                                          "cbrt(x)",
                                          "abs(x)",
                                          "sech(x)",
                                          "csch(x)",
                                          "sign(x)",
                                          "min(x, y)",
                                          "min(y, x)",
                                          "max(x, y)",
                                          "max(y, x)",
                                          "erf(x)",
                                          "besselj(2, x)",
                                          "bessely(1, x)",
                                          "besseli(0, x)",
                                          "besselk(3, x)",
                                          "sn(x, 0.7)",
                                          "cn(x, 0.7)",
                                          "dn(x, 0.7)",
                                          "where(x > y, z, 1/z)",
                                          "where(x >= y, z, sqrt(z))",
                                          "where(x > 0, y, z)",
                                          "where(x <= 0, y, x)"};
  Points points = points_of_three();
  for (const std::string& text : formulas) {
    INFO(text);
    Graph graph;
    const std::vector<Expression> variables = variables_of_three(graph);
    const Expression formula = parse(text, graph, names);
    // Alone; among values that stand in registers before and after it; and with its derivatives.
    std::vector<Expression> outputs{formula, formula};
    const std::vector<Expression> around{variables[0] * variables[1], variables[1] / variables[2], exp(variables[2])};
    for (const Expression& value : around) {
      outputs.push_back(value * formula + value);
    }
    for (const auto& part : {gradient(formula, variables), hessian_upper(formula, variables)}) {
      outputs.insert(outputs.end(), part.begin(), part.end());
    }
    const Bytecode alone(std::array{formula}, variables), all(outputs, variables);
    CHECK(ScalarEvaluator(alone).is_machine_code());
    // Bessel functions beyond some thousands take long and are tested at moderate arguments alone.
    const bool slow = text.find("bessel") != std::string::npos;
    const std::span<const std::vector<double>> tested =
        slow ? std::span(points).last(200) : std::span<const std::vector<double>>(points);
    CHECK(disagreements(alone, alone, tested) == 0);
    CHECK(disagreements(all, all, tested) == 0);
    CHECK(BatchEvaluator(all).is_machine_code());
    CHECK(batch_disagreements(alone, alone, tested) == 0);
    CHECK(batch_disagreements(all, all, tested) == 0);
  }
}

TEST_CASE("random formulas with their derivatives are the interpreter's in machine code, to the bit") {
  if (!has_machine_code()) {
    return;
  }
  const Points points = points_of_three();
  std::size_t compared = 0, longest = 0, swapped_seen = 0, differences = 0, batches = 0;
  CHECK(rc::check("machine code against the interpreter", [&] {
    Graph graph;
    const std::vector<Expression> variables = variables_of_three(graph);
    std::vector<Expression> outputs = testing::build(graph, *testing::recipes(40));
    const Expression last = outputs.back();
    for (const auto& part : {gradient(last, variables), hessian_upper(last, variables)}) {
      outputs.insert(outputs.end(), part.begin(), part.end());
    }
    const std::vector<Expression> swapped{variables[1], variables[0], variables[2]};
    for (const bool reuse : {true, false}) {
      const Bytecode code(outputs, variables, reuse);
      const Bytecode other(outputs, swapped, reuse);  // the twin: two inputs change places
      const std::span<const std::vector<double>> some = std::span(points).last(40);
      const std::size_t wrong =
          disagreements(code, code, some) + disagreements(code, code, std::span(points).first(60));
      differences += wrong;
      RC_ASSERT(wrong == 0U);
      swapped_seen += disagreements(code, other, some) > 0 && batch_disagreements(code, other, some) > 0 ? 1 : 0;
      RC_ASSERT(batch_disagreements(code, code, points) == 0U);
      batches += BatchEvaluator(code).is_machine_code() ? 1 : 0;
      longest = std::max(longest, code.instructions().size());
      ++compared;
    }
  }));
  CHECK(differences == 0);
  CHECK(compared > 500);
  CHECK(longest > 150);  // several times the registers that there are
  CHECK(batches > 500);
  CHECK(swapped_seen > 500);  // nearly all have an x or a y
}

TEST_CASE("more values at once than registers, and calls between them") {
  if (!has_machine_code()) {
    return;
  }
  for (const bool calls : {false, true}) {
    Graph graph;
    std::vector<Expression> variables, terms;
    for (int i = 0; i < 60; ++i) {
      variables.push_back(graph.variable(fmt::format("x{}", i)));
    }
    for (std::size_t i = 0; i < variables.size(); ++i) {
      const Expression product = variables[i] * variables[(7 * i + 3) % variables.size()];
      terms.push_back(calls && i % 9 == 4 ? sin(product) + cos(product) + atan2(product, variables[i]) : product + 1);
    }
    Expression sum = graph.constant(0.0);
    for (std::size_t i = terms.size(); i-- > 0;) {
      sum += terms[i] * terms[(i * 11) % terms.size()] - terms[i] / (terms[(i * 5) % terms.size()] + 3);
    }
    std::vector<Expression> outputs{sum, variables[3], graph.constant(2.5), sum, terms[5]};
    for (const auto& part : {gradient(sum, variables), hessian_upper(sum, variables)}) {
      outputs.insert(outputs.end(), part.begin(), part.end());
    }
    const Bytecode code(outputs, variables);
    CHECK(code.instructions().size() > 1000);
    std::mt19937_64 random(4);
    std::normal_distribution<double> normal;
    Points points(20, std::vector<double>(variables.size()));
    for (auto& point : points) {
      for (double& x : point) {
        x = normal(random);
      }
    }
    CHECK(ScalarEvaluator(code).is_machine_code());
    CHECK(disagreements(code, code, points) == 0);
    CHECK(BatchEvaluator(code).is_machine_code());
    CHECK(batch_disagreements(code, code, points) == 0);
    std::swap(outputs[0], outputs[1]);
    CHECK(disagreements(Bytecode(outputs, variables), code, points) == 2 * points.size());  // the twin
  }
}

TEST_CASE("a batch evaluator may be copied and assigned between evaluations") {
  Graph graph;
  const std::vector<Expression> variables = variables_of_three(graph);
  const std::array outputs{exp(variables[0] * variables[1]) * variables[2] - variables[0], variables[1] / 3.0};
  const Bytecode code(outputs, variables);
  const std::vector<double> x{0.5, 1.0, 2.0}, y{1.0, -1.0, 0.25}, z{3.0, 2.0, 1.0};
  const std::array inputs{x.data(), y.data(), z.data()};
  const auto run = [&](BatchEvaluator& evaluate) {
    std::vector<double> first(3), second(3);
    evaluate(3, inputs, std::array{first.data(), second.data()});
    first.insert(first.end(), second.begin(), second.end());
    return first;
  };
  auto original = std::make_unique<BatchEvaluator>(code);
  const std::vector<double> expected = run(*original);
  BatchEvaluator copy = *original, assigned(code);
  CHECK(run(assigned) == expected);
  assigned = *original;
  original.reset();
  CHECK(run(copy) == expected);
  CHECK(run(assigned) == expected);
  BatchEvaluator moved = std::move(assigned);
  CHECK(run(moved) == expected);
}

TEST_CASE("outputs may stand where inputs stand") {
  Graph graph;
  const std::vector<Expression> variables = variables_of_three(graph);
  const std::array outputs{variables[1] + variables[2], variables[0] * variables[2], variables[0] - variables[1]};
  ScalarEvaluator evaluate(Bytecode(outputs, variables));
  std::vector<double> numbers{1.5, -2.0, 7.0, 0.0};
  evaluate(std::span(numbers).first(3), std::span(numbers).first(3));
  CHECK(numbers == std::vector<double>{5.0, 10.5, 3.5, 0.0});
  numbers = {1.5, -2.0, 7.0, 0.0};
  evaluate(std::span(numbers).first(3), std::span(numbers).last(3));
  CHECK(numbers == std::vector<double>{1.5, 5.0, 10.5, 3.5});
}

TEST_CASE("copies of code share its machine code, which outlives the first of them, from many threads at once") {
  Graph graph;
  const std::vector<Expression> variables = variables_of_three(graph);
  auto code = std::make_unique<Bytecode>(std::array{sin(variables[0]) * variables[1] + variables[2]}, variables);
  const Bytecode copy = *code;
  CHECK(copy.machine_code() == code->machine_code());
  auto evaluate = std::make_unique<ScalarEvaluator>(*code);
  ScalarEvaluator second = *evaluate;
  code.reset();
  evaluate.reset();
  const std::array point{0.3, 2.0, -1.0};
  const double expected = std::sin(0.3) * 2.0 + -1.0;
  CHECK(second.at(point.data())[0] == expected);

  std::atomic<int> right = 0;
  Graph other;
  const std::vector<Expression> xyz = variables_of_three(other);
  const Bytecode shared(std::array{sin(xyz[0]) * xyz[1] + xyz[2]}, xyz);
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      ScalarEvaluator mine(shared);
      for (int k = 0; k < 1000; ++k) {
        right += mine.at(point.data())[0] == expected ? 1 : 0;
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  CHECK(right == 4000);
}

TEST_CASE("code that is too long, and no code at all, is interpreted") {
  ScalarEvaluator nothing;
  nothing.run();
  CHECK_FALSE(nothing.is_machine_code());
  CHECK(Bytecode().machine_code() == nullptr);
  Graph graph;
  const std::array x{graph.variable("x")};
  Expression chain = x[0];
  for (std::size_t i = 0; i <= longest_machine_code / 2; ++i) {
    chain = chain / 3.0 + x[0];
  }
  ScalarEvaluator evaluate(Bytecode(std::array{chain}, x));
  CHECK_FALSE(evaluate.is_machine_code());
  const double one = 1.0;
  CHECK(evaluate.at(&one)[0] == Approx(1.5));
}
