// What is asked of every function of the formula language, whichever they are: a row of formula/operations.inc is
// tested by being there.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/batch.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/language.hpp>
#include <rubato/formula/operations.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/formula/taylor.hpp>

using namespace rubato::formula;

namespace {

const std::vector<std::string> argument_names{"x"};

/// A call of a function of x alone; numbers where it takes numbers.
std::string call_of(const Function& function) {
  const std::string name(function.name);
  switch (traits_of(function.operation).form) {
    case Form::one: return name + "(x)";
    case Form::two:
    case Form::several: return name + "(x, 0.3*x - 0.2)";
    case Form::order: return name + "(2, x)";
    case Form::parameter: return name + "(x, 0.4)";
  }
  return name;
}

struct Sample {
  Graph graph;
  Expression x = graph.variable("x"), f;
  double at = 0.0;

  explicit Sample(const Function& function) : f(parse(call_of(function), graph, argument_names)) {
    for (const double candidate : {0.45, 1.6}) {  // one of them is inside every domain
      at = candidate;
      if (std::isfinite(value(f, at))) {
        return;
      }
    }
  }
  [[nodiscard]] double value(Expression g, double point) const {
    const std::array outputs{g};
    const std::array inputs{x};
    return value(Bytecode(outputs, inputs), point, Engine::interpreter);
  }
  [[nodiscard]] static double value(const Bytecode& code, double point, Engine engine) {
    ScalarEvaluator evaluate(code, engine);
    std::array<double, 1> result{};
    evaluate(std::array{point}, result);
    return result[0];
  }
};

/// Whether the derivative is 0 where there is one.
bool is_flat(const Function& function) {
  return function.operation == Operation::sign || function.operation == Operation::floor;
}

}  // namespace

TEST_CASE("every function has a value where it is defined, the same by every evaluator of scalars") {
  for (const Function& function : functions()) {
    INFO(function.name);
    const Sample sample(function);
    const std::array outputs{sample.f};
    const std::array inputs{sample.x};
    const Bytecode code(outputs, inputs);
    const double expected = sample.value(sample.f, sample.at);
    CHECK(std::isfinite(expected));
    CHECK(Sample::value(code, sample.at, Engine::automatic) == expected);
    if (traits_of(function.operation).form == Form::one) {
      CHECK(apply(function.operation, sample.at) == expected);
      const double further = function.operation == Operation::floor ? 1.0 : 0.1;
      CHECK(apply(function.operation, sample.at + further) != (function.operation == Operation::sign ? 0.0 : expected));
    }
  }
}

TEST_CASE("first and second derivatives of every function are its differences") {
  constexpr double h = 1e-5;  // differences err by h²/6 of a third derivative, and by rounding over h
  const auto is_slope = [](const Sample& sample, Expression derivative, Expression of) {
    const double difference = (sample.value(of, sample.at + h) - sample.value(of, sample.at - h)) / (2.0 * h);
    return sample.value(derivative, sample.at) == Approx(difference).margin(2e-9).epsilon(1e-8);
  };
  for (const Function& function : functions()) {
    INFO(function.name);
    Sample sample(function);
    const std::vector<Expression> x{sample.x};
    const Expression first = gradient(sample.f, x)[0];
    CHECK(is_slope(sample, first, sample.f));
    CHECK(is_slope(sample, hessian_upper(sample.f, x)[0], first));
    CHECK_FALSE(is_slope(sample, first + 1e-5, sample.f));
  }
}

TEST_CASE("Taylor coefficients of every function are its derivatives over factorials") {
  for (const Function& function : functions()) {
    INFO(function.name);
    Sample sample(function);
    const std::array outputs{sample.f};
    const std::array inputs{sample.x};
    constexpr int order = 4;
    TaylorEvaluator series(Bytecode(outputs, inputs, false), order);
    series.input(0)[0] = sample.at;
    series.input(0)[1] = 1.0;
    REQUIRE(series() == rubato::Status::success);
    Expression derivative_of_order = sample.f;
    double factorial = 1.0;
    for (int k = 0; k <= order; ++k) {
      const double expected = sample.value(derivative_of_order, sample.at) / factorial;
      // A few roundings in each of few operations, of numbers that may be some times as large as their sum.
      CHECK(series.output(0)[k] == Approx(expected).epsilon(1e-12).margin(1e-12));
      CHECK(1.000001 * series.output(0)[k] + 1e-9 != Approx(expected).epsilon(1e-12).margin(1e-12));
      derivative_of_order = derivative(derivative_of_order, sample.x);
      factorial *= k + 1;
    }
  }
}

TEST_CASE("the rounding of every function bounds what an argument one unit away makes of it") {
  constexpr double unit = 0x1p-53;
  for (const Function& function : functions()) {
    INFO(function.name);
    const Sample sample(function);
    const std::array outputs{sample.f};
    const std::array inputs{sample.x};
    const Bytecode code(outputs, inputs);
    RoundingEvaluator rounding(code);
    const std::array point{sample.at}, error{4.0 * sample.at};
    rounding.run(point, error);  // two units, and the rounding of the product that takes x there
    const double bound = unit * rounding.bound(0);
    CHECK(std::isfinite(bound));
    const double value = sample.value(sample.f, sample.at);
    for (const double away : {1.0 - 2.0 * unit, 1.0 + 2.0 * unit}) {
      CHECK(std::abs(sample.value(sample.f, away * sample.at) - value) <= bound);
    }
    // The twin: an argument a hundred thousand units away goes beyond it, where the value depends on x at all.
    if (!is_flat(function)) {
      CHECK(std::abs(sample.value(sample.f, (1.0 + 2e5 * unit) * sample.at) - value) > bound);
    }
  }
}
