#include <cmath>
#include <random>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>

#include "bridge_runs.hpp"

// Crossing the singular set Γ = 0 (theory, section 3.1).

using namespace rubato;
using namespace rubato::tests;

namespace {

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
const Hamiltonian double_well({"q"}, {"p"}, "p^2/2 + (q^4 - q^2)/2");
const Hamiltonian kepler({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");
const Hamiltonian henon_heiles({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3");

Judged run_of(const Hamiltonian& hamiltonian, const InitialState& initial, double step, double until,
              OnSingular on_singular = OnSingular::bridge, Levels levels = Levels::variable) {
  return judge(hamiltonian, initial, {.step = step, .until = until, .levels = levels, .on_singular = on_singular});
}

InitialState kepler_pericentre(double e) {
  return {.q = {1.0 - e, 0.0}, .p = {0.0, std::sqrt((1.0 + e) / (1.0 - e))}};
}
double kepler_step(double e, double factor) {
  return factor * std::pow(1.0 - e, 1.5);
}
const double orbit = 2.0 * std::acos(-1.0);

}  // namespace

TEST_CASE("a rotating pendulum crosses the zeros of Gamma with one bridging step each and without drift") {
  // 47 crossings in 100 time units. The node energy strays by O(h²): halving the step divides it by 4 (by 3 at least,
  // at steps where the fourth order is seen).
  double coarser = 0.0;
  for (const double step : {0.1, 0.05, 0.025}) {
    const Judged run = run_of(pendulum, {.q = {0.0}, .p = {2.2}}, step, 400.0);
    INFO("step " << step);
    REQUIRE(run.status == Status::success);
    CHECK(run.crossings >= 180);
    CHECK(run.steps_per_crossing() <= 1.1);
    CHECK(run.energy_deviation <= 1e-13 + rotation_rounding(400.0));
    if (coarser != 0.0) {
      CHECK(run.node_deviation < coarser / 3.0);
    }
    coarser = run.node_deviation;
  }
  // The twins: without bridges the run stops at the first zero; with fixed levels the discrete energy is not constant.
  CHECK(run_of(pendulum, {.q = {0.0}, .p = {2.2}}, 0.05, 400.0, OnSingular::stop).status == Status::singular);
  CHECK(run_of(pendulum, {.q = {0.0}, .p = {2.2}}, 0.05, 400.0, OnSingular::bridge, Levels::fixed).energy_deviation >
        1e-6);
}

TEST_CASE("the rotating pendulum to t = 3000: eighth-means of H - E agree", "[long]") {
  for (const double step : {0.1, 0.05, 0.025}) {
    const Judged run = run_of(pendulum, {.q = {0.0}, .p = {2.2}}, step, 3000.0);
    INFO("step " << step << " drift " << run.drift() << " steps per crossing " << run.steps_per_crossing());
    REQUIRE(run.status == Status::success);
    CHECK(run.crossings >= 1410);
    CHECK(run.steps_per_crossing() <= 1.1);
    // Levels are dense where H - E is small, so that the part of a turn by which eighths (88 turns) differ moves their
    // means by 2 %; weighted by time it would be 4.3 %, for starts that differ by 1e-13.
    CHECK(run.drift() <= 0.04);
  }
}

TEST_CASE("the rotating pendulum to t = 10^6 does not drift", "[long]") {
  const Judged run = run_of(pendulum, {.q = {0.0}, .p = {2.2}}, 0.05, 1e6);
  REQUIRE(run.status == Status::success);
  CHECK(run.drift() <= 0.01);
}

TEST_CASE("every eccentricity is crossed, fine and coarse, tangency included") {
  for (const double factor : {0.02, 0.05}) {
    for (double e = 0.70; e < 0.995; e += 0.01) {
      const Judged run = run_of(kepler, kepler_pericentre(e), kepler_step(e, factor), 5.0 * orbit);
      INFO("e " << e << " factor " << factor);
      REQUIRE(run.status == Status::success);
      // |E| = 1/2, but p²/2 and 1/r are 1/(1-e) at the pericentre: rounding in H is ε times that.
      CHECK(run.energy_deviation <= 1e-14 + 8.0 * 2.2e-16 / (1.0 - e));
      if (e > 0.80 && factor == 0.02) {
        CHECK(run.steps_per_crossing() <= 1.3);
      }
    }
  }
}

TEST_CASE("Kepler orbits of high eccentricity keep their node energy over 100 revolutions", "[long]") {
  for (const double e : {0.8, 0.9, 0.95, 0.99}) {
    const Judged run = run_of(kepler, kepler_pericentre(e),
                              kepler_step(e, e < 0.94   ? 0.02
                                             : e < 0.98 ? 0.03
                                                        : 0.05),
                              100.0 * orbit);
    INFO("e " << e << ", levels per orbit " << static_cast<double>(run.steps) / 100.0 << ", eighths differ by "
              << run.spread());
    REQUIRE(run.status == Status::success);
    CHECK(run.steps <= 100 * 400);
    // No drift: the eighth-means differ by less than a hundredth of the largest excursion of H.
    CHECK(run.spread() <= 0.01 * run.node_deviation);
  }
}

TEST_CASE("a ball over the ridge of a double well crosses four times a period") {
  const Judged run = run_of(double_well, {.q = {1.02}, .p = {0.0}}, 0.05, 300.0);
  REQUIRE(run.status == Status::success);
  CHECK(run.crossings >= 100);
  CHECK(run.steps_per_crossing() <= 1.1);
  CHECK(run.energy_deviation <= 1e-15);
}

TEST_CASE("a ball over the ridge of a double well crosses 10^4 times", "[long]") {
  const Judged run = run_of(double_well, {.q = {1.02}, .p = {0.0}}, 0.05, 30000.0);
  REQUIRE(run.status == Status::success);
  CHECK(run.crossings >= 10000);
  CHECK(run.steps_per_crossing() <= 1.01);
  CHECK(run.energy_deviation <= 1e-15);
  CHECK(run.drift() <= 0.04);
}

namespace {

/// `starts` random ones at each energy, followed for 10 to 20 periods of the smallest orbits.
void check_henon_heiles(int starts, double until) {
  std::mt19937 random(7);  // any seed
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const double energy : {1.0 / 12.0, 1.0 / 6.0}) {
    for (int found = 0; found < starts;) {
      const double x = 0.5 * uniform(random);
      const double y = 0.5 * uniform(random);
      const double potential = (x * x + y * y) / 2.0 + x * x * y - y * y * y / 3.0;
      if (potential >= energy) {
        continue;
      }
      ++found;
      const double angle = std::acos(-1.0) * uniform(random);
      const double p = std::sqrt(2.0 * (energy - potential));
      const Judged run =
          run_of(henon_heiles, {.q = {x, y}, .p = {p * std::cos(angle), p * std::sin(angle)}}, 0.1, until);
      INFO("x " << x << " y " << y << " angle " << angle);
      REQUIRE(run.status == Status::success);
      CHECK(run.energy_deviation <= 1e-13 * energy);
    }
  }
}

}  // namespace

TEST_CASE("Hénon-Heiles from random starts completes with its discrete energy exact") {
  check_henon_heiles(10, 100.0);
}

TEST_CASE("Hénon-Heiles from 100 random starts at each energy", "[long]") {
  check_henon_heiles(100, 1000.0);
}

TEST_CASE("a start on or near a zero of Gamma waits, with flagged plain steps, until the law can be set") {
  // Γ = cos²q + 2E cos q + 1 vanishes at cos q = -E + √(E²-1).
  const double energy = 1.42;
  const double zero = std::acos(-energy + std::sqrt(energy * energy - 1.0));
  for (const double offset : {0.0, 0.01, -0.01, 0.1, -0.1}) {
    for (const OnSingular way : {OnSingular::bridge, OnSingular::fixed}) {
      const double q = zero + offset;
      const Judged run = run_of(pendulum, {.q = {q}, .p = {std::sqrt(2.0 * (energy + std::cos(q)))}}, 0.05, 100.0, way);
      INFO("offset " << offset);
      REQUIRE(run.status == Status::success);
      CHECK(run.energy_deviation <= 1e-13 + rotation_rounding(100.0));
      CHECK(run.node_deviation <= 2e-3);
    }
  }
}

TEST_CASE("a free particle has no energy law: every step is a plain one, and flagged") {
  const Orbit free = integrate(Hamiltonian({"q"}, {"p"}, "p^2/2"), {.q = {0.0}, .p = {1.0}},
                               {.step = 0.1, .until = 1.0, .on_singular = OnSingular::bridge});
  REQUIRE(free.status == Status::success);
  CHECK(std::ranges::all_of(free.bridged, [](unsigned char flag) { return flag == 1; }));
  // The twin: an oscillator has one.
  const Orbit bound = integrate(Hamiltonian({"q"}, {"p"}, "p^2/2 + q^2/2"), {.q = {0.0}, .p = {1.0}},
                                {.step = 0.1, .until = 1.0, .on_singular = OnSingular::bridge});
  CHECK(std::ranges::none_of(bound.bridged, [](unsigned char flag) { return flag == 1; }));
}

TEST_CASE("bridges work backward in time") {
  const Judged run = run_of(kepler, kepler_pericentre(0.9), -kepler_step(0.9, 0.02), -3.0 * orbit);
  REQUIRE(run.status == Status::success);
  CHECK(run.crossings >= 10);
  CHECK(run.steps_per_crossing() <= 1.1);
}
