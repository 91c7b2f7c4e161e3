#include <cmath>

#include <catch2/catch.hpp>

#include <rubato/pde/first_step.hpp>
#include <rubato/variation/first_step.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

TEST_CASE("a chosen first step keeps a lattice's node energy within its tolerance") {
  const double g = std::sqrt(0.75);
  const grids::Grid grid({{"x", -20, 20, 101}});
  const InitialFields breather{sampled(grid, [](double) { return 0.0; }),
                               sampled(grid, [=](double x) { return 4 * g * sech(g * x); }), std::nullopt};
  const auto deviation = [&](LatticeOptions options) {
    LatticeIntegrator lattice(sine_gordon(), grid, breather, options);
    const TrialRun run = trial_run(lattice, 10000);
    REQUIRE(run.status == Status::success);
    REQUIRE(run.whole);
    return run.deviation;
  };
  for (const char* const lagrangian : {"box", "fourier"}) {
    double last = 0.0;
    for (const double tolerance : {1e-3, 1e-4}) {
      LatticeOptions options{.lagrangian = lagrangian, .until = 12.0};
      options.step = choose_first_step(sine_gordon(), grid, breather, options, tolerance);
      // Trials end within 0.7 … 1 of the tolerance; what they did not see may add a tenth.
      CHECK(deviation(options) <= 1.1 * tolerance);
      CHECK(deviation(options) >= 0.6 * tolerance);
      if (last != 0.0) {
        CHECK(last / options.step == Approx(std::sqrt(10.0)).epsilon(0.03));  // h² is proportional to the tolerance
      }
      last = options.step;
      options.step *= 1.5;
      CHECK_FALSE(deviation(options) <= 1.1 * tolerance);  // the twin: a longer one does not
    }
  }
}
