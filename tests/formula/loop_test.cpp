// Sums that stay loops: their values, derivatives and bounds are those of their terms written out.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/loop.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/rounding.hpp>

using namespace rubato::formula;
using Catch::Contains;

namespace {

constexpr double unit = 0x1p-53;

std::vector<std::string> names(std::size_t n) {
  std::vector<std::string> all = {"k"};
  for (std::size_t i = 1; i <= n; ++i) {
    all.push_back(fmt::format("r{}", i));
  }
  return all;
}

/// A formula of k and r1 … rn.
struct Read {
  Graph graph;
  std::vector<Expression> variables;
  Expression formula;

  Read(const std::string& text, std::size_t n) {
    const std::vector<std::string> known = names(n);
    for (const std::string& name : known) {
      variables.push_back(graph.variable(name));
    }
    formula = parse(text, graph, known);
  }
};

std::string pairs(int n, const std::string& energy =
                             "1/sqrt(0.01 + (r[3*i-2] - r[3*j-2])^2 + (r[3*i-1] - "
                             "r[3*j-1])^2 + (r[3*i] - r[3*j])^2)") {
  return fmt::format("-k*sum(i, 2, {}, sum(j, 1, i - 1, {}))", n, energy);
}

std::vector<double> point(std::size_t n) {
  std::vector<double> x = {1.25};
  for (std::size_t i = 1; i <= n; ++i) {
    x.push_back(3.0 * std::sin(0.7 * static_cast<double>(i * i) + 1.0));
  }
  return x;
}

/// Values with bounds of their rounding errors, in units of u; the values by both engines.
struct Values {
  std::vector<double> automatic, interpreted, bounds;

  Values(const std::vector<Expression>& outputs, const std::vector<Expression>& inputs, const std::vector<double>& x)
      : automatic(outputs.size()), interpreted(outputs.size()) {
    const Bytecode code(outputs, inputs);
    ScalarEvaluator one(code), other(code, Engine::interpreter);
    one(x, automatic);
    other(x, interpreted);
    RoundingEvaluator rounding(code);
    rounding.run(x, std::vector<double>(x.size(), 0.0));
    for (std::size_t i = 0; i < outputs.size(); ++i) {
      bounds.push_back(rounding.bound(i));
    }
  }
};

std::vector<Expression> with_gradient(Expression formula, const std::vector<Expression>& variables) {
  std::vector<Expression> outputs = gradient(formula, variables);
  outputs.insert(outputs.begin(), formula);
  return outputs;
}

/// Of two ways to compute the same numbers: the largest difference over the sum of their bounds, to first order at most
/// 1, be the error of each what it may.
double difference(const Values& a, const Values& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.bounds.size(); ++i) {
    const double bound = unit * (a.bounds[i] + b.bounds[i]);
    for (const auto* x : {&a.automatic, &a.interpreted}) {
      for (const auto* y : {&b.automatic, &b.interpreted}) {
        largest = std::max(largest, std::abs((*x)[i] - (*y)[i]) / bound);
      }
    }
  }
  return largest;
}

/// The formula and its gradient as a loop against the same written out by hand (`plain`: terms, one after the other).
double against_plain(const std::string& loop, const std::string& plain, std::size_t n) {
  Read a(loop, n), b(plain, n);
  REQUIRE(has_loops(a.formula));
  REQUIRE_FALSE(has_loops(b.formula));
  return difference(Values(with_gradient(a.formula, a.variables), a.variables, point(n)),
                    Values(with_gradient(b.formula, b.variables), b.variables, point(n)));
}

constexpr int elements = 220;  ///< that iterations go round

/// Terms with {0} for i and {1}, {2} for the indices of element(0) and element(1), joined by signs of plus.
std::string written_out(int n, const std::string& term) {
  std::string all;
  for (int i = 1; i <= n; ++i) {
    all += (i == 1 ? "" : " + ") + fmt::format(fmt::runtime(term), i, i % elements + 1, (i + 1) % elements + 1);
  }
  return all;
}

