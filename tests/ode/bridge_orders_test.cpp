#include <cmath>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>

#include "bridge_runs.hpp"

// Generating functions of order 4 and 6 across the zeros of their φ⁵ and φ⁷ (theory, section 4).

using namespace rubato;
using namespace rubato::tests;

namespace {

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
const Hamiltonian kepler({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");

Judged pendulum_run(int order, double p, double step, double until, OnSingular on_singular = OnSingular::bridge) {
  return judge(pendulum, {.q = {0.0}, .p = {p}},
               {.lagrangian = Generating{.order = order}, .step = step, .until = until, .on_singular = on_singular});
}

/// From the pericentre of an orbit of eccentricity 0.99; the first step in units of (1 - e)^(3/2).
constexpr double e = 0.99;
Judged comet_run(int order, double step, double revolutions, double tolerance = 1e-13) {
  return judge(kepler, {.q = {1.0 - e, 0.0}, .p = {0.0, std::sqrt((1.0 + e) / (1.0 - e))}},
               {.lagrangian = Generating{.order = order},
                .step = step * std::pow(1.0 - e, 1.5),
                .until = revolutions * 2.0 * std::acos(-1.0),
                .on_singular = OnSingular::bridge,
                .tolerance = tolerance});
}

}  // namespace

TEST_CASE("orders 4 and 6 run through the zeros of their step laws, librating and rotating") {
  constexpr double until = 400.0;
  for (const int order : {4, 6}) {
    // From 0 with p = √3: E = 1/2; 1.9: E = 0.8; both librate, and φ⁵ changes its sign. 2.2 and 2.6 turn over.
    for (const double p : {std::sqrt(3.0), 1.9, 2.2, 2.6}) {
      double coarser = 0.0;
      for (const double step : {0.2, 0.1}) {
        INFO("order " << order << ", p " << p << ", step " << step);
        const Judged run = pendulum_run(order, p, step, until);
        REQUIRE(run.status == Status::success);
        CHECK((order == 6 && p < 1.8 ? run.crossings == 0 : run.crossings >= 150));
        CHECK(run.steps_per_crossing() <= 1.01);
        CHECK(run.energy_deviation <= 1e-13 + rotation_rounding(until));
        // No drift: eighths hold a dozen turns and cut one, so that a twelfth of the excursions of H is expected.
        CHECK(run.spread() <= 0.25 * run.node_deviation);
        // The excursions fall as h^order, to which higher powers of h add at the coarser step.
        if (coarser != 0.0) {
          CHECK(coarser / run.node_deviation > std::pow(2.0, order - 0.7));
        }
        coarser = run.node_deviation;
      }
    }
    // The twin: where there are zeros, the run that does not bridge stops at the first.
    CHECK(pendulum_run(order, 1.9, 0.1, until, OnSingular::stop).status == Status::singular);
    CHECK(pendulum_run(order, 2.2, 0.1, until, OnSingular::stop).status == Status::singular);
  }
}

TEST_CASE("a very eccentric orbit takes its long steps also where no bridge is found") {
  // e = 0.99: φ⁷ falls by 27 powers of ten from the pericentre to the apocentre. At this step one crossing on the way
  // out is too coarse for a bridge; the law asks for some 125 levels a revolution all the same.
  constexpr double revolutions = 10.0;
  const Judged bridged = comet_run(6, 0.1, revolutions);
  REQUIRE(bridged.status == Status::success);
  CHECK(static_cast<double>(bridged.steps) / revolutions <= 200);
  // H strays farthest in the first step, at the pericentre: 5e-6, as at half of that step 64 times less.
  CHECK(bridged.node_deviation <= 1e-5);
  CHECK(bridged.energy_deviation <= 8.0 * 2.3e-16 / (1.0 - e));
  // The twin: half the step, twice the levels.
  CHECK(static_cast<double>(comet_run(6, 0.05, revolutions).steps) / revolutions > 200);
}

TEST_CASE("far out on a very eccentric orbit bridges meet a law whose H - E is less than the tolerance of the run") {
  // At order 8 H strays by 6e-11 at the pericentre, by 2.5e-14 at the apocentre, where rounding makes 4e-16 of E_k; a
  // tenth of the tolerance is 6e-14, relative to terms that are a hundred times larger at the pericentre.
  CHECK(comet_run(8, 0.05, 5.0).steps_per_crossing() <= 1.01);
  // The twin: solved to a hundred times that rounding.
  CHECK(comet_run(8, 0.05, 5.0, 1e-11).steps_per_crossing() > 1.01);
}

TEST_CASE("a very eccentric orbit keeps its energy over 200 revolutions at orders 4, 6 and 8", "[long]") {
  for (const int order : {4, 6, 8}) {
    const Judged run = comet_run(order, 0.05, 200.0);
    INFO("order " << order << ": |H - E| <= " << run.node_deviation << ", eighths differ by " << run.spread());
    REQUIRE(run.status == Status::success);
    // No drift: means over 25 revolutions differ by less than a thousandth of the largest excursion of H.
    CHECK(run.spread() <= 1e-3 * run.node_deviation);
    CHECK(run.energy_deviation <= 8.0 * 2.3e-16 / (1.0 - e));
    CHECK(run.steps_per_crossing() <= 1.01);
  }
  // The twin: at twice the step some crossings find no bridge that meets the law, and H - E differs after each.
  const Judged coarse = comet_run(6, 0.1, 200.0);
  INFO("coarse: |H - E| <= " << coarse.node_deviation << ", eighths differ by " << coarse.spread());
  CHECK(coarse.spread() > 1e-3 * coarse.node_deviation);
}
