#include <cmath>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>

#include "bridge_runs.hpp"

// Generating functions of order 4 and 6 across the zeros of their φ⁵ and φ⁷ (theory, section 4).

using namespace rubato;
using namespace rubato::tests;

namespace {

const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");

Judged pendulum_run(int order, double p, double step, double until, OnSingular on_singular = OnSingular::bridge) {
  return judge(pendulum, {.q = {0.0}, .p = {p}},
               {.lagrangian = Generating{.order = order}, .step = step, .until = until, .on_singular = on_singular});
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