std::string element(int further) {
  return fmt::format("r[mod(i + {}, {}) + 1]", further, elements);
}

}  // namespace

TEST_CASE("a sum over pairs has the value and the gradient of its terms written out") {
  constexpr int n = 50;
  Read read(pairs(n), 3 * n);
  REQUIRE(has_loops(read.formula));
  const std::vector<double> x = point(3 * n);
  const Values loop(with_gradient(read.formula, read.variables), read.variables, x);
  const auto plain_values = [&](Expression formula) {
    return Values(with_gradient(unrolled(formula), read.variables), read.variables, x);
  };
  const Values plain = plain_values(read.formula);
  CHECK(difference(loop, plain) <= 1.0);
  // The terms are the same numbers in both, so that only their sums differ: by 8 lanes of at most 32 terms in each
  // block of 256 with 5 more additions, and by 11 additions of folded halves.
  CHECK(std::abs(loop.automatic[0] - plain.automatic[0]) <= (32 + 5 + 11) * unit * std::abs(plain.automatic[0]));
  // A twin: the same without the last pair.
  Expression last = parse(fmt::format("k/sqrt(0.01 + (r{} - r{})^2 + (r{} - r{})^2 + (r{} - r{})^2)", 3 * n - 2,
                                      3 * n - 5, 3 * n - 1, 3 * n - 4, 3 * n, 3 * n - 3),
                          read.graph, names(3 * n));
  CHECK(difference(loop, plain_values(read.formula + last)) > 1e6);
}

TEST_CASE("rounding bounds of a loop hold, and are those of its terms") {
  constexpr int n = 60;
  Read read(pairs(n), 3 * n);
  const std::vector<double> x = point(3 * n);
  long double exact = 0.0L, size = 0.0L;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      long double square = 0.01;
      for (std::size_t c = 1; c <= 3; ++c) {
        const long double d = static_cast<long double>(x[3 * i + c]) - x[3 * j + c];
        square += d * d;
      }
      exact -= x[0] / std::sqrt(square);
      size += x[0] / std::sqrt(square);
    }
  }
  const Values loop({read.formula}, read.variables, x);
  const auto error = static_cast<double>(std::abs(loop.automatic[0] - exact));
  CHECK(error <= unit * loop.bounds[0]);
  CHECK(unit * loop.bounds[0] < 100 * unit * static_cast<double>(size));
  SumSizeEvaluator sizes(sum_size_code(parse("r1*1e6 + (" + pairs(n) + ")", read.graph, names(3 * n)), read.variables));
  // Terms of one sign: nothing cancels but the two parts of the sum.
  CHECK(sizes(x).cancelled ==
        Approx(0.03 * 2.0 * std::min(std::abs(x[1]) * 1e6, static_cast<double>(size))).epsilon(1e-9));
}

TEST_CASE("a graph with a loop does not grow with its iterations") {
  const auto nodes = [](int n, bool plain) {
    Read read(pairs(n), static_cast<std::size_t>(3 * n));
    const auto outputs = with_gradient(plain ? unrolled(read.formula) : read.formula, read.variables);
    return static_cast<double>(read.graph.size());
  };
  CHECK(nodes(200, false) / nodes(50, false) < 4.2);
  CHECK(nodes(200, true) / nodes(50, true) > 12.0);  // a twin
}

