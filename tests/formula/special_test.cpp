// erf, Bessel and elliptic functions, choices, and vectors in norm and dot.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/formula/special.hpp>

using namespace rubato::formula;

namespace {

const std::vector<std::string> special_names{"x", "y", "r1", "r2", "r3", "s1", "s2", "s3", "b1_dot", "b2_dot"};
const std::vector<double> special_point{0.7, -0.4, 1.0, 2.0, -2.0, 4.0, -1.0, 3.0, 6.0, 8.0};

std::vector<Expression> special_inputs(Graph& graph) {
  std::vector<Expression> inputs;
  for (const std::string& name : special_names) {
    inputs.push_back(graph.variable(name));
  }
  return inputs;
}

Expression read(Graph& graph, const std::string& text) {
  (void)special_inputs(graph);
  return parse(text, graph, special_names);
}

double value_at(Graph& graph, Expression expression, const std::vector<double>& point) {
  const std::array outputs{expression};
  ScalarEvaluator evaluate{Bytecode(outputs, special_inputs(graph))};
  std::vector<double> result(1);
  evaluate(point, result);
  return result[0];
}

double value_of(const std::string& text) {
  Graph graph;
  return value_at(graph, read(graph, text), special_point);
}

std::string refused(const std::string& text) {
  Graph graph;
  try {
    (void)read(graph, text);
  } catch (const ParseError& error) {
    return std::to_string(error.column()) + ": " + error.reason();
  }
  return "accepted";
}

}  // namespace

TEST_CASE("special functions have the values that others found") {
  // By arithmetic of 30 digits.
  const auto [text, expected] = GENERATE(table<std::string, double>({
      {"erf(0.5)", 0.520499877813046538},
      {"besselj(0, 1)", 0.765197686557966551},
      {"besselj(3, 2.5)", 0.216600391039113525},
      {"besselj(-3, 2.5)", -0.216600391039113525},
      {"besselj(3, -2.5)", -0.216600391039113525},
      {"bessely(0, 1)", 0.088256964215676958},
      {"bessely(-1, 1)", 0.781212821300288717},
      {"besseli(0, 1)", 1.26606587775200834},
      {"besseli(1, -1)", -0.565159103992485027},
      {"besselk(0, 1)", 0.421024438240708333},
      {"besselk(-2, 1)", 1.62483889863517748},
      {"ellipk(0.5)", 1.85407467730137192},
      {"ellipe(0.5)", 1.3506438810476755},
      {"ellipe(1)", 1.0},
      {"sn(1.2, 0.7)", 0.867183293290238608},
      {"dn(2, 0.99)", 0.275809856945513789},
      {"sn(ellipk(0.5), 0.5)", 1.0},
      {"dn(ellipk(0.36), 0.36)", 0.8},
      {"sn(0.3, 0)", 0.295520206661339564},
      {"cn(0.3, 1)", 0.956627911900248293},
      {"sn(0, 0.4)", 0.0},
      {"am(0.3, 0)", 0.3},
      {"am(ellipk(0.5), 0.5)", 1.57079632679489662},
      {"am(-0.3, 1)", -0.29559867598460415},
      {"floor(-0.5)", -1.0},
      {"floor(2)", 2.0},
      {"mod(-0.5, 2)", 1.5},
      {"mod(1.75, 0.5)", 0.25},
      {"expm1(2^-40)*2^40", 1.00000000000045475},
      {"log1p(2^-40)*2^40", 0.999999999999545253},
  }));
  INFO(text);
  // A few units in the last place of numbers up to 2.
  CHECK_THAT(value_of(text), Catch::Matchers::WithinAbs(expected, 2e-15));
  CHECK_THAT(value_of(text), !Catch::Matchers::WithinAbs(expected + 1e-14, 2e-15));
}

