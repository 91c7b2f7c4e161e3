// Functions that are put together of pieces, on other branches: what tests for identities look at.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <rubato/formula/branches.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/parse.hpp>

using namespace rubato::formula;

namespace {

/// The largest value of the formula at some points on other branches, at both scales.
double largest(const std::string& text) {
  Graph graph;
  const std::array formulas = {parse(text, graph, std::array<std::string, 2>{"x", "y"})};
  double most = 0.0;
  for (ScalarEvaluator& evaluate :
       evaluators_on_branches(formulas, std::array{graph.variable("x"), graph.variable("y")})) {
    std::vector<double> value(1);
    for (const auto& [x, y] :
         {std::array{0.3, 0.9}, std::array{1.1, 0.4}, std::array{0.7, -0.2}, std::array{0.52, 1.3},
          std::array{0.9, 0.6}, std::array{1.27, 0.77}, std::array{0.11, 1.05}, std::array{0.61, 0.35}}) {
      evaluate(std::array{x, y}, value);
      most = std::max(most, std::abs(value[0]));
    }
  }
  return most;
}

}  // namespace

TEST_CASE("identities of functions in pieces hold on all branches", "[formula]") {
  for (const std::string zero :
       {"abs(-x) - abs(x)", "abs(x)^2 - x^2", "abs(x - y)*sign(x - y) - (x - y)", "sign(x)/abs(x) - 1/x",
        "sign(-x) + sign(x)", "max(x, y) + min(x, y) - x - y", "max(x, y) - max(y, x)", "floor(x + 1) - floor(x) - 1",
        "where(x > y, x, 0) + where(x <= y, x, 0) - x", "exp(x)*exp(y) - exp(x + y)", "cosh(x)^2 - sinh(x)^2 - 1",
        "sech(x)*cosh(x) - 1", "expm1(x) + 1 - exp(x)", "sin(x)^2 + cos(x)^2 - 1"}) {
    INFO(zero);
    CHECK(largest(zero) < 1e-14);
  }
}

TEST_CASE("a piece that is 0 at the points is not 0 on other branches", "[formula]") {
  for (const std::string piece :
       {"where(x > 3, 20, 0)*y", "max(0, x - 9)^3", "min(0, x + 5)", "x - abs(x)", "floor(x/10)", "sign(x - 9) + 1",
        "5*exp(-1000*(x - 12)^2)*y", "5*sech(100*(x - 12))^2*y", "erf(100*(x - 12)) + 1"}) {
    INFO(piece);
    CHECK(largest(piece) > 1e-9);
  }
}

TEST_CASE("formulas without pieces and fast growth have one branch", "[formula]") {
  const auto has_one = [](const std::string& text) {
    Graph graph;
    return have_one_branch(std::array{parse(text, graph, std::array<std::string, 2>{"x", "y"})});
  };
  CHECK(has_one("sin(x)^2*y + sqrt(1 + x^2) + log(2 + y)"));
  CHECK(have_one_branch({}));
  for (const std::string other : {"abs(x)", "sign(x)", "min(x, y)", "max(x, y)", "floor(x)", "where(x > 0, y, 1)",
                                  "exp(x)", "x*tanh(y)", "1 + cosh(x*y)"}) {
    INFO(other);
    CHECK_FALSE(has_one(other));
  }
}

TEST_CASE("a function in pieces is one of the variables that its pieces go by", "[formula]") {
  const auto has_pieces_of = [](const std::string& text, const char* name) {
    Graph graph;
    const Expression formula = parse(text, graph, std::array<std::string, 2>{"x", "y"});
    return is_piecewise(formula, std::array{graph.variable(name)});
  };
  for (const std::string text : {"abs(x)", "y*sign(x)", "min(y, x)", "max(x, 1)", "floor(x - 1)*y",
                                 "where(x > 0, y, 0)", "sqrt(1 + abs(x + y))"}) {
    INFO(text);
    CHECK(has_pieces_of(text, "x"));
  }
  for (const std::string text : {"abs(y) + x^2", "where(y > 0, x, 0)", "x*sign(y)", "exp(x)*y", "cosh(x)"}) {
    INFO(text);
    CHECK_FALSE(has_pieces_of(text, "x"));
  }
}
