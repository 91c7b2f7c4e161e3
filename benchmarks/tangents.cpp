// What tangent vectors cost: a bare step of an orbit with k of them, beside one without. "over_plain" is the ratio of
// the two within one benchmark. Of whole runs, with their records, it is at most about 1 + 2k, and 3.3 with one vector
// of Gauss 3; short explicit steps exceed it here, since QR takes as long as they do.

#include <chrono>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <rubato/ode/integrate.hpp>
#include <rubato/ode/orbit_tangent.hpp>
#include <rubato/ode/tangent_vectors.hpp>

namespace {

using namespace rubato;
using Clock = std::chrono::steady_clock;

const Hamiltonian henon_heiles({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3");
const InitialState start{.q = {0.0, -0.1}, .p = {0.47, 0.1}};

struct Scheme {
  const char* name;
  SegmentLagrangian lagrangian;
  Levels levels;
  double step;
};
const Scheme schemes[] = {
    {"midpoint_fixed", Midpoint{}, Levels::fixed, 0.05},
    {"midpoint_variable", Midpoint{}, Levels::variable, 0.05},
    {"gauss_2_fixed", Gauss{2}, Levels::fixed, 0.1},
    {"gauss_3_fixed", Gauss{3}, Levels::fixed, 0.2},
    {"gauss_4_variable", Gauss{4}, Levels::variable, 0.2},
    {"golden_fixed", Splitting{"golden"}, Levels::fixed, 0.05},
    {"blanes_moan_4_fixed", Splitting{"blanes-moan-4"}, Levels::fixed, 0.1},
    {"generating_4_fixed", Generating{.order = 4}, Levels::fixed, 0.1},
};

/// Seconds of so many steps, with `count` vectors. \return a number that depends on all of them in `sink`
double seconds(const Scheme& scheme, std::size_t count, int steps, double& sink) {
  OrbitIntegrator integrator(
      henon_heiles, start,
      {.lagrangian = scheme.lagrangian, .step = scheme.step, .until = 1e9, .levels = scheme.levels});
  std::vector<double> z(4), next(4);
  const auto read = [&](std::vector<double>& into) {
    const auto state = integrator.scheme().state();
    into.assign(state.begin(), state.end());
  };
  TangentVectors vectors(make_orbit_tangent(henon_heiles, scheme.lagrangian, false, integrator.scheme().state()), 4,
                         count, false);
  static_cast<void>(integrator.step());  // variable levels look ahead in the first
  read(z);
  const auto begin = Clock::now();
  for (int k = 0; k < steps; ++k) {
    const double t = integrator.t();
    const StepReport report = integrator.step();
    read(next);
    if (count > 0) {
      static_cast<void>(vectors.step(z, next, t, report.h));
      sink += vectors.logarithms()[0];
    }
    std::swap(z, next);
  }
  sink += z[0];
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

void with_vectors(benchmark::State& state, const Scheme& scheme, std::size_t count) {
  constexpr int steps = 2000;
  double plain = 0.0, carried = 0.0, sink = 0.0;
  for (auto _ : state) {
    plain += seconds(scheme, 0, steps, sink);
    carried += seconds(scheme, count, steps, sink);
  }
  benchmark::DoNotOptimize(sink);
  state.counters["ns_a_step"] = carried / static_cast<double>(state.iterations()) / steps * 1e9;
  state.counters["over_plain"] = carried / plain;
  state.counters["bar"] = 1.0 + 2.0 * static_cast<double>(count);
}

const int registered = [] {
  for (const Scheme& scheme : schemes) {
    for (const std::size_t count : {1, 2, 4}) {
      benchmark::RegisterBenchmark(fmt::format("tangents/{}/{}", scheme.name, count).c_str(),
                                   [&scheme, count](benchmark::State& state) { with_vectors(state, scheme, count); });
    }
  }
  return 0;
}();

}  // namespace

BENCHMARK_MAIN();
