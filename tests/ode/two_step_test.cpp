// The two-step form (3.3) from an arbitrary starting pair (theory, section 2.1): from an exact pair it is the one-step
// midpoint rule; from another the defect d_k = δ_k - h_k J∇H(z̄_k) alternates, (-1)^k d_0, also with variable levels.

#include <catch2/catch.hpp>

#include <algorithm>

#include <rubato/ode/discrete_lagrangian.hpp>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

constexpr std::size_t steps = 1000;

std::vector<double> defect(HamiltonianEvaluator& hamiltonian, const Orbit& orbit, std::size_t k) {
  const auto z_0 = systems::state_at(orbit, k);
  const auto z_1 = systems::state_at(orbit, k + 1);
  const auto f = systems::velocity(hamiltonian, systems::middle(z_0, z_1));
  std::vector<double> d(f.size());
  for (std::size_t i = 0; i < d.size(); ++i) {
    d[i] = z_1[i] - z_0[i] - orbit.h[k] * f[i];
  }
  return d;
}

/// Largest |d_k - sign^k d_0| over the orbit.
double departure(const Hamiltonian& hamiltonian, const Orbit& orbit, double sign) {
  HamiltonianEvaluator evaluator(hamiltonian);
  const auto first = defect(evaluator, orbit, 0);
  double largest = 0.0;
  double factor = 1.0;
  for (std::size_t k = 0; k < orbit.steps(); ++k, factor *= sign) {
    const auto d = defect(evaluator, orbit, k);
    for (std::size_t i = 0; i < d.size(); ++i) {
      largest = std::max(largest, std::abs(d[i] - factor * first[i]));
    }
  }
  return largest;
}

/// The first `steps` steps and their end, from a starting pair whose second node is a midpoint step plus `disturbance`.
Orbit two_step_orbit(const System& system, double disturbance, Levels levels = Levels::variable,
                     const SegmentLagrangian& lagrangian = Midpoint{}) {
  const Orbit first = integrate(system.hamiltonian, system.initial, {.step = system.step, .until = system.step});
  InitialState next{.q = {first.q_at(1).begin(), first.q_at(1).end()},
                    .p = {first.p_at(1).begin(), first.p_at(1).end()},
                    .t = system.step};
  next.q[0] += disturbance;
  next.p[0] -= 0.5 * disturbance;
  return integrate(system.hamiltonian, system.initial,
                   {.lagrangian = lagrangian,
                    .step = system.step,
                    .until = 1e9,
                    .levels = levels,
                    .on_singular = OnSingular::stop,
                    .max_steps = steps,
                    .next = next});
}

Orbit one_step_orbit(const System& system, Levels levels = Levels::variable) {
  return integrate(
      system.hamiltonian, system.initial,
      {.step = system.step, .until = 1e9, .levels = levels, .on_singular = OnSingular::stop, .max_steps = steps});
}

double distance(const Orbit& a, const Orbit& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k <= steps; ++k) {
    largest = std::max(
        {largest, systems::distance(systems::state_at(a, k), systems::state_at(b, k)), std::abs(a.t[k] - b.t[k])});
  }
  return largest;
}

/// Rounding in 1000 steps. A step leaves a few ε in δ; the parasite keeps it for good, so that defects wander by
/// sqrt(1000) to 1000 times 1e-16 (in the two-step form δ is read off the induced momenta, of size 2).
constexpr double defect_rounding = 1000 * 4 * 2.2e-16;

/// Two orbits that differ by rounding. Rounding of the level equation, at most 1e-14 relative, moves h by 4e-14/(h²Γ)
/// relative, 1e-11 and less at h = 0.1; each step's error moves all later ones along the orbit, in time and in state.
constexpr double orbit_rounding = 1e-9;

std::vector<System> orbits() {
  return {systems::pendulum(), systems::henon_heiles(), systems::double_well(), systems::non_separable()};
}

}  // namespace

TEST_CASE("from an exact pair the two-step form is the one-step midpoint rule") {
  for (const System& system : orbits()) {
    for (const Levels levels : {Levels::variable, Levels::fixed}) {
      INFO(system.name << (levels == Levels::fixed ? ", fixed levels" : ", variable levels"));
      const Orbit one = one_step_orbit(system, levels);
      const Orbit two = two_step_orbit(system, 0.0, levels);
      REQUIRE(one.steps() == steps);
      REQUIRE(two.steps() == steps);
      const double apart = distance(one, two);
      INFO("apart by " << apart);
      CHECK(apart <= orbit_rounding);
      CHECK(departure(system.hamiltonian, two, -1.0) <= defect_rounding);
      // The twin: a starting pair wrong in the eighth digit is seen.
      CHECK(distance(one, two_step_orbit(system, 1e-7, levels)) > orbit_rounding);
    }
  }
}

TEST_CASE("from a disturbed pair the defect alternates for 1000 steps of variable levels") {
  for (const System& system : orbits()) {
    for (const Levels levels : {Levels::variable, Levels::fixed}) {
      INFO(system.name << (levels == Levels::fixed ? ", fixed levels" : ", variable levels"));
      const double disturbance = 1e-3;
      const Orbit orbit = two_step_orbit(system, disturbance, levels);
      INFO(orbit.message);
      REQUIRE(orbit.steps() == steps);
      const double alternating = departure(system.hamiltonian, orbit, -1.0);
      INFO("d_k - (-1)^k d_0: " << alternating);
      CHECK(alternating <= defect_rounding);
      CHECK(departure(system.hamiltonian, orbit, 1.0) > 1e-4);  // it does alternate, and is there
    }
  }
}

TEST_CASE("the discrete energy is exact from a disturbed pair too") {
  // On the double well a loosely solved trial lands within 1e-11 of the root: it must not decide on which side it is.
  for (const System& system : orbits()) {
    INFO(system.name);
    CHECK(two_step_orbit(system, 1e-3).discrete_energy_deviation() <= 1e-13);
  }
}

TEST_CASE("the defect of another discrete Lagrangian does not alternate") {
  // The twin: with h²/100 q_0 q_1 added to 𝕃, (3.3) is no longer d_k + d_{k-1} = 0.
  const System system = systems::pendulum();
  const Custom other{
      "(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - (p_0 + p_1)^2/8 + cos((q_0 + q_1)/2)"
      " + (t_1 - t_0)^2/100*q_0*q_1"};
  const Orbit orbit = two_step_orbit(system, 1e-3, Levels::fixed, other);
  REQUIRE(orbit.steps() == steps);
  CHECK(departure(system.hamiltonian, orbit, -1.0) > 1e6 * defect_rounding);
}

TEST_CASE("a starting pair that contradicts the step or the sizes is refused") {
  const System system = systems::pendulum();
  IntegrationOptions options{.step = 0.1, .until = 1.0};
  options.next = InitialState{.q = {0.19}, .p = {1.89}, .t = 0.2};
  CHECK_THROWS_WITH(integrate(system.hamiltonian, system.initial, options),
                    Catch::Contains("0.1") && Catch::Contains("0.2"));
  options.next = InitialState{.q = {0.19, 0.0}, .p = {1.89}, .t = 0.1};
  CHECK_THROWS_AS(integrate(system.hamiltonian, system.initial, options), std::invalid_argument);
  options.next = InitialState{.q = {0.19}, .p = {1.89}, .t = 0.1};
  CHECK_NOTHROW(integrate(system.hamiltonian, system.initial, options));
}
