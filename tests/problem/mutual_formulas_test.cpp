// [parameters] and [definitions]: formulas that name each other, in any order and however many.

#include <catch2/catch.hpp>

#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/problem/problem.hpp>

#include "problem_texts.hpp"

namespace {

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

/// The pendulum with other [parameters], and [definitions].
Problem read(const std::string& parameters, const std::string& definitions = "") {
  return parse_problem(replaced(pendulum, "[parameters]\nk = 1.0\n",
                                "[definitions]\n" + definitions + "[parameters]\nk = 1.0\n" + parameters),
                       "t.toml");
}

std::string refusal(const std::string& parameters, const std::string& definitions = "") {
  try {
    static_cast<void>(read(parameters, definitions));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

double value(const Problem& problem, std::string_view name) {
  const Parameter* const parameter = problem.parameters.find(name);
  REQUIRE(parameter != nullptr);
  return parameter->value;
}

/// A formula of q at q = x.
double at(const Problem& problem, const std::string& text, double x) {
  formula::Graph graph;
  const std::vector<std::string> names = {"q"};
  const std::vector<formula::Expression> outputs = {problem.build({text, {}}, graph, names)},
                                         inputs = {graph.variable("q")};
  formula::ScalarEvaluator evaluate{formula::Bytecode(outputs, inputs)};
  evaluate.inputs()[0] = x;
  evaluate.run();
  return evaluate.output(0);
}

}  // namespace

TEST_CASE("a parameter may be any formula of other parameters", "[problem]") {
  // The first column names the second, which comes later in the file: the same with its number in its place.
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"4*ellipk(m)", "4*ellipk(0.64)"},
      {"ellipe(m)", "ellipe(0.64)"},
      {"sn(0.3, m) + cn(0.3, m)*dn(0.3, m)", "sn(0.3, 0.64) + cn(0.3, 0.64)*dn(0.3, 0.64)"},
      {"besselj(n, m) + bessely(n - 1, 2)", "besselj(3, 0.64) + bessely(2, 2)"},
      {"noise(n)", "noise(3)"},
      {"sum(i, 1, n, i^2)", "14"},
      {"sum(i, 1, n, c[i])", "60"},
      {"c[n - 1]", "20"},
      {"norm(c)", "norm(10, 20, 30)"},
      {"where(m < n, m, n)", "0.64"},
  };
  for (const auto& [formula, number] : cases) {
    INFO(formula);
    const std::string late = fmt::format(
        "f = \"{}\"\ng = \"{}\"\nm = \"m2^2\"\nm2 = 0.8\nn = \"1 + n2\"\nn2 = 2\n"
        "c3 = \"c1 + c2\"\nc2 = 20\nc1 = \"c2/2\"\n",
        formula, number);
    // 0.8^2 is one rounding away from 0.64, and no formula here magnifies that by more than 2.
    const Problem problem = read(late);
    CHECK(value(problem, "f") == Approx(value(problem, "g")).epsilon(1e-15));
  }
  CHECK_THAT(refusal("m = \"4*ellipk(n)\"\nn = \"m/4\"\n"), Contains("in a cycle: m -> n -> m"));
  CHECK_THAT(refusal("m = \"besselj(n, 1)\"\nn = 0.5\n"),
             Contains("t.toml:9:6") && Contains("the order of besselj has to be an integer") && Contains("is 0.5"));
  CHECK_THAT(refusal("m = \"4*ellipk(n)\"\nn = \"2\"\n"), Contains("m of ellipk has to be a number"));
  CHECK_THAT(refusal("m = \"a + b\"\na = \"c\"\nb = \"a + d\"\n"), Contains("unknown name 'c'"));
}

TEST_CASE("a definition may stand where a number has to be known, if it is one", "[problem]") {
  const Problem problem = read("m = 0.5\n", "E = \"sn(q, M)\"\nM = \"m/2\"\n");
  CHECK(at(problem, "E", 0.3) == at(problem, "sn(q, 0.25)", 0.3));
  CHECK_THAT(refusal("", "E = \"sn(q, M)\"\nM = \"q/2\"\n"), Contains("the parameter m of an elliptic function"));
}

TEST_CASE("a cycle is named in its order, wherever one meets it", "[problem]") {
  CHECK_THAT(refusal("a = \"b + c\"\nb = \"c\"\nc = \"d + b\"\nd = 1\n"), Contains("parameters depend on each other"));
  CHECK_THAT(refusal("a = \"b + c\"\nb = \"2*c\"\nc = \"2*a\"\n"), Contains("in a cycle: a -> b -> c -> a"));
  CHECK_THAT(refusal("a = \"a\"\n"), Contains("in a cycle: a -> a"));
  CHECK_THAT(refusal("", "a = \"b*c\"\nb = \"c\"\nc = \"q + a\"\n"), Contains("in a cycle: a -> b -> c -> a"));
}

TEST_CASE("twenty thousand of them, each naming others, are read in linear time", "[problem]") {
  // Once this took minutes, and a chain of definitions one call inside another for each of its links.
  constexpr int count = 20'000;
  std::string parameters, chain = "d0 = \"q\"\n", events = "[events]\n", invariants = "[invariants]\n";
  for (int i = count; i > 0; --i) {  // the last is needed first
    parameters += fmt::format("c{} = \"c{} + 1\"\n", i, i - 1);
    chain += fmt::format("d{} = \"d{}/2 + c{}\"\n", i, i - 1, i);
    invariants += fmt::format("I{} = \"p^2*c{}\"\n", i, i);
    events += fmt::format("e{} = \"q - c{}\"\n", i, i);
  }
  parameters += "c0 = 0\ntotal = \"sum(i, 1, 20000, c[i])\"\n";
  const Problem problem = read(parameters + invariants + events, chain);
  CHECK(value(problem, "c20000") == count);
  CHECK(value(problem, "total") == 0.5 * count * (count + 1));
  CHECK(problem.hamiltonian()->invariants.size() == count);
  // d = d/2 + c has d = 2c - 2 + (q + 2)/2^k.
  CHECK(at(problem, "d20000", 0.5) == 2.0 * count - 2.0);
  CHECK(at(problem, "d2", 0.5) == Approx(2.0 + 2.5 / 4.0));
  // Two before each: once as many as there are ways through them.
  std::string pairs = "f0 = \"q\"\nf1 = \"q\"\n";
  for (int i = 2; i < 90; ++i) {
    pairs += fmt::format("f{} = \"(f{} + f{})/2\"\n", i, i - 1, i - 2);
  }
  CHECK(at(read("", pairs), "f89", 0.5) == 0.5);
  CHECK_THAT(refusal(replaced(parameters, "c0 = 0", "c0 = \"c20000\"")), Contains("in a cycle") && Contains("…"));
}
