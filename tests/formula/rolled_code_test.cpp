// Machine code in loops computes what the interpreter computes, bit for bit.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/machine_code.hpp>
#include <rubato/formula/parse.hpp>
#include <rubato/formula/rolled_code.hpp>

#include "engines.hpp"
#include "random_formula.hpp"

using namespace rubato::formula;
using testing::disagreements;

namespace {

using Points = std::vector<std::vector<double>>;

Points random_points(std::size_t count, std::size_t size) {
  std::mt19937_64 random(20261123);
  std::normal_distribution<double> normal;
  Points points(count, std::vector<double>(size));
  for (auto& point : points) {
    for (double& x : point) {
      x = normal(random);
    }
  }
  return points;
}

struct Chain {
  Graph graph;
  std::vector<std::string> names;
  std::vector<Expression> q;

  explicit Chain(std::size_t n) {
    for (std::size_t i = 1; i <= n; ++i) {
      names.push_back(fmt::format("q{}", i));
      q.push_back(graph.variable(names.back()));
    }
  }
  [[nodiscard]] std::vector<Expression> with_derivatives(Expression value, bool second) {
    std::vector<Expression> outputs{value};
    const auto first = gradient(value, q);
    outputs.insert(outputs.end(), first.begin(), first.end());
    if (second) {
      for (const auto& [i, j, entry] : hessian_entries(value, q)) {
        outputs.push_back(entry);
      }
    }
    return outputs;
  }
};

/// How many instructions go in loops, of `lanes`.
std::size_t in_loops(const Bytecode& code, int lanes) {
  const auto rolled = roll(code, single_assignment(code), lanes);
  std::size_t count = 0;
  if (rolled) {
    for (const RolledCode::Phase& phase : rolled->phases) {
      for (const RolledCode::Loop& loop : phase.loops) {
        count += loop.body.size() * loop.length;
      }
    }
  }
  return count;
}

bool has_machine_code() {
  Graph graph;
  const std::array x{graph.variable("x")};
  return ScalarEvaluator(Bytecode(x, x)).is_machine_code();
}

}  // namespace

TEST_CASE("chains in loops are the interpreter's, to the bit, of every length and with every kind of end") {
  if (!has_machine_code()) {
    WARN("no machine code here: nothing compared");
    return;
  }
  const std::vector<std::string> sums{
      "sum(i, 1, N, q[i]^2)/2",
      "(q1^2 + sum(i, 1, N-1, (q[i+1] - q[i])^2) + q[N]^2)/2 + (q1^3 + sum(i, 1, N-1, (q[i+1] - q[i])^3) - q[N]^3)/3",
      "sum(i, 1, N-1, (q[i+1] - q[i])^2)/2 + (q1 - q[N])^2/2 + sum(i, 1, N, 1 - cos(q[i]))",
      "sum(i, 2, N-1, (q[i-1] - 2*q[i] + q[i+1])^2/(1 + q[i]^2))",
      "sum(i, 1, N-2, exp(q[i] - q[i+2]) - 1) + sum(i, 1, N, q[i]^4)/4",
      "sum(i, 1, N-1, sqrt(1 + (q[i+1] - q[i])^2)) - q3*q4 + abs(q5) + sin(q6)*cos(q6)",
      "sum(i, 1, N-1, min(q[i], q[i+1])^2) + sum(i, 1, N, sin(q[i])*cos(q[i]))",
      "sum(i, 1, N, sum(j, 1, 3, q[i]^(2*j)))",
      "sum(i, 1, N, q[i]^(-2) + q[i]^9) + sum(i, 1, N-1, (q[i]*q[i+1])^11)",
      "sum(i, 1, N-1, q[i]*q[i+1])*sum(i, 1, N, q[i])"};
  std::size_t rolled = 0;
  for (const std::string& sum : sums) {
    for (const std::size_t n : {8U, 15U, 16U, 17U, 23U, 24U, 31U, 33U, 64U, 100U, 129U}) {
      std::string text = sum;
      for (std::size_t at = text.find('N'); at != std::string::npos; at = text.find('N', at)) {
        text.replace(at, 1, std::to_string(n));
      }
      INFO(text);
      Chain chain(n);
      const Expression value = parse(text, chain.graph, chain.names);
      for (const bool second : {false, true}) {
        const auto outputs = chain.with_derivatives(value, second);
        const Bytecode code(outputs, chain.q);
        CHECK(disagreements(code, code, random_points(3, n)) == 0);
        rolled += n >= 31 && 2 * in_loops(code, 4) > code.instructions().size() ? 1 : 0;
      }
      // The twin: one of the springs, or whatever it is, is another one.
      const Expression other = value + chain.q[n / 2] * 1e-3;
      CHECK(disagreements(Bytecode(chain.with_derivatives(other, false), chain.q),
                          Bytecode(chain.with_derivatives(value, false), chain.q), random_points(1, n)) >= 2);
    }
  }
  CHECK(rolled > 60);  // of 100
}

