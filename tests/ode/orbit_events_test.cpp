// Events along orbits: their times are off by what the orbit is off by, whatever the scheme.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/formula/parse.hpp>
#include <rubato/ode/integrate.hpp>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

struct Scheme {
  std::string name;
  SegmentLagrangian lagrangian;
  int order;
};

Orbit run(const System& system, const SegmentLagrangian& lagrangian, double step, double until,
          std::vector<Event> events, Levels levels = Levels::fixed) {
  const Orbit orbit = integrate(
      system.hamiltonian, system.initial,
      {.lagrangian = lagrangian, .step = step, .until = until, .levels = levels, .events = std::move(events)});
  REQUIRE(orbit.status == Status::success);
  return orbit;
}

/// The largest difference of the first times.
double difference(const std::vector<double>& a, const std::vector<double>& b) {
  REQUIRE(a.size() >= 4);
  REQUIRE(b.size() >= 4);
  double largest = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    largest = std::max(largest, std::abs(a[i] - b[i]));
  }
  return largest;
}

/// Times at which a straight line between levels passes q = 0.3.
std::vector<double> by_lines(const Orbit& orbit) {
  std::vector<double> times;
  for (std::size_t k = 0; k < orbit.steps(); ++k) {
    const double a = orbit.q[k] - 0.3, b = orbit.q[k + 1] - 0.3;
    if (a * b < 0.0) {
      times.push_back(orbit.t[k] + a / (a - b) * orbit.h[k]);
    }
  }
  return times;
}

const std::string midpoint_L = "(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - ((p_0 + p_1)^2/8 - cos((q_0 + q_1)/2))";

}  // namespace

TEST_CASE("times of events are of the order of the scheme", "[ode]") {
  const System system = systems::pendulum();
  constexpr double until = 20.0;
  const std::vector<Event> events = {{.name = "line", .crossing = "q - 0.3"}};
  const std::vector<double> exact = run(system, Gauss{8}, 0.05, until, events).events[0].t;
  // Crossings fall on other shares of a step at each h.
  constexpr double slack = 0.35;
  for (const Scheme& scheme : std::vector<Scheme>{{"midpoint", Midpoint{}, 2},
                                                  {"generating 4", Generating{.order = 4}, 4},
                                                  {"generating 6", Generating{.order = 6}, 6},
                                                  {"Euler", Generating{.order = 1, .darboux = DarbouxType::euler_a}, 1},
                                                  {"gauss 2", Gauss{2}, 4},
                                                  {"gauss 3", Gauss{3}, 6},
                                                  {"golden", Splitting{"golden"}, 2},
                                                  {"blanes-moan-4", Splitting{"blanes-moan-4"}, 4},
                                                  {"kahan-li-6", Splitting{"kahan-li-6"}, 6},
                                                  {"custom", Custom{.L = midpoint_L}, 2}}) {
    INFO(scheme.name);
    const double step = scheme.order >= 6 ? 0.4 : scheme.order == 1 ? 0.025 : 0.1;
    const double first = difference(run(system, scheme.lagrangian, step, until, events).events[0].t, exact);
    const double last = difference(run(system, scheme.lagrangian, step / 4.0, until, events).events[0].t, exact);
    CHECK(0.5 * std::log2(first / last) > scheme.order - slack);
  }
  // The twin: lines between the levels of a scheme of order 4 are of order 2.
  const double first = difference(by_lines(run(system, Gauss{2}, 0.1, until, {})), exact);
  const double last = difference(by_lines(run(system, Gauss{2}, 0.025, until, {})), exact);
  CHECK(0.5 * std::log2(first / last) < 2.5);
}

TEST_CASE("the energy on a section is as near to that of the orbit as at its levels", "[ode]") {
  // Henon and Heiles, Astron. J. 69 (1964): x = 0 passed upward.
  const System system = systems::henon_heiles();
  HamiltonianEvaluator H(system.hamiltonian);
  for (const Scheme& scheme : std::vector<Scheme>{
           {"midpoint", Midpoint{}, 2}, {"gauss", Gauss{2}, 4}, {"splitting", Splitting{"golden"}, 2}}) {
    for (const Levels levels : {Levels::fixed, Levels::variable}) {
      INFO(scheme.name);
      const Orbit orbit = run(system, scheme.lagrangian, 0.1, 500.0,
                              {{.name = "section", .crossing = "x", .direction = Direction::up}}, levels);
      const EventCrossings& section = orbit.events.front();
      CHECK(section.t.size() > 60);
      double spread = 0.0, by_line = 0.0;
      for (std::size_t i = 0; i < section.t.size(); ++i) {
        const std::vector<double> z = {section.q[2 * i], section.q[2 * i + 1], section.p[2 * i], section.p[2 * i + 1]};
        CHECK(std::abs(z[0]) < 1e-15);
        CHECK(section.direction[i] == Direction::up);
        CHECK(z[2] > 0.0);
        spread = std::max(spread, std::abs(H.value(z.data()) - orbit.node_energy.front()));
      }
      const double at_levels = orbit.node_energy_deviation();
      CHECK(spread <= 1.2 * at_levels);
      // The twin: the straight line to the section.
      for (std::size_t k = 0; k < orbit.steps(); ++k) {
        const double a = orbit.q[2 * k], b = orbit.q[2 * k + 2];
        if (a < 0.0 && b >= 0.0) {
          const std::vector<double> z_0 = systems::state_at(orbit, k), z_1 = systems::state_at(orbit, k + 1);
          std::vector<double> z(4);
          for (std::size_t i = 0; i < 4; ++i) {
            z[i] = z_0[i] + a / (a - b) * (z_1[i] - z_0[i]);
          }
          by_line = std::max(by_line, std::abs(H.value(z.data()) - orbit.node_energy.front()));
        }
      }
      CHECK(by_line > 2.0 * at_levels);
    }
  }
}