TEST_CASE("elliptic functions are on their curves, and have their periods, for all parameters") {
  for (const double m : {0.0, 1e-12, 0.1, 0.5, 0.9, 0.999999, 1.0 - 1e-12, 1.0}) {
    for (const double u : {-7.0, -0.3, 1e-9, 0.1, 1.0, 2.5, 20.0}) {
      INFO("m = " << m << ", u = " << u);
      const Jacobi f = jacobi(u, m);
      CHECK(std::abs(f.sn * f.sn + f.cn * f.cn - 1.0) < 1e-15);
      CHECK(std::abs(f.dn * f.dn + m * f.sn * f.sn - 1.0) < 3e-15);
      CHECK(std::abs(std::sin(amplitude(u, m)) - f.sn) < 1e-14);
      CHECK(std::abs(std::cos(amplitude(u, m)) - f.cn) < 1e-14);
      if (m < 1.0) {  // the rounding of the period, by a slope of at most 1
        const double period = 4.0 * elliptic_k(m);
        const double bound = 1e-14 * (1.0 + period);
        CHECK(std::abs(jacobi(u + period, m).sn - f.sn) < bound);
        CHECK(std::abs(amplitude(u + 0.5 * period, m) - amplitude(u, m) - std::numbers::pi) < bound);
        CHECK(std::abs(amplitude(u + 0.49 * period, m) - amplitude(u, m) - std::numbers::pi) > bound);
        CHECK(std::abs(jacobi(u + 0.99 * period, m).dn - f.dn) + std::abs(jacobi(u + 0.99 * period, m).sn - f.sn) >
              bound);
      }
    }
  }
}

TEST_CASE("the pendulum's elliptic solution solves its equation") {
  // q = 2 asin(k sn(t + K, m)) with m = k².
  Graph graph;
  const Expression q = read(graph, "2*asin(0.8*sn(x + ellipk(0.64), 0.64))");
  const Expression x = graph.variable("x");
  const Expression residual = derivative(derivative(q, x), x) + sin(q);
  const Expression twin = derivative(derivative(q, x), x) + 1.001 * sin(q);
  for (const double t : {0.1, 0.5, 1.3, 3.0}) {
    std::vector<double> point = special_point;
    point[0] = t;
    CHECK(std::abs(value_at(graph, residual, point)) < 1e-14);
    CHECK(std::abs(value_at(graph, twin, point)) > 1e-5);
  }
}

TEST_CASE("derivatives of special functions and choices are their differences") {
  for (const std::string text : {"erf(x*y)",
                                 "besselj(0, x)",
                                 "besselj(2, x + y^2)",
                                 "besselj(-1, x)",
                                 "bessely(1, x)",
                                 "bessely(0, x)",
                                 "besseli(0, x*y)",
                                 "besseli(3, x)",
                                 "besselk(0, x)",
                                 "besselk(2, x)",
                                 "sn(x + y, 0.8)",
                                 "am(x + y, 0.7)",
                                 "cn(x - y, 0.3)",
                                 "dn(2*x, 0.6)*y",
                                 "where(x > y, x^2*y, exp(x))",
                                 "where(x < y, x^2*y, exp(x)*y)",
                                 "where(x > 0, sqrt(x)*y, 1)^2",
                                 "y*where(y >= 0, log(y), where(x <= 1, sin(x*y), x))",
                                 "norm(r - 2*s)*x",
                                 "1/norm(x, y)"}) {
    INFO(text);
    Graph graph;
    const Expression f = read(graph, text);
    const std::vector<Expression> inputs = special_inputs(graph);
    const std::vector<Expression> first = gradient(f, inputs), second = hessian_upper(f, inputs);
    constexpr double h = 1e-5;
    const auto at = [&](Expression g, std::size_t i, double d) {
      std::vector<double> point = special_point;
      point[i] += d;
      return value_at(graph, g, point);
    };
    // Differences err by h^2/6 times a third derivative, and by rounding over h.
    const auto slope = [&](Expression g, std::size_t i) {
      return Approx((at(g, i, h) - at(g, i, -h)) / (2.0 * h)).margin(2e-9).epsilon(1e-8);
    };
    for (std::size_t i = 0, k = 0; i < inputs.size(); ++i) {
      CHECK(at(first[i], i, 0.0) == slope(f, i));
      CHECK(at(first[i], i, 0.0) + 1e-5 != slope(f, i));
      for (std::size_t j = i; j < inputs.size(); ++j, ++k) {
        CHECK(at(second[k], i, 0.0) == slope(first[i], j));
      }
    }
  }
}

