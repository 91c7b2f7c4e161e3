// Levels with a step potential (theory, section 9): every step meets the law, also where that of K alone has no
// solution; the extended two-form is preserved; a run comes back.

#include <catch2/catch.hpp>

#include <cmath>
#include <limits>
#include <numeric>

#include <rubato/ode/integrate.hpp>
#include <rubato/variation/level_forecast.hpp>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

using Kind = StepPotentialChoice::Kind;

struct Case {
  System system;
  double until;
  SegmentLagrangian lagrangian = Midpoint{};
  std::string name = {};
};

System with(System system, std::vector<double> q, std::vector<double> p, double step) {
  system.initial = {.q = std::move(q), .p = std::move(p)};
  system.step = step;
  return system;
}

System free_particle() {
  return {"free particle", {{"q"}, {"p"}, "p^2/2"}, {.q = {0.0}, .p = {1.0}}, 0.1};
}

IntegrationOptions options_of(const Case& run, StepPotentialChoice potential) {
  return {.lagrangian = run.lagrangian, .step = run.system.step, .until = run.until, .potential = potential};
}

/// A look-ahead of equal steps.
LookAhead look_of_equal_steps(double step, std::vector<double> eta, double energy_size) {
  LookAhead look{.order = 2, .step = step, .eta = std::move(eta), .energy_size = energy_size};
  for (std::size_t k = 0; k < look.eta.size(); ++k) {
    look.time.push_back((static_cast<double>(k) + 0.5) * step);
  }
  look.duration = static_cast<double>(look.eta.size()) * step;
  return look;
}

std::size_t flagged(const Orbit& orbit) {
  return static_cast<std::size_t>(std::accumulate(orbit.off_law.begin(), orbit.off_law.end(), 0));
}

}  // namespace

TEST_CASE("with a step potential every step meets the energy law, also where that of K alone has no solution") {
  const std::vector<Case> cases = {
      {with(systems::pendulum(), {0.0}, {2.2}, 0.05), 100.0},     // rotating: Γ changes sign twice a turn
      {with(systems::pendulum(), {0.2}, {1.97}, 0.1), 100.0},     // beside the separatrix
      {with(systems::double_well(), {0.3}, {0.9}, 0.05), 100.0},  // across both wells
      {systems::kepler(0.8), 10.0},                               // Γ touches zero
      {with(systems::pendulum(), {0.0}, {2.2}, 0.1), 60.0, Generating{.order = 4}},
      {with(systems::pendulum(), {0.0}, {1.9}, 0.1), 60.0, Generating{.order = 6}},
      {with(systems::double_well(), {0.3}, {0.9}, 0.1), 60.0, Generating{.order = 4}},
      {with(systems::pendulum(), {0.0}, {2.2}, -0.05), -60.0},  // backward
  };
  std::size_t without = 0;
  for (const Case& run : cases) {
    INFO(run.system.name << ", step " << run.system.step);
    const Orbit orbit =
        integrate(run.system.hamiltonian, run.system.initial, options_of(run, {.kind = Kind::automatic}));
    REQUIRE(orbit.status == Status::success);
    CHECK(flagged(orbit) == 0);
    // The tolerance is 1e-13 of the terms of K, of which the energies here are at least a third.
    CHECK(orbit.discrete_energy_deviation() <= 3e-13);
    without += flagged(integrate(run.system.hamiltonian, run.system.initial, options_of(run, {})));
  }
  CHECK(without > 20);  // the twin: the same orbits without a potential
}

TEST_CASE("where K is the same for every step, the potential keeps the steps equal") {
  for (const System& system : {free_particle(), systems::oscillator()}) {
    INFO(system.name);
    const Orbit orbit =
        integrate(system.hamiltonian, system.initial, options_of({system, 20.0}, {.kind = Kind::automatic}));
    REQUIRE(orbit.status == Status::success);
    CHECK(flagged(orbit) == 0);
    for (const double h : orbit.h) {
      // h is as well determined as its condition says.
      REQUIRE(std::abs(h - system.step) <= 1e-6 * system.step);
    }
  }
}