TEST_CASE("random formulas of neighbours, added up, are the interpreter's in loops, to the bit") {
  if (!has_machine_code()) {
    return;
  }
  std::size_t differences = 0, rolled = 0, compared = 0;
  CHECK(rc::check("loops against the interpreter", [&] {
    Graph terms;
    const std::vector<Expression> xyz{terms.variable("x"), terms.variable("y"), terms.variable("z")};
    std::vector<Expression> some = testing::build(terms, *testing::recipes(12));
    const std::array formulas{some.back(), some[some.size() / 2]};
    const auto n = static_cast<std::size_t>(*rc::gen::inRange(20, 80));
    const bool periodic = *rc::gen::inRange(0, 2) == 1;
    Chain chain(n);
    std::vector<Expression> made, inputs = chain.q;
    const Expression far = chain.q[n / 2];
    for (std::size_t i = 0; i < n; ++i) {
      if (!periodic && (i == 0 || i + 1 == n)) {
        continue;
      }
      const std::array at{chain.q[(i + n - 1) % n], chain.q[i], chain.q[(i + 1) % n]};
      for (const Expression& one : substitute(formulas, chain.graph, xyz, at)) {
        made.push_back(one);
      }
    }
    Expression sum = made.front() * far;
    for (std::size_t k = 1; k < made.size(); ++k) {
      sum += made[k];
    }
    std::vector<Expression> outputs = chain.with_derivatives(sum, true);
    outputs.insert(outputs.end(), made.rbegin(), made.rend());
    outputs.insert(outputs.end(), chain.q.begin(), chain.q.end());
    const Bytecode code(outputs, inputs);
    const std::size_t wrong = disagreements(code, code, random_points(2, n));
    differences += wrong;
    RC_ASSERT(wrong == 0U);
    rolled += in_loops(code, 8) > 0 ? 1 : 0;
    ++compared;
  }));
  CHECK(differences == 0);
  CHECK(compared > 300);
  CHECK(rolled > 100);
}

TEST_CASE("a chain goes in loops but for its ends, and its code does not grow with it") {
  std::vector<std::size_t> sizes;
  for (const std::size_t n : {256U, 1024U}) {
    Chain chain(n);
    const Expression value =
        parse(fmt::format("(q1^2 + sum(i, 1, {0}, (q[i+1] - q[i])^2) + q{1}^2)/2 + sum(i, 1, {0}, (q[i+1] - q[i])^4)",
                          n - 1, n),
              chain.graph, chain.names);
    const Bytecode code(chain.with_derivatives(value, false), chain.q);
    if (has_machine_code()) {
      for (const int lanes : {2, 4, 8}) {
        CHECK(in_loops(code, lanes) + 100 > code.instructions().size());
      }
      sizes.push_back(MachineCode::compile(code)->bytes());
    }
  }
  if (!sizes.empty()) {
    CHECK(sizes[1] < sizes[0] + sizes[0] / 2);
  }
}

TEST_CASE("long sums are folded, which keeps their rounding small") {
  constexpr std::size_t n = 4096;
  Chain chain(n);
  const Expression value = parse(fmt::format("sum(i, 1, {}, q[i])", n), chain.graph, chain.names);
  ScalarEvaluator evaluate(Bytecode(std::array{value}, chain.q));
  const std::vector<double> tenths(n, 0.1);
  // Of log2 n = 12 roundings in a row, here none: doubling is exact. One after the other they would add up.
  CHECK(evaluate.at(tenths.data())[0] == 0.1 * n);
  double in_order = 0.0;
  for (const double x : tenths) {
    in_order += x;
  }
  CHECK(in_order != 0.1 * n);  // the twin
}