TEST_CASE("what is not chosen need not be defined, nor its derivatives") {
  Graph graph;
  const Expression f = read(graph, "where(y > 0, sqrt(y) + log(y), x^2)");
  const std::vector<Expression> inputs = special_inputs(graph);
  CHECK(value_at(graph, f, special_point) == 0.7 * 0.7);
  CHECK(value_at(graph, gradient(f, inputs)[0], special_point) == 1.4);
  CHECK(value_at(graph, gradient(f, inputs)[1], special_point) == 0.0);
  CHECK(value_at(graph, hessian_upper(f, inputs)[0], special_point) == 2.0);
  // The twin: by a product with 0 or 1 it would be undefined.
  const Expression product = read(graph, "max(sign(y), 0)*(sqrt(y) + log(y)) + max(-sign(y), 0)*x^2");
  CHECK(std::isnan(value_at(graph, product, special_point)));
  // A condition that is undefined leaves the whole undefined.
  CHECK(std::isnan(value_of("where(sqrt(y) > 0, 1, 2)")));
  CHECK(std::isnan(value_of("where(sqrt(y) > 0, 0, 2)")));
  CHECK(std::isnan(value_of("where(sqrt(y) > 0, 1, 0)")));
}

TEST_CASE("comparisons mean what they say where both sides are equal") {
  CHECK(value_of("where(x > x, 1, 2)") == 2.0);
  CHECK(value_of("where(x < x, 1, 2)") == 2.0);
  CHECK(value_of("where(x >= x, 1, 2)") == 1.0);
  CHECK(value_of("where(x <= x, 1, 2)") == 1.0);
  CHECK(value_of("where(1 <= 2, x, 2)") == 0.7);
  CHECK(value_of("where(1 >= 2, x, 2)") == 2.0);
  CHECK(value_of("sum(i, 1, 3, where(i >= 2, i, 0))") == 5.0);
}

TEST_CASE("vectors of bodies in norm and dot") {
  const auto [text, expected] = GENERATE(table<std::string, double>({
      {"norm(r)", 3.0},
      {"norm(r - s)", std::sqrt(9.0 + 9.0 + 25.0)},
      {"norm(-r)", 3.0},
      {"norm(2*r/4 + (r + s) - s)", 4.5},
      {"dot(r, s)", -4.0},
      {"dot(r*2, x*s)", -8.0 * 0.7},
      {"norm(r[1:2])", std::sqrt(5.0)},
      {"norm(r[2:3] - s[1:2])", std::sqrt(4.0 + 1.0)},
      {"norm(3, 4)", 5.0},
      {"norm(r[1] - s[1], r[2] - s[2])", std::sqrt(18.0)},
      {"norm(y)", 0.4},
      {"norm(b_dot)", 10.0},
      {"b_dot[2]", 8.0},
      {"sum(i, 1, 2, norm(r[i] - s[i], r[i+1] - s[i+1]))", std::sqrt(18.0) + std::sqrt(9.0 + 25.0)},
      {"norm(r*dot(r, s))", 12.0},
  }));
  INFO(text);
  CHECK_THAT(value_of(text), Catch::Matchers::WithinAbs(expected, 1e-14));
  CHECK_THAT(value_of(text), !Catch::Matchers::WithinAbs(expected + 1e-12, 1e-14));
}