TEST_CASE("the extended two-form is preserved with a step potential, E being K + f'") {
  // dp∧dq - dE∧dt at the end of a run, as a form of (q_0, p_0, h_0), is dp_0∧dq_0: by differences.
  const System system = with(systems::pendulum(), {0.2}, {2.2}, 0.05);
  OrbitIntegrator chosen(system.hamiltonian, system.initial,
                         options_of({system, 10.0}, {.kind = Kind::given, .kappa = 2.0, .exponent = 8.0}));
  REQUIRE(chosen.step().status == Status::success);
  const StepPotential f = chosen.levels().potential();
  REQUIRE(f.active());
  constexpr int steps = 60;  // more than a turn: through places where Γ = 0
  struct End {
    double q, p, t, E, K;
  };
  const auto end_of = [&](double dq, double dp, double dh) {
    OrbitIntegrator run(system.hamiltonian, {.q = {0.2 + dq}, .p = {2.2 + dp}},
                        {.step = 0.05 + dh, .until = 1e3, .potential = {.kind = Kind::stated, .potential = f}});
    StepReport first, step;
    for (int k = 0; k < steps; ++k) {
      step = run.step();
      REQUIRE(step.status == Status::success);
      REQUIRE(!step.off_law);
      first = k == 0 ? step : first;
    }
    return End{run.q()[0], run.p()[0], run.t(), first.energy, first.energy - first.potential};
  };
  constexpr double d = 3e-4;
  const auto derivative = [&](int i) {
    const auto at = [&](double x) { return end_of(i == 0 ? x : 0.0, i == 1 ? x : 0.0, i == 2 ? x : 0.0); };
    const End far = at(2.0 * d), more = at(d), less = at(-d), back = at(-2.0 * d);
    const auto rate = [&](double End::*part) {
      return (8.0 * (more.*part - less.*part) - (far.*part - back.*part)) / (12.0 * d);
    };
    return End{rate(&End::q), rate(&End::p), rate(&End::t), rate(&End::E), rate(&End::K)};
  };
  const End by[] = {derivative(0), derivative(1), derivative(2)};
  double largest = 0.0, wrong = 0.0;
  for (const auto& [i, j] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
    const End &a = by[i], &b = by[j];
    const double before = (i == 0 && j == 1) ? -1.0 : 0.0;  // dp_0∧dq_0 of the two directions
    const double area = a.p * b.q - a.q * b.p;
    const double size = std::abs(a.p * b.q) + std::abs(a.q * b.p) + std::abs(a.E * b.t) + std::abs(a.t * b.E) + 1.0;
    largest = std::max(largest, std::abs(area - (a.E * b.t - a.t * b.E) - before) / size);
    wrong = std::max(wrong, std::abs(area - (a.K * b.t - a.t * b.K) - before) / size);
  }
  // Differences of fourth order are off by d⁴ times fifth derivatives, which the turn has made some 10⁵ times larger.
  CHECK(largest < 1e-7);
  CHECK(wrong > 50.0 * largest);  // the twin: f' left out of E
}

TEST_CASE("a run with a step potential comes back when it is turned round") {
  const System system = with(systems::pendulum(), {0.2}, {2.2}, 0.05);
  OrbitIntegrator there(system.hamiltonian, system.initial, options_of({system, 1e3}, {.kind = Kind::automatic}));
  constexpr int steps = 500;
  for (int k = 0; k < steps; ++k) {
    REQUIRE(there.step().status == Status::success);
  }
  const double last = there.levels().last_step();
  OrbitIntegrator back(
      system.hamiltonian, {.q = {there.q()[0]}, .p = {there.p()[0]}, .t = there.t()},
      {.step = -last, .until = -1.0, .potential = {.kind = Kind::stated, .potential = there.levels().potential()}});
  for (int k = 0; k < steps; ++k) {
    const StepReport step = back.step();
    REQUIRE(step.status == Status::success);
    REQUIRE(!step.off_law);
  }
  // E is met to 1e-13, and h with it to the step condition, 1e-10; the levels' own dynamics carries that on for 500
  // steps.
  CHECK(std::abs(back.t()) < 1e-5);
  CHECK(std::abs(back.q()[0] - 0.2) < 1e-5);
  CHECK(std::abs(back.p()[0] - 2.2) < 1e-5);
}

