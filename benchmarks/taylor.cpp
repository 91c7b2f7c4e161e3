// Taylor series of the flow of N bodies in space (3N degrees of freedom): alone, and several side by side (what a
// generating function costs per solve). The arguments are the bodies, the order and the lanes; growth per doubling of
// the order shows the exponent.
#include <benchmark/benchmark.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <rubato/formula/expression.hpp>
#include <rubato/formula/taylor.hpp>
#include <vector>

namespace {

using namespace rubato::formula;

struct Bodies {
  Bytecode field;
  std::vector<double> start;
};

Bodies prepare(std::size_t count) {
  Graph graph;
  const std::size_t n = 3 * count;
  std::vector<Expression> z;
  for (std::size_t m = 0; m < 2 * n; ++m)
    z.push_back(graph.variable(fmt::format("{}{}", m < n ? 'q' : 'p', m % n)));
  Expression energy = graph.constant(0.0);
  for (std::size_t m = n; m < 2 * n; ++m)
    energy += z[m] * z[m] / 2;
  for (std::size_t a = 0; a < count; ++a)
    for (std::size_t b = 0; b < a; ++b) {
      Expression square = graph.constant(0.0);
      for (std::size_t k = 0; k < 3; ++k) {
        const Expression difference = z[3 * a + k] - z[3 * b + k];
        square += difference * difference;
      }
      energy -= 1 / sqrt(square);
    }
  const std::vector<Expression> g = gradient(energy, z);
  std::vector<Expression> f(g.begin() + static_cast<std::ptrdiff_t>(n), g.end());
  for (std::size_t m = 0; m < n; ++m)
    f.push_back(-g[m]);
  Bodies bodies{Bytecode(f, z, false), {}};
  for (std::size_t m = 0; m < 2 * n; ++m)
    bodies.start.push_back(std::sin(1.0 + 2.7 * static_cast<double>(m)));
  return bodies;
}

void report(benchmark::State& state, const Bodies& bodies) {
  state.counters["instructions"] = static_cast<double>(bodies.field.instructions().size());
}

void flow(benchmark::State& state) {
  const Bodies bodies = prepare(static_cast<std::size_t>(state.range(0)));
  TaylorFlow taylor(bodies.field, static_cast<int>(state.range(1)));
  for ([[maybe_unused]] const auto iteration : state)
    if (taylor(bodies.start) != rubato::Status::success)
      return state.SkipWithError(taylor.failure().c_str());
  report(state, bodies);
}

/// Series side by side, every order from the one before by a map between lanes: what a generating function does.
void lanes(benchmark::State& state) {
  const Bodies bodies = prepare(static_cast<std::size_t>(state.range(0)));
  const int order = static_cast<int>(state.range(1));
  TaylorEvaluator field(bodies.field, order, static_cast<int>(state.range(2)));
  const std::size_t n = field.lanes();
  const TaylorEvaluator::LaneMap map(field, std::vector<double>(n * n, 0.5 / static_cast<double>(n)));
  for ([[maybe_unused]] const auto iteration : state) {
    field.restart();
    for (std::size_t m = 0; m < bodies.start.size(); ++m) {
      std::ranges::fill(field.input(m, 0), bodies.start[m]);
    }
    for (int d = 0; d <= order; ++d) {
      if (d > 0) {
        field.feed_back(map);
      }
      if (field.advance() != rubato::Status::success)
        return state.SkipWithError(field.failure().c_str());
    }
  }
  report(state, bodies);
}

BENCHMARK(flow)->ArgsProduct({{2, 6}, {5, 10, 20, 40}})->Unit(benchmark::kMicrosecond);
BENCHMARK(lanes)->ArgsProduct({{2, 6}, {5, 10, 20}, {1, 4, 8, 12}})->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
