// A discrete Lagrangian of the user's, as a formula: the midpoint one spelt out is the midpoint one, and with explicit
// time the energy balance (3.4) holds in place of the energy law.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>

#include <rubato/ode/custom_consistency.hpp>
#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/variation/total_variation.hpp>

#include "pairs.hpp"

using namespace rubato;
using systems::System;

namespace {

constexpr std::size_t steps = 1000;

Orbit run(const System& system, const SegmentLagrangian& lagrangian, Levels levels = Levels::variable) {
  return integrate(system.hamiltonian, system.initial,
                   {.lagrangian = lagrangian,
                    .step = system.step,
                    .until = 1e9,
                    .levels = levels,
                    .on_singular = OnSingular::stop,
                    .max_steps = steps});
}

/// Largest difference in states and levels over 1000 steps; infinite if a run is shorter.
double distance(const Orbit& a, const Orbit& b) {
  if (a.steps() != steps || b.steps() != steps) {
    return std::numeric_limits<double>::infinity();
  }
  double largest = 0.0;
  for (std::size_t k = 0; k <= steps; ++k) {
    largest = std::max(
        {largest, systems::distance(systems::state_at(a, k), systems::state_at(b, k)), std::abs(a.t[k] - b.t[k])});
  }
  return largest;
}

/// The same at equal times: states of `b` are carried along the orbit, by J∇H, to the levels of `a`.
double distance_along(const Hamiltonian& hamiltonian, const Orbit& a, const Orbit& b) {
  HamiltonianEvaluator evaluator(hamiltonian);
  double largest = a.steps() == steps && b.steps() == steps ? 0.0 : std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k <= std::min(a.steps(), b.steps()); ++k) {
    auto z = systems::state_at(b, k);
    const auto f = systems::velocity(evaluator, z);
    for (std::size_t i = 0; i < z.size(); ++i) {
      z[i] += (a.t[k] - b.t[k]) * f[i];
    }
    largest = std::max(largest, systems::distance(systems::state_at(a, k), z));
  }
  return largest;
}

/// Largest |∂A_k/∂t_k + ∂A_{k-1}/∂t_k| over the interior levels: (3.4).
double imbalance(DiscreteAction& action, const Orbit& orbit) {
  double largest = 0.0;
  for (std::size_t k = 1; k < orbit.steps(); ++k) {
    const auto at = [&](std::size_t level) { return systems::state_at(orbit, level); };
    const auto before = pairs::segment(orbit.t[k - 1], at(k - 1), orbit.t[k], at(k));
    const auto after = pairs::segment(orbit.t[k], at(k), orbit.t[k + 1], at(k + 1));
    const Incidence node[] = {{pairs::as_span(before), 1}, {pairs::as_span(after), 0}};
    largest = std::max(largest, std::abs(coordinate_variation(action, node, 0)));
  }
  return largest;
}

const char* const midpoint_pendulum =
    "(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - (((p_0 + p_1)/2)^2/2 - cos((q_0 + q_1)/2))";
const char* const midpoint_henon_heiles =
    "((u_0 + u_1)/2*(x_1 - x_0) + (v_0 + v_1)/2*(y_1 - y_0))/(t_1 - t_0)"
    " - (((u_0 + u_1)^2 + (v_0 + v_1)^2)/8 + ((x_0 + x_1)^2 + (y_0 + y_1)^2)/8"
    " + ((x_0 + x_1)/2)^2*(y_0 + y_1)/2 - ((y_0 + y_1)/2)^3/3)";

}  // namespace

TEST_CASE("the midpoint discrete Lagrangian spelt out reproduces the midpoint scheme over 1000 steps") {
  // A custom 𝕃 runs in the two-step form: rounding of a few ε in ∂A/∂z, of size 2, feeds the parasite, which keeps it:
  // after 1000 steps d is sqrt(1000) times 1e-15, 3e-14. At fixed levels that is all; with variable ones it moves h by
  // d·∇H/(hΓ/4), 3e-12 in the end, with signs that alternate but do not cancel, and the levels slide along the orbit.
  // Levels at the same t are then as near as at fixed levels; levels of the same number some hundred times further.
  constexpr double same = 1e-11;
  constexpr double same_number = 2e-9;
  for (const auto& [system, L] :
       {std::pair{systems::pendulum(), midpoint_pendulum}, std::pair{systems::henon_heiles(), midpoint_henon_heiles}}) {
    INFO(system.name);
    CHECK(distance(run(system, Midpoint{}, Levels::fixed), run(system, Custom{L}, Levels::fixed)) <= same);
    const Orbit midpoint = run(system, Midpoint{});
    const Orbit custom = run(system, Custom{L});
    CHECK(distance_along(system.hamiltonian, midpoint, custom) <= same);
    CHECK(distance(midpoint, custom) <= same_number);
  }
  // The twin: cos((q_0 + q_1)/2) off by one part in 10^9.
  const System system = systems::pendulum();
  const std::string other = std::string(midpoint_pendulum) + " + 1e-9*cos((q_0 + q_1)/2)";
  CHECK(distance(run(system, Midpoint{}), run(system, Custom{other})) > same_number);
  CHECK(distance_along(system.hamiltonian, run(system, Midpoint{}), run(system, Custom{other})) > 10.0 * same);
  CHECK(distance(run(system, Midpoint{}, Levels::fixed), run(system, Custom{other}, Levels::fixed)) > 10.0 * same);
}