TEST_CASE("f'' is the derivative of f', which is even") {
  const StepPotential f{.strength = -0.3, .length = 0.2, .exponent = 5.0};
  for (const double h : {0.07, 0.3, -0.07, -0.3}) {
    CHECK(f.energy(h) == f.energy(-h));
    const double d = 1e-5;
    CHECK(f.slope(h) == Approx((f.energy(h + d) - f.energy(h - d)) / (2.0 * d)).epsilon(1e-6));
  }
}

TEST_CASE("levels are forecast to exist where η keeps its sign, and need a potential where it does not") {
  std::vector<double> definite, changing;
  for (int k = 0; k < 200; ++k) {
    definite.push_back(1.0 + 0.5 * std::sin(0.1 * k));
    changing.push_back(std::sin(0.1 * k + 0.5));
  }
  const StepPotential hardly{.strength = 1e-12, .length = 1.0, .exponent = 3.0};
  const LookAhead calm = look_of_equal_steps(0.1, definite, 1.0), wild = look_of_equal_steps(0.1, changing, 1.0);
  CHECK(LevelForecaster(calm)(hardly).complete);
  CHECK_FALSE(LevelForecaster(wild)(hardly).complete);
  const StepPotential chosen = choose_step_potential(wild, std::nullopt);
  const LevelForecast forecast = LevelForecaster(wild)(chosen);
  CHECK(forecast.complete);
  CHECK(forecast.shortest > 0.02);
  CHECK(forecast.longest < 0.5);
}

TEST_CASE("no potential is chosen beside which the terms of K are lost") {
  // A motion that goes to infinity during the look-ahead: η grows without bound, and no levels are forecast to last.
  std::vector<double> growing;
  for (int k = 0; k < 100; ++k) {
    growing.push_back(-std::exp(0.5 * k));
  }
  const auto largest_part = [&](double first_size) {
    LookAhead look = look_of_equal_steps(0.01, growing, 1e9);
    look.first_size = first_size;
    const StepPotential chosen = choose_step_potential(look, std::nullopt);
    return std::abs(chosen.energy(0.01));
  };
  CHECK(largest_part(0.4) <= 30.0 * 0.4 * (1.0 + 1e-12));
  CHECK(largest_part(0.0) > 1e9);  // the twin: where nobody says how large the terms are
}

TEST_CASE("what rounding makes of a large step potential is part of the bound of E_k and of the step condition") {
  // f' is some 10⁶ times H, and half a unit in the last place of it more than all that H itself is rounded by.
  const System system = with(systems::pendulum(), {0.2}, {1.1}, 0.05);
  const StepPotential f{.strength = 1e6, .length = 0.05, .exponent = 4.0};
  OrbitIntegrator run(system.hamiltonian, system.initial,
                      {.step = 0.05, .until = 1e3, .potential = {.kind = Kind::stated, .potential = f}});
  for (int k = 0; k < 100; ++k) {
    const StepReport step = run.step();
    REQUIRE(step.status == Status::success);
    REQUIRE(!step.off_law);
    const double sum = 0.5 * std::numeric_limits<double>::epsilon() * std::abs(step.energy);
    CHECK(run.levels().energy_rounding() >= sum);
    CHECK(step.condition >= sum / std::abs(step.h * step.slope));
    CHECK(std::abs(step.energy - step.target) <= 1e-13 + 2.0 * run.levels().energy_rounding());
  }
  // The twin: without the potential the bound is that of H alone.
  OrbitIntegrator plain(system.hamiltonian, system.initial, {.step = 0.05, .until = 1e3});
  REQUIRE(plain.step().status == Status::success);
  CHECK(plain.levels().energy_rounding() < 1e-13);
}