TEST_CASE("terms of loops may have numbers and conditions of their index, names, and indices of any form") {
  constexpr int n = 1100;
  const std::string r = element(0), next = element(1);
  CHECK(against_plain(fmt::format("sum(i, 1, {}, k*cos(i*pi/7)*{}^2)", n, r), written_out(n, "k*cos({0}*pi/7)*r{1}^2"),
                      elements) <= 1.0);
  CHECK(against_plain(fmt::format("sum(i, 1, {}, ({} - {})^3)/3", n, next, r),
                      "(" + written_out(n, "(r{2} - r{1})^3") + ")/3", elements) <= 1.0);
  CHECK(against_plain(fmt::format("sum(i, 1, {0}, where({1} > k, sqrt({1} - k), sin(i)*{1}))", n, r),
                      written_out(n, "where(r{1} > k, sqrt(r{1} - k), sin({0})*r{1})"), elements) <= 1.0);
  CHECK(
      against_plain(fmt::format("sum(i, 1, {0}, {1}*norm(r[mod(i, {2})+1:mod(i, {2})+3]) + {1}) - sum(i, 1, {0}, {1})",
                                n, r, elements),
                    written_out(n, "r{1}*sqrt(r{1}^2 + r[{1}+1]^2 + r[{1}+2]^2)"), elements + 2) <= 1.0);
  CHECK(against_plain(fmt::format("exp(-sum(i, 1, {0}, {1}^2)/{0})*sum(i, 1, {0}, i*{1})", n, r),
                      fmt::format("exp(-({})/{})*({})", written_out(n, "r{1}^2"), n, written_out(n, "{0}*r{1}")),
                      elements) <= 1.0);
  // A twin: the neighbour on the other side of a chain is another one.
  CHECK(against_plain(fmt::format("sum(i, 1, {}, i*({} - {})^3)/3", n, next, r),
                      "(" + written_out(n, "{2}*(r{2} - r{1})^3") + ")/3", elements) > 1e6);
}

TEST_CASE("the directional derivative of a gradient with loops is that of its terms") {
  constexpr int n = 50;
  Read read(pairs(n), 3 * n);
  const auto turned = [&](Expression formula) {
    Expression along = read.graph.constant(0.0);
    const std::vector<Expression> slopes = gradient(formula, read.variables);
    for (std::size_t i = 0; i < slopes.size(); ++i) {
      along += slopes[i] * std::cos(static_cast<double>(i));
    }
    return Values(gradient(along, read.variables), read.variables, point(3 * n));
  };
  const Values loop = turned(read.formula);
  CHECK(difference(loop, turned(unrolled(read.formula))) <= 1.0);
  CHECK(difference(loop, turned(unrolled(read.formula) * 1.0000001)) > 1e3);  // a twin
}

TEST_CASE("what is no loop is written out") {
  const auto is_loop = [](const std::string& text) { return has_loops(Read(text, 2000).formula); };
  CHECK(is_loop("sum(i, 1, 2000, r[mod(i, 220)+1]^2)"));
  CHECK_FALSE(is_loop("sum(i, 1, 880, r[mod(i, 220)+1]^2)"));
  CHECK_FALSE(is_loop("sum(i, 1, 2000, r[i]^2)"));  // as many variables as iterations
  CHECK_FALSE(is_loop("sum(i, 1, 2000, r[mod(i, 220)+1]*noise(i))"));
  CHECK_FALSE(is_loop("sum(i, 1, 2000, (1 + r[mod(i, 220)+1]^2)^(i/2000))"));
  CHECK_FALSE(is_loop("sum(i, 1, 40, sin(sum(j, 1, 40, r[i]*r[j])))"));
  CHECK(Read("sum(i, 1, 2000, 1/i^2)", 1).formula.is_constant());
}

TEST_CASE("what is wrong with the term of a loop is reported at its place") {
  const auto failure = [](const std::string& text) {
    try {
      Read(text, 2000);
    } catch (const ParseError& error) {
      return fmt::format("{}:{}", error.column(), error.reason());
    }
    return std::string();
  };
  CHECK(failure("k + sum(i, 1, 2000, r[i+1]*r[i])") == "21:there is no r[2001]");
  CHECK_THAT(failure("sum(i, 1, 2000, r[i/2])"), Contains("an integer that is known beforehand, and is 0.5"));
  CHECK_THAT(failure("sum(i, 1, 2000, r[k])"), Contains("an integer that is known beforehand"));
  CHECK_THAT(failure("sum(i, 1, 2000, s[i])"), Contains("there is no s[1]"));
}
