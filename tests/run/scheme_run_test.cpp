// What [scheme] asks for, as runs show it: a chosen first step, backward in time; and a resume that
// has nothing to do.

#include <cmath>
#include <tuple>

#include <catch2/catch.hpp>

#include <rubato/ode/integrate.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

TEST_CASE("the options of orbits and of lattices say the same of a run where nothing is told") {
  const rubato::LevelOptions orbit = level_options(rubato::IntegrationOptions{}, true, 0.0),
                             lattice = level_options(rubato::LatticeOptions{}, true, 0.0),
                             other = level_options(rubato::LatticeOptions{.tolerance = 1e-12}, true, 0.0);
  const auto reported = [](const rubato::LevelOptions& options) {
    return std::tuple(options.levels, options.on_singular, options.tolerance, options.potential.kind);
  };
  CHECK(reported(orbit) == reported(lattice));
  CHECK_FALSE(reported(orbit) == reported(other));  // the twin
}

TEST_CASE("step = auto keeps the node energy within energy_tolerance, and resumes as if never stopped") {
  const Folder folder;
  const auto settings = [](const char* until) {
    return std::vector<std::string>{"scheme.step=auto", "scheme.energy_tolerance=1e-4",
                                    std::string("scheme.until=") + until};
  };
  const Outcome whole = run_problem("pendulum", folder / "whole.h5", settings("20"));
  REQUIRE(whole.status == ExitStatus::done);
  // The orbit starts where Γ is largest, and with it H - E.
  const Statistics& statistics = whole.statistics;
  const double excess =
      std::abs(statistics.node_energy.initial - statistics.energy()) / statistics.node_energy.values.largest();
  CHECK(excess <= 1.1e-4);
  CHECK(excess >= 0.6e-4);
  const Outcome given = run_problem("pendulum", folder / "given.h5", {"scheme.step=0.1", "scheme.until=20"});
  CHECK(std::abs(given.statistics.node_energy.initial - given.statistics.energy()) > 1.1e-4);  // the twin

  const std::string stopped = folder / "stopped.h5";
  REQUIRE(run_problem("pendulum", stopped, settings("7")).status == ExitStatus::done);
  REQUIRE(resume(stopped, 20.0, {.threads = 1}).status == ExitStatus::done);
  CHECK(different_datasets(stopped, folder / "whole.h5") == Names{});

  const Outcome lattice =
      run_problem("sine-gordon", folder / "lattice.h5",
                  {"scheme.step=auto", "scheme.energy_tolerance=1e-3", "grid.x.cells=101", "scheme.until=5"});
  REQUIRE(lattice.status == ExitStatus::done);
  CHECK(lattice.statistics.node_energy.max() <= 2.2e-3 * lattice.statistics.node_energy.values.largest());
}

TEST_CASE("a negative step runs backward, on the law and off it") {
  const Folder folder;
  const Outcome back = run_problem("pendulum-rotation", folder / "back.h5", {"scheme.step=-0.05", "scheme.until=-20"});
  REQUIRE(back.status == ExitStatus::done);
  CHECK(back.statistics.t <= -20.0);
  CHECK(back.statistics.h.max < 0.0);
  CHECK(back.statistics.off_law_steps >= 8);
  CHECK(back.statistics.law_steps() >= 8);
}

TEST_CASE("a resume that has nothing to do says so") {
  const Folder folder;
  const std::string file = folder / "pendulum.h5";
  REQUIRE(run_problem("pendulum", file, {"scheme.until=5"}).warnings.empty());
  const Outcome nothing = resume(file, 3.0, {.threads = 1});
  CHECK(nothing.status == ExitStatus::done);
  REQUIRE(nothing.warnings.size() == 1);
  CHECK_THAT(nothing.warnings.front(), Contains("nothing was added") && Contains("until = 3 is not beyond"));
  CHECK(resume(file, 6.0, {.threads = 1}).warnings.empty());
}
