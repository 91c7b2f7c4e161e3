// The state between two levels: of the order of its scheme, by slope, and joined to the levels without a jump.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include <rubato/ode/orbit_between.hpp>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

using State = std::vector<double>;

/// z(t) of an orbit with fixed levels, between them by `between`.
using Rule = std::function<State(const State& z_k, const State& z_next, double h, double fraction)>;

struct Scheme {
  std::string name;
  SegmentLagrangian lagrangian;
  int order;
  bool starting_pair = false;
};

Orbit run(const System& system, const Scheme& scheme, double step, double until) {
  IntegrationOptions options{.lagrangian = scheme.lagrangian, .step = step, .until = until, .levels = Levels::fixed};
  if (scheme.starting_pair) {
    // A pair on the exact orbit: there the parasite is of the order of the scheme's own error.
    const Orbit exact = integrate(system.hamiltonian, system.initial,
                                  {.lagrangian = Gauss{8}, .step = step / 2.0, .until = step, .levels = Levels::fixed});
    options.next = InitialState{.q = {exact.q_at(2).begin(), exact.q_at(2).end()},
                                .p = {exact.p_at(2).begin(), exact.p_at(2).end()},
                                .t = step};
  }
  const Orbit orbit = integrate(system.hamiltonian, system.initial, options);
  REQUIRE(orbit.status == Status::success);
  return orbit;
}

Rule rule_of(const System& system, const Scheme& scheme) {
  auto between = std::make_shared<OrbitBetween>(system.hamiltonian, scheme.lagrangian, scheme.starting_pair,
                                                systems::joined(system.initial));
  return [between](const State& z_k, const State& z_next, double h, double fraction) {
    State z(z_k.size());
    REQUIRE(between->at(z_k, z_next, h, fraction, z) == Status::success);
    return z;
  };
}

/// At t, in the step that leads there.
State at(const Orbit& orbit, double step, double t, const Rule& rule) {
  const auto k = std::min(static_cast<std::size_t>(t / step), orbit.steps() - 1);
  return rule(systems::state_at(orbit, k), systems::state_at(orbit, k + 1), step, (t - orbit.t[k]) / step);
}

const std::vector<double> times = {0.2137, 0.7351, 1.0913, 1.6789, 1.9583};

/// Least slope of the error at `times` over halved steps.
double slope(const System& system, const Scheme& scheme, double step, const Rule& rule) {
  constexpr double until = 2.0;
  const Scheme best{"reference", Gauss{8}, 16};
  constexpr double fine = 0.05;
  const Orbit exact = run(system, best, fine, until);
  const Rule exact_rule = rule_of(system, best);
  std::vector<double> errors;
  for (const double h : {step, step / 2.0, step / 4.0}) {
    const Orbit orbit = run(system, scheme, h, until);
    double largest = 0.0;
    for (const double t : times) {
      largest = std::max(largest, systems::distance(at(orbit, h, t, rule), at(exact, fine, t, exact_rule)));
    }
    errors.push_back(largest);
  }
  return 0.5 * std::log2(errors.front() / errors.back());
}

const std::string midpoint_L = "(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - ((p_0 + p_1)^2/8 - cos((q_0 + q_1)/2))";

}  // namespace

TEST_CASE("states between levels are of the order of the scheme", "[ode]") {
  const System system = systems::pendulum();
  // Times fall on other shares of a step at each h: errors vary by that, and slopes over two halvings by a third.
  constexpr double slack = 0.35;
  for (const Scheme& scheme : std::vector<Scheme>{
           {"midpoint", Midpoint{}, 2},
           {"midpoint from a pair", Midpoint{}, 2, true},
           {"generating 4", Generating{.order = 4}, 4},
           {"generating 4 from a pair", Generating{.order = 4}, 4, true},
           {"generating 6", Generating{.order = 6}, 6},
           {"Euler", Generating{.order = 1, .darboux = DarbouxType::euler_a}, 1},
           {"gauss 1", Gauss{1}, 2},
           {"gauss 2", Gauss{2}, 4},
           {"gauss 3", Gauss{3}, 6},
           {"golden", Splitting{"golden"}, 2},
           {"verlet", Splitting{"verlet"}, 2},
           {"blanes-moan-4", Splitting{"blanes-moan-4"}, 4},
           {"kahan-li-6", Splitting{"kahan-li-6"}, 6},
           {"custom", Custom{.L = midpoint_L}, 2},
       }) {
    INFO(scheme.name);
    const double step = scheme.order >= 6 ? 0.25 : 0.1;
    CHECK(slope(system, scheme, step, rule_of(system, scheme)) > scheme.order - slack);
  }
}

TEST_CASE("straight lines between levels are not of the order of the scheme", "[ode]") {
  const System system = systems::pendulum();
  const Rule line = [](const State& z_k, const State& z_next, double, double fraction) {
    State z(z_k.size());
    for (std::size_t i = 0; i < z.size(); ++i) {
      z[i] = z_k[i] + fraction * (z_next[i] - z_k[i]);
    }
    return z;
  };
  CHECK(slope(system, {"gauss 2", Gauss{2}, 4}, 0.1, line) < 2.5);
  CHECK(slope(system, {"gauss 3", Gauss{3}, 6}, 0.25, line) < 2.5);
}

TEST_CASE("states between levels join the levels", "[ode]") {
  const System system = systems::pendulum();
  for (const Scheme& scheme : std::vector<Scheme>{{"midpoint", Midpoint{}, 2},
                                                  {"midpoint from a pair", Midpoint{}, 2, true},
                                                  {"generating", Generating{.order = 4}, 4},
                                                  {"gauss", Gauss{3}, 6},
                                                  {"splitting", Splitting{}, 2},
                                                  {"custom", Custom{.L = midpoint_L}, 2}}) {
    INFO(scheme.name);
    constexpr double h = 0.1;
    const Orbit orbit = run(system, scheme, h, 1.0);
    const Rule rule = rule_of(system, scheme);
    for (std::size_t k : {0, 4, 9}) {
      const State z_k = systems::state_at(orbit, k), z_next = systems::state_at(orbit, k + 1);
      CHECK(rule(z_k, z_next, h, 0.0) == z_k);
      CHECK(rule(z_k, z_next, h, 1.0) == z_next);
      // Rates are at most 2; the steps themselves are solved to rounding.
      constexpr double near = 1e-9;
      CHECK(systems::distance(rule(z_k, z_next, h, near), z_k) < 2.0 * near * h);
      CHECK(systems::distance(rule(z_k, z_next, h, 1.0 - near), z_next) < 2.0 * near * h);
    }
  }
}

TEST_CASE("a state between levels that cannot be solved is not a number, and is said so", "[ode]") {
  const Hamiltonian falling({"q"}, {"p"}, "p^2/2 + log(q)");
  OrbitBetween between(falling, Midpoint{}, false, State{1.0, 0.0});
  State z(2);
  CHECK(between.at(State{1e-3, -1.0}, State{1e-3, -1.0}, 5.0, 0.5, z) != Status::success);
  CHECK(std::isnan(z[0]));
}