TEST_CASE("events of problems stated by L know velocities, and those of H do not need the velocity of g", "[ode]") {
  const Lagrangian pendulum({"q"}, "q_dot^2/2 + cos(q)");
  const IntegrationOptions options{.lagrangian = Gauss{2},
                                   .step = 0.1,
                                   .until = 20.0,
                                   .levels = Levels::fixed,
                                   .events = {{.name = "turn", .crossing = "q_dot"},
                                              {.name = "same", .crossing = "p_q"},
                                              {.name = "late", .crossing = "t - a", .parameters = {{"a", 7.03}}}}};
  const Orbit by_L = integrate(pendulum, {.q = {0.0}, .q_dot = {1.9}}, options);
  const Orbit by_H = integrate(Hamiltonian({"q"}, {"p"}, "p^2/2 - cos(q)"), {.q = {0.0}, .p = {1.9}},
                               {.lagrangian = Gauss{2},
                                .step = 0.1,
                                .until = 20.0,
                                .levels = Levels::fixed,
                                .events = {{.name = "turn", .crossing = "p"}}});
  REQUIRE(by_L.events[0].t.size() == by_H.events[0].t.size());
  CHECK(by_L.events[0].t == by_L.events[1].t);
  for (std::size_t i = 0; i < by_L.events[0].t.size(); ++i) {
    // Two schemes of order 4, each off by about 1e-6 at the end.
    CHECK(std::abs(by_L.events[0].t[i] - by_H.events[0].t[i]) < 1e-4);
  }
  REQUIRE(by_L.events[2].t.size() == 1);
  CHECK(std::abs(by_L.events[2].t[0] - 7.03) < 1e-14);
}

TEST_CASE("an event stops an integration, with the step in which it is", "[ode]") {
  const System system = systems::pendulum();
  const auto stopped_after = [&](std::size_t count) {
    return run(system, Midpoint{}, 0.1, 100.0, {{.name = "zero", .crossing = "q", .stop_after = count}},
               Levels::variable);
  };
  const Orbit first = stopped_after(1), third = stopped_after(3), all = stopped_after(0);
  REQUIRE(first.events[0].t.size() == 1);
  REQUIRE(third.events[0].t.size() == 3);
  CHECK(first.events[0].stopped);
  CHECK_FALSE(all.events[0].stopped);
  CHECK(all.t.back() >= 100.0);
  for (const Orbit* orbit : {&first, &third}) {
    CHECK(orbit->t[orbit->t.size() - 2] < orbit->events[0].t.back());
    CHECK(orbit->t.back() >= orbit->events[0].t.back());
    // No step is shortened.
    CHECK(std::equal(orbit->h.begin(), orbit->h.end(), all.h.begin()));
  }
  CHECK(std::equal(third.events[0].t.begin(), third.events[0].t.end(), all.events[0].t.begin()));
  CHECK_THROWS_AS(run(system, Midpoint{}, 0.1, 1.0, {{.name = "a", .crossing = "qq"}}), formula::ParseError);
}

TEST_CASE("events backward in time have their direction along the run", "[ode]") {
  const System system = systems::pendulum();
  const Orbit back = run(system, Gauss{3}, -0.1, -10.0,
                         {{.name = "up", .crossing = "q + 0.5", .direction = Direction::up},
                          {.name = "down", .crossing = "q + 0.5", .direction = Direction::down}});
  REQUIRE(!back.events[1].t.empty());
  REQUIRE(!back.events[0].t.empty());
  CHECK(back.events[1].t.front() > back.events[0].t.front());  // from q = 0 with p > 0, q falls
  CHECK(back.events[1].t.front() < 0.0);
}
