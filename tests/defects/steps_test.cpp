// Steps that were solved, or could have been, and were reported as "not settled" or "undefined": a residual was divided
// by terms that vanish.

#include <catch2/catch.hpp>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using Catch::Matchers::Contains;
using rubato::defect_tests::defect_file;
using rubato::tests::Folder;

namespace {

/// The status of a run, and of the check of its record.
struct Ends {
  ExitStatus run, check;
  std::string message;
};

Ends run_and_check(const std::string& name, const std::vector<std::string>& settings = {}) {
  const Folder folder;
  const std::string file = folder / "record.h5";
  const Outcome outcome = run(read_problem(defect_file(name + ".toml"), settings), {.output = file, .threads = 1});
  const Outcome checked = check(file);
  return {outcome.status, checked.status, outcome.message + checked.message};
}

}  // namespace

TEST_CASE("steps in which a field hardly changes, or is 0, are solved") {
  const std::vector<std::pair<std::string, std::vector<std::string>>> runs = {
      {"p38-standing-wave-box", {"scheme.until=200"}},
      {"p44-calm-water-box", {}},
      {"user-box-driven-S", {"scheme.until=2"}},
      {"user-kgz-initial-level", {"scheme.until=0.2"}},
      {"user-kgz-initial-level", {"scheme.until=0.02", "grid.x.cells=901"}},
      {"user-kgz-initial-level", {"scheme.until=0.02", "grid.x.cells=1601"}},
      {"generating-zero-component", {}},
      {"generating-first-step", {}},
      {"constant-in-quadratic-S", {}},
      {"constant-in-quadratic-S", {"scheme.space=fourier", "scheme.composition=golden"}},
      {"generating-driven", {}},
      {"generating-driven", {"scheme.order=2", "scheme.levels=variable"}},
      {"user-si-units", {"scheme.until=365*day"}},
      {"user-si-units-solar-masses-works", {"scheme.until=365*day"}},
  };
  for (const auto& [name, settings] : runs) {
    const Ends ends = run_and_check(name, settings);
    INFO(name << ": " << ends.message);
    CHECK(ends.run == ExitStatus::done);
    CHECK(ends.check == ExitStatus::done);
  }
}

TEST_CASE("fields and components that forces move by their rounding errors alone do not stop a run") {
  std::vector<std::pair<std::string, std::vector<std::string>>> runs = {
      {"cancelling-force", {}},
      {"cancelling-force", {"scheme.order=2"}},
      {"cancelling-force-lattice", {}},
      {"cancelling-force-lattice", {"scheme.stages=2", "scheme.until=5"}},
      {"cancelling-force-lattice", {"scheme.lagrangian=fourier"}},
      {"cancelling-force-lattice", {"scheme.lagrangian=fourier", "scheme.stages=2"}},
      {"cancelling-force-lattice", {"scheme.lagrangian=fourier", "scheme.stages=2", "scheme.step=1"}},
  };
  // Corrections of those fields that come and go are no sign that the others' have shrunk: residuals were 1,000 times
  // as large as rounding makes them, which `check` finds.
  for (const char* step : {"0.5", "0.9", "1.05", "1.12", "1.2"}) {
    for (const char* stages : {"1", "2"}) {
      runs.push_back({"cancelling-force-lattice",
                      {"scheme.lagrangian=fourier", fmt::format("scheme.stages={}", stages),
                       fmt::format("scheme.step={}", step)}});
    }
  }
  for (const auto& [name, settings] : runs) {
    const Ends ends = run_and_check(name, settings);
    INFO(name << " " << Catch::StringMaker<std::vector<std::string>>::convert(settings) << ": " << ends.message);
    CHECK(ends.run == ExitStatus::done);
    CHECK(ends.check == ExitStatus::done);
  }
}

TEST_CASE("units of mass do not change the steps of the midpoint rule") {
  // 1.98847e30 kg are no power of two: rounding of the masses and of the steps, over a year of 365 steps.
  const auto end = [](const std::string& name) {
    const Folder folder;
    const std::string file = folder / "record.h5";
    const Outcome outcome = run(read_problem(defect_file(name + ".toml"),
                                             std::array<std::string, 2>{"scheme.until=365*day", "scheme.levels=fixed"}),
                                {.output = file, .threads = 1});
    REQUIRE(outcome.status == ExitStatus::done);
    return record::Reader(file).read("/states/q");
  };
  const std::vector<double> kilograms = end("user-si-units"), solar_masses = end("user-si-units-solar-masses-works");
  REQUIRE(kilograms.size() == solar_masses.size());
  for (std::size_t i = 0; i < kilograms.size(); ++i) {
    CHECK(kilograms[i] == Approx(solar_masses[i]).epsilon(1e-9).margin(1.0));
  }
}

TEST_CASE("a coefficient that depends on time is named as what a field at midpoints cannot have") {
  CHECK_THROWS_WITH(run_and_check("user-damped-caldirola-kanai"),
                    Contains("the constraint that determines w has a coefficient that depends on time") &&
                        Contains("u/sqrt(c) in place of u"));
}

TEST_CASE("an iteration that does not converge is no step") {
  // A step of ten turns of the pendulum in every cell is beyond Newton's method.
  CHECK(run_and_check("user-box-driven-S", {"scheme.step=60", "scheme.until=120", "scheme.levels=fixed"}).run ==
        ExitStatus::failed);
}
