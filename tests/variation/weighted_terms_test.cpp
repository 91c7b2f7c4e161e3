// Sums with each term once, and terms that are moved to one place.

#include <cmath>
#include <map>

#include <catch2/catch.hpp>

#include <rubato/variation/node_code.hpp>
#include <rubato/variation/random_values.hpp>
#include <rubato/variation/weighted_terms.hpp>

using namespace rubato;
using formula::Expression;

TEST_CASE("a sum is taken apart into terms that stand once") {
  formula::Graph graph;
  const Expression x = graph.variable("x"), y = graph.variable("y"), z = graph.variable("z");
  const Expression sum = 0.5 * (x * y - (sin(z) + x * y) / 4.0) - (-(x * y)) + 3.0 * (x - y) + sin(z);
  const WeightedTerms terms(sum);
  std::map<formula::NodeIndex, double> weights;
  for (const auto& [term, weight] : terms.terms()) {
    weights[term.index()] = weight;
  }
  REQUIRE(weights.size() == 3);
  CHECK(weights.at((x * y).index()) == 0.5 - 0.125 + 1.0);
  CHECK(weights.at(sin(z).index()) == 1.0 - 0.125);
  CHECK(weights.at((x - y).index()) == 3.0);  // exactly zero where both are equal
  const auto value = [](std::size_t variable) { return 0.3 + 0.2 * static_cast<double>(variable); };
  const std::vector<double> both = values_at(std::array{sum, terms.sum()}, value);
  CHECK(both[0] == Approx(both[1]).epsilon(1e-15));
  // The twin.
  CHECK(both[0] != Approx(values_at(std::array{WeightedTerms(sum + 1e-9 * x).sum()}, value)[0]).epsilon(1e-15));
}

TEST_CASE("what cancels is no term") {
  formula::Graph graph;
  const Expression x = graph.variable("x"), square = x * x;
  CHECK_FALSE(WeightedTerms(square - 0.5 * (square + square)).sum().valid());
  CHECK(WeightedTerms(square - 0.25 * (square + square)).sum() == 0.5 * square);
}
