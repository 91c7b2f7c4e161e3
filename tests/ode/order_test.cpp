// Order 2, by slope, on nonlinear problems, against a reference of order 4 with much shorter steps.

#include <catch2/catch.hpp>

#include <cmath>
#include <functional>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

/// z(t) of the exact flow: Runge–Kutta of order 4 with steps a fifth and less of the shortest under test; error
/// 1e-8 of theirs.
std::vector<double> reference(const System& system, double t) {
  HamiltonianEvaluator evaluator(system.hamiltonian);
  std::vector<double> z = systems::joined(system.initial);
  const auto steps = static_cast<int>(std::ceil(t / (system.step / 20.0)));
  for (int k = 0; k < steps; ++k) {
    z = systems::runge_kutta(evaluator, z, t / steps, 4);
  }
  return z;
}

/// Largest error over the levels nearest to quarters of the run, each at its own t: with variable levels no two runs
/// share their levels.
double error(const System& system, double step, double until, Levels levels) {
  const Orbit orbit = integrate(system.hamiltonian, system.initial,
                                {.step = step, .until = until, .levels = levels, .on_singular = OnSingular::stop});
  REQUIRE(orbit.status == Status::success);
  double largest = 0.0;
  for (std::size_t quarter = 1; quarter <= 4; ++quarter) {
    const std::size_t k = orbit.steps() * quarter / 4;
    largest = std::max(largest, systems::distance(systems::state_at(orbit, k), reference(system, orbit.t[k])));
  }
  return largest;
}

/// Least-squares slope of log error over log step, for steps first, first/2, … first/16.
double slope(double first, const std::function<double(double)>& error_of) {
  constexpr int sizes = 5;
  double mean = 0.0;
  double product = 0.0;
  double square = 0.0;
  std::vector<double> logs;
  for (int i = 0; i < sizes; ++i) {
    logs.push_back(std::log2(error_of(first / std::pow(2.0, i))));
    mean += logs.back() / sizes;
  }
  for (int i = 0; i < sizes; ++i) {
    const double x = 0.5 * (sizes - 1) - i;
    product += x * (logs[static_cast<std::size_t>(i)] - mean);
    square += x * x;
  }
  return product / square;
}

/// Errors are C h²(1 + O(h²)), and the ends of variable runs vary by O(h) of their length: slopes within 0.1 of 2;
/// orders 1 and 3 are far out.
constexpr double slope_tolerance = 0.1;

}  // namespace

TEST_CASE("the midpoint scheme is of order 2 with fixed and with variable levels") {
  struct Run {
    System system;
    double step, until;
  };
  for (const auto& [system, step, until] :
       {Run{systems::pendulum(), 0.1, 20.0}, Run{systems::henon_heiles(), 0.2, 20.0},
        Run{systems::kepler(0.6), 0.01, 6.0}, Run{systems::non_separable(), 0.05, 10.0}}) {
    for (const Levels levels : {Levels::fixed, Levels::variable}) {
      INFO(system.name << (levels == Levels::fixed ? ", fixed levels" : ", variable levels"));
      const double order = slope(step, [&, &of = system, &end = until](double h) { return error(of, h, end, levels); });
      INFO("slope " << order);
      CHECK(order == Approx(2.0).margin(slope_tolerance));
    }
  }
}

TEST_CASE("the slope tells other orders apart") {
  // The twins: the symplectic Euler method (order 1) and the Runge–Kutta method of order 4, by the same measure.
  const System system = systems::pendulum();
  HamiltonianEvaluator evaluator(system.hamiltonian);
  const auto slope_of = [&](const std::function<std::vector<double>(const std::vector<double>&, double)>& step) {
    return slope(0.1, [&](double h) {
      std::vector<double> z = systems::joined(system.initial);
      const auto steps = std::lround(20.0 / h);
      for (long k = 0; k < steps; ++k) {
        z = step(z, h);
      }
      return systems::distance(z, reference(system, static_cast<double>(steps) * h));
    });
  };
  const double euler = slope_of([](const auto& z, double h) {
    const double p = z[1] - h * std::sin(z[0]);
    return std::vector<double>{z[0] + h * p, p};
  });
  CHECK(euler < 2.0 - 5.0 * slope_tolerance);
  const double fourth = slope_of([&](const auto& z, double h) { return systems::runge_kutta(evaluator, z, h, 4); });
  CHECK(fourth > 2.0 + 5.0 * slope_tolerance);
}