TEST_CASE("with explicit time the energy balance (3.4) holds, and the discrete energy is not constant") {
  // A driven pendulum: 𝕃 has the work of a slow force. E_k = ∂A_k/∂t_k is to equal -∂A_{k-1}/∂t_k, to the tolerance of
  // the level equation, 1e-13 relative to max|E|, |H| < 2, plus rounding of the two derivatives.
  constexpr double balanced = 2e-13 + 1e-14;
  const System system = systems::pendulum();
  const Custom driven{std::string(midpoint_pendulum) + " + F*sin(w*(t_0 + t_1)/2)*(q_0 + q_1)/2",
                      {{"F", 0.01}, {"w", 0.3}}};
  const auto action = make_action(system.hamiltonian, driven);
  const Orbit orbit = run(system, driven);
  INFO(orbit.message);
  REQUIRE(orbit.steps() == steps);
  const double left = imbalance(*action, orbit);
  INFO("(3.4) leaves " << left);
  CHECK(left <= balanced);
  const auto [least, most] = std::ranges::minmax(orbit.energy);
  CHECK(most - least > 1e-3);
  CHECK_FALSE(OrbitIntegrator(system.hamiltonian, system.initial, {.lagrangian = driven, .step = 0.1, .until = 1.0})
                  .autonomous());
  // The twins: fixed levels leave the balance open, and another force does not fit the orbit.
  CHECK(imbalance(*action, run(system, driven, Levels::fixed)) > 1e6 * balanced);
  const auto other = make_action(system.hamiltonian, Custom{driven.L, {{"F", 0.010001}, {"w", 0.3}}});
  CHECK(imbalance(*other, orbit) > 10.0 * balanced);
}

TEST_CASE("without explicit time the balance is the energy law") {
  const System system = systems::pendulum();
  const auto action = make_action(system.hamiltonian, Custom{midpoint_pendulum});
  const Orbit orbit = run(system, Custom{midpoint_pendulum});
  REQUIRE(orbit.steps() == steps);
  CHECK(imbalance(*action, orbit) <= 2e-13 + 1e-14);
  CHECK(orbit.discrete_energy_deviation() <= 1e-13);
}

TEST_CASE("a custom discrete Lagrangian that is not of the motion of H is found, at whatever point and step") {
  const Hamiltonian H({"q"}, {"p"}, "p^2/2 - cos(q) + 3");
  const auto off = [&](const std::string& L, double q = 0.7, double p = 0.9, double step = 0.1) {
    return off_motion(H, Custom{L}, std::array{q, p}, 0.0, step);
  };
  const std::string h = "(t_1 - t_0)", slope = "(p_0 + p_1)/2*(q_1 - q_0)/" + h, T = "((p_0 + p_1)/2)^2/2";
  for (const std::string& L :
       {slope + " - (" + T + " - cos((q_0 + q_1)/2))", slope + " - (" + T + " - (cos(q_0) + cos(q_1))/2) - 7",
        slope + " - ((p_0^2 + p_1^2)/4 - cos((q_0 + q_1)/2))",
        "p_0*(q_1 - q_0)/" + h + " - (p_0^2/2 - cos(q_1))",  // of order 1
        "((q_1 - q_0)/" + h + ")^2/2 + cos((q_0 + q_1)/2)"}) {
    INFO(L);
    CHECK(off(L) == 0.0);
    CHECK(off(L, 0.0, 1.0) == 0.0);
    CHECK(off(L, 0.7, 0.9, 1.0) == 0.0);
    CHECK(off(L, 0.7, 0.9, -0.1) == 0.0);
  }
  // A force, a mass, and a two-form that are others, and what is meant as the action of the step.
  CHECK(off(slope + " - (" + T + " - 1.05*cos((q_0 + q_1)/2))") > 0.01);
  CHECK(off(slope + " - (1.01*" + T + " - cos((q_0 + q_1)/2))") > 0.001);
  CHECK(off("1.1*" + slope + " - (" + T + " - cos((q_0 + q_1)/2))") > 0.05);
  CHECK(off("(p_0 + p_1)/2*(q_1 - q_0) - " + h + "*(" + T + " - cos((q_0 + q_1)/2))") > 0.1);
  // Of explicit time H says nothing.
  CHECK(std::isnan(off(slope + " - (" + T + " - cos((q_0 + q_1)/2)) + t_0*q_0")));
}

TEST_CASE("a custom discrete Lagrangian with an unknown name says which") {
  const System system = systems::pendulum();
  CHECK_THROWS_WITH(make_action(system.hamiltonian, Custom{"p_0*q_2"}), Catch::Contains("q_2"));
  CHECK_THROWS_AS(make_action(system.hamiltonian, Custom{"p_0*(q_1"}), std::exception);
  CHECK_NOTHROW(make_action(system.hamiltonian, Custom{"p_0*q_1"}));
}

TEST_CASE("a discrete Lagrangian whose two levels do not determine the next one is refused as degenerate") {
  const Hamiltonian oscillator({"q"}, {"p"}, "(p^2 + q^2)/2");
  const auto with = [&](const std::string& L) {
    return integrate(oscillator, {.q = {1.0}, .p = {0.0}}, {.lagrangian = Custom{.L = L}, .step = 0.1, .until = 1.0});
  };
  // No equation has p_1: p_0 is that of the step before.
  CHECK_THROWS_WITH(with("p_0*(q_1 - q_0)/(t_1 - t_0) - (p_0^2 + q_1^2)/2"), Catch::Contains("is degenerate"));
  CHECK(with("(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - ((p_0 + p_1)^2 + (q_0 + q_1)^2)/8").status == Status::success);
}