TEST_CASE("a vector ends where its names are of another kind") {
  Graph graph;
  const auto resolve = [&](std::string_view name) -> std::optional<Expression> {
    if (name == "r3") {
      return graph.constant(7.0);
    }
    return name == "r1" || name == "r2" ? std::optional(graph.variable(name)) : std::nullopt;
  };
  const ParseContext context{.resolve = resolve, .known_names = {}};
  CHECK(parse("norm(r)", graph, context) == parse("sqrt(r1*r1 + r2*r2)", graph, context));
}

TEST_CASE("whoever calls something by a new word means that") {
  const std::vector<std::string> taken{"norm", "dot", "where", "erf", "sn", "besselj", "ellipk"};
  Graph graph;
  for (const std::string& name : taken) {
    INFO(name);
    CHECK(is_valid_name(name));
    CHECK(parse(name + "^2", graph, taken) == pow(graph.variable(name), 2.0));
    CHECK_THROWS_WITH(parse(name + "(2, 3)", graph, taken), Catch::Contains("is not a function: for a product"));
  }
  CHECK_FALSE(is_valid_name("min"));  // the twin: the first functions do not give way
}

TEST_CASE("what is wrong with new words is told at its place") {
  const auto [text, expected] = GENERATE(table<std::string, std::string>({
      {"norm()", "5: nothing stands between ( and )"},
      {"norm(q)", "6: unknown name 'q'"},
      {"norm(r + x)", "8: + stands between a vector and a number"},
      {"norm(r - b_dot)", "8: - stands between vectors with 3 and 2 components"},
      {"norm(r*s)", "7: a product of two vectors: write dot(r, s)"},
      {"norm(r/s)", "7: / does not take a vector here"},
      {"norm(r^2)", "7: ^ does not take a vector here"},
      {"norm(r, s)", "1: norm takes one vector, or two or more numbers"},
      {"norm(sin(r))", "10: unknown name 'r'"},
      {"norm(r[2:5])", "6: there is no r[4]"},
      {"norm(r[3:1])", "6: r[3:1] has no component"},
      {"r[1:2]", "4: a part of a vector stands in norm and dot only"},
      {"dot(r)", "1: dot takes two vectors: dot(r, s)"},
      {"dot(r, s, r)", "9: dot takes two vectors: dot(r, s)"},
      {"dot(r, s[1:2])", "1: dot takes two vectors of one length, and these have 3 and 2 components"},
      {"r*2", "1: unknown name 'r'"},
      {"where(x, 1, 2)", "1: where takes a comparison and two formulas: where(x > 0, x^2, 0)"},
      {"where(x > 0, 1)", "1: where takes a comparison and two formulas: where(x > 0, x^2, 0)"},
      {"where(x > 0, 1, 2, 3)", "18: where takes a comparison and two formulas: where(x > 0, x^2, 0)"},
      {"where(0 < x < 1, 1, 2)", "13: one comparison is a condition: for two write one where inside another"},
      {"where(x == 0, 1, 2)", "9: unexpected character '=': a formula is one expression, without ="},
      {"where(x > 0, 1, 2", "6: this ( is never closed"},
      {"x > 0", "3: unexpected '>': in a formula a comparison stands in where(a < b, f, g) only"},
      {"besselj(0.5, x)",
       "1: the order of besselj has to be an integer that is known beforehand, from -1000 to 1000, and is 0.5"},
      {"besselj(x, x)", "1: the order of besselj has to be an integer that is known beforehand, from -1000 to 1000"},
      {"besselj(x)", "1: besselj takes 2 arguments, got 1"},
      {"sn(x, y)",
       "1: the parameter m of an elliptic function has to be a number that is known beforehand, from 0 to 1"},
      {"sn(x, 1.5)",
       "1: the parameter m of an elliptic function has to be a number that is known beforehand, from 0 to 1, and is "
       "1.5"},
      {"ellipk(1)", "8: m of ellipk has to be a number that is known beforehand, from 0 to 1 and not 1, and is 1"},
      {"ellipe(x)", "8: m of ellipe has to be a number that is known beforehand, from 0 to 1"},
      {"nrom(r)", "1: unknown function 'nrom': did you mean 'norm'?"},
  }));
  INFO(text);
  CHECK_THAT(refused(text), Catch::StartsWith(expected));
}

