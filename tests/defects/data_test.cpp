// Data that contradict a constraint or do not repeat with the period, and an equation that is ill-posed.

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/run/run.hpp>

#include "defects.hpp"

using namespace rubato;
using namespace rubato::defect_tests;
using Catch::Contains;

namespace {

struct Reported {
  Outcome outcome;
  std::vector<std::string> at_start;
};

Reported run_defect(const std::string& name, std::vector<std::string> settings) {
  const auto record = std::filesystem::temp_directory_path() / ("rubato-defect-" + name + ".h5");
  Reported reported;
  const Problem problem = read_problem(defect_file(name + ".toml"), settings);
  reported.outcome =
      run(problem,
          {.output = record.string(), .overwrite = true, .threads = 1, .caution = [&](const std::string& sentence) {
             reported.at_start.push_back(sentence);
           }});
  std::filesystem::remove(record);
  return reported;
}

}  // namespace

TEST_CASE("w = 3x against w = u_x is refused at its place, a jump at the seam or not") {
  CHECK_THROWS_WITH(run_defect("wrong-w", {}),
                    Contains("wrong-w.toml:11:4: the initial w contradicts its constraint") && Contains("at x = ") &&
                        Contains("leave w out, or correct it"));
  CHECK_THROWS_AS(run_defect("wrong-w", {}), ProblemError);
  CHECK_THROWS_AS(run_defect("wrong-w", {"scheme.lagrangian=fourier"}), ProblemError);
  CHECK_THROWS_AS(run_defect("wrong-w", {"initial.w=0.003*x"}), ProblemError);
  // The twin: what is right is taken.
  const Reported right = run_defect("wrong-w", {"initial.w=-2*x*exp(-x^2)"});
  CHECK(right.outcome.status == ExitStatus::done);
  CHECK(right.outcome.warnings.empty());
}

TEST_CASE("data that are not periodic are told with the size of their jump, at the start and once") {
  const Reported reported = run_defect("not-periodic", {});
  CHECK(reported.outcome.status == ExitStatus::lost);
  REQUIRE(reported.at_start.size() == 1);
  CHECK_THAT(reported.at_start.front(), Contains("the initial u is not periodic in x") &&
                                            Contains("x = 1 is x = 0 again") && Contains("it jumps by -1 "));
  CHECK(std::ranges::count(reported.outcome.warnings, reported.at_start.front()) == 1);
  CHECK(run_defect("not-periodic", {"initial.u=sin(2*pi*x)"}).at_start.empty());
}

TEST_CASE("an equation whose short waves grow without bound is called ill-posed at the start") {
  const Reported reported = run_defect("ill-posed", {"scheme.until=0.1", "grid.x.cells=129"});
  REQUIRE(reported.at_start.size() == 1);
  CHECK_THAT(reported.at_start.front(), Contains("this equation is ill-posed") && Contains("grow as exp("));
  CHECK(run_defect("ill-posed",
                   {"scheme.until=0.1", "grid.x.cells=129", "multisymplectic.S=(v^2 - w^2)/2 + (u^2 - 1)^2/4"})
            .at_start.empty());
}
