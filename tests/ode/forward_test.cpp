// The forward 𝕃 (3.23): its parasitic root (theory, section 2.2), what it keeps for the few steps it survives, and its
// refusal to run as an initial-value method.

#include <catch2/catch.hpp>

#include <cmath>

#include <Eigen/Eigenvalues>

#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/two_step_scheme.hpp>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

/// The multiplier by which two orbits from starting pairs that differ by 1e-12 part in each of a few fixed-level steps,
/// measured once the parasite dominates.
double measured_multiplier(const System& system, const SegmentLagrangian& lagrangian, double h) {
  const double omega_h = h;
  const auto start = [&](double disturbance) {
    const SegmentNode first{0.0, {1.0, 0.0}};
    const SegmentNode second{h, {std::cos(omega_h) + disturbance, -std::sin(omega_h)}};
    return make_two_step_scheme(make_action(system.hamiltonian, lagrangian), system.hamiltonian, first, second);
  };
  const auto exact = start(0.0);
  const auto disturbed = start(1e-6);
  double last = 0.0;
  double ratio = 0.0;
  for (int k = 0; k < 4; ++k) {
    for (const auto& scheme : {exact.get(), disturbed.get()}) {
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      scheme->accept();
    }
    const double difference = disturbed->state()[0] - exact->state()[0];
    ratio = last == 0.0 ? 0.0 : difference / last;
    last = difference;
  }
  return ratio;
}

/// The root of 4s = x²(1-s)², s = sin²(θ/2), with |e^{iθ}| largest; e^{iθ} + e^{-iθ} = 2 - 4s.
double theoretical_multiplier(double x) {
  const double a = x * x;
  const double s = (2.0 * a + 4.0 + std::sqrt((2.0 * a + 4.0) * (2.0 * a + 4.0) - 4.0 * a * a)) / (2.0 * a);
  const double half = 1.0 - 2.0 * s;
  return half - std::sqrt(half * half - 1.0);
}

}  // namespace

TEST_CASE("the parasitic multiplier of the forward discrete Lagrangian on the oscillator is that of theory") {
  const System system = systems::oscillator();
  for (const double h : {0.05, 0.1, 0.2, 0.4}) {
    const double theory = theoretical_multiplier(h);
    const double measured = measured_multiplier(system, Forward{}, h);
    INFO("h = " << h << ": measured " << measured << ", theory " << theory);
    CHECK(measured == Approx(theory).epsilon(0.01));
    // The leading term -16/(hω)², and the twin: a scheme without that parasite (the midpoint's multiplier is -1).
    CHECK(theory == Approx(-16.0 / (h * h)).epsilon(h * h + 0.01));
    CHECK(std::abs(measured_multiplier(system, Midpoint{}, h)) < 10.0);
  }
}

TEST_CASE("the forward discrete Lagrangian is refused as an initial-value method, with the reason") {
  const System system = systems::pendulum();
  IntegrationOptions options{.lagrangian = Forward{}, .step = 0.1, .until = 10.0};
  CHECK_THROWS_AS(integrate(system.hamiltonian, system.initial, options), UnstableError);
  CHECK_THROWS_WITH(integrate(system.hamiltonian, system.initial, options),
                    Catch::Contains("unstable") && Catch::Contains("16/(h w)^2") && Catch::Contains("100 steps") &&
                        Catch::Contains("allow_unstable") && Catch::Contains("midpoint"));
  options.until = 0.1 * static_cast<double>(forward_step_limit);
  CHECK_NOTHROW(OrbitIntegrator(system.hamiltonian, system.initial, options));
  options.until = 10.0;
  options.lagrangian = Forward{.allow_unstable = true};
  CHECK_NOTHROW(OrbitIntegrator(system.hamiltonian, system.initial, options));
  options.lagrangian = Midpoint{};
  CHECK_NOTHROW(OrbitIntegrator(system.hamiltonian, system.initial, options));
}

TEST_CASE("allowed to run, the forward discrete Lagrangian is soon swamped") {
  // Rounding 1e-16 times 1600 per step reaches 1 within about six steps: the warning is no exaggeration.
  const System system = systems::oscillator();
  const auto error_after = [&](const SegmentLagrangian& lagrangian) {
    const Orbit orbit = integrate(system.hamiltonian, system.initial,
                                  {.lagrangian = lagrangian, .step = 0.1, .until = 1.0, .levels = Levels::fixed});
    return orbit.status == Status::success ? std::abs(orbit.q_at(orbit.steps())[0] - std::cos(orbit.t.back()))
                                           : std::numeric_limits<double>::infinity();
  };
  CHECK(error_after(Forward{.allow_unstable = true}) > 1.0);
  CHECK(error_after(Midpoint{}) < 1e-2);
}