TEST_CASE("a lambda may choose, and call what formulas may") {
  Graph graph;
  const Expression x = read(graph, "x"), y = graph.variable("y");
  const auto traced = [](auto u, auto v) { return where(u > 0, erf(u) * v, besselj(2, v)) + sn(u, 0.5); };
  CHECK(traced(x, y) == parse("where(x > 0, erf(x)*y, besselj(2, y)) + sn(x, 0.5)", graph, special_names));
  CHECK(traced(x, y) != parse("where(x >= 0, erf(x)*y, besselj(2, y)) + sn(x, 0.5)", graph, special_names));
}

TEST_CASE("new functions are read back from their text") {
  Graph graph;
  for (const std::string text : {"erf(x)", "besselj(2, x)", "besselk(0, x)", "sn(x, 0.25)", "where(x > y, x, 0)",
                                 "where(x > y, 0, x^2)", "where(x >= y, x, y)", "norm(r - s)"}) {
    const Expression f = read(graph, text);
    CHECK(parse(to_string(f), graph, special_names) == f);
  }
}

TEST_CASE("batches compute new functions to the bit as one point does") {
  Graph graph;
  std::vector<Expression> outputs;
  for (const std::string text : {"erf(x)", "besselj(1, x)", "besselk(1, x)", "dn(x, 0.9)", "where(x > 0.5, y, 2*x)"}) {
    outputs.push_back(read(graph, text));
  }
  const std::vector<Expression> inputs{graph.variable("x"), graph.variable("y")};
  constexpr std::size_t points = 37;
  std::vector<double> x(points), y(points);
  for (std::size_t i = 0; i < points; ++i) {
    x[i] = -0.9 + 0.05 * static_cast<double>(i);
    y[i] = std::sqrt(x[i]);
  }
  std::vector<std::vector<double>> results(outputs.size(), std::vector<double>(points));
  std::vector<double*> places;
  for (auto& result : results) {
    places.push_back(result.data());
  }
  const Bytecode code(outputs, inputs);
  const std::array<const double*, 2> columns{x.data(), y.data()};
  BatchEvaluator batch(code);
  batch(points, columns, places);
  ScalarEvaluator one(code);
  std::vector<double> expected(outputs.size());
  for (std::size_t i = 0; i < points; ++i) {
    one(std::array{x[i], y[i]}, expected);
    for (std::size_t j = 0; j < outputs.size(); ++j) {
      INFO("output " << j << " at " << x[i]);
      CHECK((results[j][i] == expected[j] || (std::isnan(results[j][i]) && std::isnan(expected[j]))));
    }
  }
}

TEST_CASE("rounding bounds of new functions bound what an argument one unit away makes of them") {
  constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
  for (const std::string text : {"erf(x)", "besselj(2, 5*x)", "bessely(1, x)", "besseli(0, x)", "besselk(3, x)",
                                 "sn(3*x, 0.9)", "cn(x, 0.5)", "where(x > 0, x^3, 1/y)"}) {
    INFO(text);
    Graph graph;
    const std::array outputs{read(graph, text)};
    const Bytecode code(outputs, special_inputs(graph));
    RoundingEvaluator evaluate(code);
    std::vector<double> errors(special_point.size(), 0.0);
    errors[0] = 2.0 * special_point[0];
    evaluate.run(special_point, errors);
    std::vector<double> moved = special_point;
    moved[0] *= 1.0 + 2.0 * unit;
    const double change = std::abs(value_at(graph, outputs[0], moved) - value_at(graph, outputs[0], special_point));
    CHECK(change <= unit * evaluate.bound(0));
    CHECK(evaluate.bound(0) < 500.0 * (1.0 + std::abs(evaluate.value(0))));
  }
}