TEST_CASE("a step that no number of E's size tells from the law does not pass for one that meets it") {
  // The motion is at infinity at t = 1.506: the run ends where a step has another energy altogether.
  const Hamiltonian blow_up({"x"}, {"y"}, "y^2/2 - x^4/4");
  const Orbit orbit =
      integrate(blow_up, {.q = {1.0}, .p = {0.5}},
                {.lagrangian = Gauss{2}, .step = 0.05, .until = 5.0, .potential = {.kind = Kind::automatic}});
  CHECK(orbit.status != Status::success);
  CHECK(orbit.node_energy_deviation() > 1e4);
  CHECK(flagged(orbit) > 0);
  for (std::size_t k = 0; k < orbit.h.size(); ++k) {
    // E, its terms and f' are less than 6.5.
    CHECK(std::abs(orbit.energy[k] - orbit.energy[0]) <= (orbit.off_law[k] ? 1e3 : 1e-3) * 6.5);
  }
  // The twin: terms grow by 10¹² from a start beside an equilibrium, where E with its potential is no less.
  const Hamiltonian double_well({"x"}, {"y"}, "y^2/2 - x^2/2 + x^4/4");
  const Orbit leaving =
      integrate(double_well, {.q = {1e-6}, .p = {0.0}},
                {.lagrangian = Gauss{2}, .step = 0.1, .until = 60.0, .potential = {.kind = Kind::automatic}});
  CHECK(leaving.status == Status::success);
  CHECK(flagged(leaving) == 0);
}

TEST_CASE("a potential that is chosen is felt beside what a loose tolerance leaves of the level equation") {
  // Order 8 changes the energy by 1e-10 along a nearly circular orbit: a potential that is not felt beside that leaves
  // most steps without a length.
  const System kepler = systems::kepler(0.115);
  for (const double tolerance : {1e-13, 1e-7}) {
    const Orbit orbit = integrate(kepler.hamiltonian, kepler.initial,
                                  {.lagrangian = Splitting{"kahan-li-8"},
                                   .step = 0.2,
                                   .until = 40.0,
                                   .potential = {.kind = Kind::automatic},
                                   .tolerance = tolerance});
    INFO(tolerance << ": " << orbit.message);
    REQUIRE(orbit.status == Status::success);
    CHECK(flagged(orbit) == 0);
  }
}

TEST_CASE("what a potential costs in steps is told beside the steps of the law") {
  // Steps of the law are h_0 (1/η)^(1/3): equal ones, and 1/10 as many where η is 1/1000 for nearly all of the time.
  constexpr double h = 0.01;
  const LookAhead steady = look_of_equal_steps(h, std::vector<double>(1000, 1.0), 1.0);
  const StepPotential unfelt{.strength = 1e-20, .length = 1.0, .exponent = 4.0};
  CHECK(cost_in_steps(steady, unfelt) == Approx(1.0).epsilon(2e-3));
  std::vector<double> eta(1000, 1e-3);
  for (std::size_t k = 0; k < 100; ++k) {
    eta[k] = std::max(1e-3, std::exp(-0.1 * static_cast<double>(k)));
  }
  const LookAhead peak = look_of_equal_steps(h, eta, 1.0);
  double of_law = 0.0;
  for (const double value : eta) {
    of_law += std::cbrt(value);
  }
  // f' as strong as the peak, with all lengths near h_0, takes about as many steps as equal ones are.
  const StepPotential blunt{.strength = 100.0 * h * h, .length = h, .exponent = 8.0};
  const LevelForecast forecast = LevelForecaster(peak)(blunt);
  REQUIRE(forecast.complete);
  CHECK(forecast.longest < 1.1 * h);
  CHECK(cost_in_steps(peak, blunt) == Approx(forecast.steps / of_law).epsilon(0.02));
  CHECK(cost_in_steps(peak, blunt) > 5.0);
}
