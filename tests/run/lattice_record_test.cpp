// What `check` makes of the record of a lattice alone, next to what the run reported.

#include <catch2/catch.hpp>

#include <algorithm>
#include <fstream>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/browse.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/record/run_shape.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;

namespace {

/// A few steps of a catalogue problem on a small grid.
std::vector<std::string> shortened(const std::string& name, const std::string& lagrangian) {
  const Problem problem = read_problem(name);
  const auto& axes = problem.multisymplectic()->axes;
  std::vector<std::string> settings = {
      "scheme.lagrangian=" + lagrangian, "output.every=1",
      fmt::format("scheme.until={:.17g}", problem.start() + 6.0 * problem.scheme.step.value())};
  if (lagrangian == "euler-box") {
    settings.emplace_back("scheme.levels=fixed");
  }
  const int cells[] = {101, 25, 5};
  for (const GridAxis& axis : axes) {
    settings.push_back(fmt::format("grid.{}.cells={}", axis.name, cells[axes.size() - 1]));
  }
  return settings;
}

double step_equation(const Outcome& checked) {
  const auto& residuals = checked.statistics.residuals;
  const auto found = std::ranges::find(residuals, "step_equation", &Named<rubato::Spread>::name);
  REQUIRE(found != residuals.end());
  return found->value.largest();
}

const rubato::Spread& residual(const Outcome& outcome, const std::string& name) {
  const auto& residuals = outcome.statistics.residuals;
  const auto found = std::ranges::find(residuals, name, &Named<rubato::Spread>::name);
  REQUIRE(found != residuals.end());
  return found->value;
}

/// Every figure that the run reported is the same number; and a stored value, whichever field it is of, that is altered
/// by 1e-6 is seen.
void check_reproduces(const std::string& name, const std::string& lagrangian, const std::string& file,
                      const std::vector<std::string>& more = {}) {
  INFO(name << ", " << lagrangian);
  const bool tangents = lagrangian != "fourier" && lagrangian != "splitting";
  std::vector<std::string> settings = shortened(name, lagrangian);
  settings.insert(settings.end(), more.begin(), more.end());
  const Outcome ran = run_problem(name, file, settings, tangents);
  REQUIRE(ran.status == ExitStatus::done);
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  for (const Disagreement& disagreement : checked.disagreements) {
    UNSCOPED_INFO(to_string(disagreement));
  }
  CHECK(checked.disagreements.empty());
  CHECK(differences(ran, checked) == Names{});
  CHECK(checked.warnings.empty());
  CHECK(ran.statistics.residuals.size() + 1 == checked.statistics.residuals.size());
  const double sound = step_equation(checked);

  const Problem problem = read_problem(name);
  for (const std::string& field : problem.multisymplectic()->fields) {
    INFO("altered " << field);
    const bool at_midpoints = !rubato::record::Reader(file).has("/states/" + field);
    const std::string path = (at_midpoints ? "/states/midpoints/" : "/states/") + field;
    const std::size_t nodes = rubato::record::Reader(file).info(path).row_size();
    falsify(file, path, 3 * nodes + nodes / 2, 1e-6);
    const Outcome altered = check(file);
    CHECK(altered.status == ExitStatus::contradiction);
    CHECK(step_equation(altered) > 100.0 * sound);
    falsify(file, path, 3 * nodes + nodes / 2, -1e-6);
  }
}

}  // namespace

TEST_CASE("check reproduces the box run of every periodic lattice of the catalogue", "[run][lattice]") {
  const Folder folder;
  int lattices = 0;
  for (const CatalogueItem& item : list_catalogue()) {
    if (item.is_lattice &&
        std::ranges::none_of(read_problem(item.name).multisymplectic()->axes, &GridAxis::has_walls)) {
      check_reproduces(item.name, "box", folder / "lattice.h5");
      ++lattices;
    }
  }
  CHECK(lattices >= 11);  // the rows of the table of equations
}

TEST_CASE("check reproduces Fourier runs", "[run][lattice]") {
  const Folder folder;
  for (const char* name :
       {"sine-gordon", "nls", "kdv", "boussinesq", "sine-gordon-2d", "zakharov-kuznetsov", "maxwell"}) {
    check_reproduces(name, "fourier", folder / "lattice.h5");
  }
}

TEST_CASE("check reproduces runs with Gauss collocation", "[run][lattice]") {
  const Folder folder;
  for (const char* name : {"sine-gordon", "kdv", "boussinesq"}) {
    check_reproduces(name, "fourier", folder / "lattice.h5", {"scheme.stages=3"});
    check_reproduces(name, "box", folder / "lattice.h5", {"scheme.stages=2"});
    check_reproduces(name, "box", folder / "lattice.h5", {"scheme.space_stages=3", "grid.x.cells=201"});
  }
}

TEST_CASE("check reproduces splittings on lattices", "[run][lattice]") {
  const Folder folder;
  for (const char* name : {"sine-gordon", "nls"}) {
    check_reproduces(name, "splitting", folder / "lattice.h5", {"scheme.composition=blanes-moan-4"});
    check_reproduces(name, "splitting", folder / "lattice.h5", {"scheme.space=differences"});
  }
  CHECK_THROWS_WITH(run_problem("kdv", folder / "kdv.h5", {"scheme.lagrangian=splitting"}),
                    Catch::Contains("--set scheme.lagrangian") && Catch::Contains("splitting needs"));
}

TEST_CASE("check reproduces an euler-box run whose constraint is not linear: its field is at levels",
          "[run][lattice]") {
  const Folder folder;
  const std::string problem = folder / "boussinesq.toml";
  std::ofstream(problem) << R"toml([multisymplectic]
equation = "boussinesq"
[grid]
x = { from = -20, to = 20, cells = 81 }
[initial]
phi = "0.3*sin(pi*x/20)"
v = "0.1*cos(pi*x/20)"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.04
until = 2
)toml";
  check_reproduces(problem, "euler-box", folder / "lattice.h5");
  CHECK(rubato::record::Reader(folder / "lattice.h5").has("/states/p"));
}

TEST_CASE("check reproduces leapfrog runs", "[run][lattice]") {
  const Folder folder;
  for (const char* name : {"sine-gordon", "klein-gordon", "sine-gordon-2d"}) {
    check_reproduces(name, "leapfrog", folder / "lattice.h5");
  }
  CHECK_THROWS_WITH(run_problem("nls", folder / "nls.h5", {"scheme.lagrangian=leapfrog"}),
                    Catch::Contains("--set scheme.lagrangian") && Catch::Contains("leapfrog is for equations of wave"));
}

TEST_CASE("check reproduces euler-box runs", "[run][lattice]") {
  const Folder folder;
  for (const char* name : {"sine-gordon", "klein-gordon", "nls", "sine-gordon-2d", "maxwell"}) {
    check_reproduces(name, "euler-box", folder / "lattice.h5");
  }
  CHECK_THROWS_WITH(run_problem("sine-gordon", folder / "lattice.h5", {"scheme.lagrangian=euler-box"}),
                    Catch::Contains("levels = \"fixed\" only"));
  CHECK_THROWS_WITH(run_problem("kdv", folder / "lattice.h5", {"scheme.lagrangian=euler-box", "scheme.levels=fixed"}),
                    Catch::Contains("no equation gives phi, w"));
}

TEST_CASE("check counts the steps of a run that are off the law and finds their energies", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "kinks.h5";
  const Outcome ran = run_problem("sine-gordon-kinks", file, {"scheme.until=30", "scheme.on_singular=plain"});
  REQUIRE(ran.statistics.off_law_steps >= 2);
  CHECK(differences(ran, check(file)) == Names{});
}

TEST_CASE("check with every = 7 finds the residuals of the stored steps", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "sparse.h5";
  for (const char* name : {"sine-gordon", "bbm"}) {
    INFO(name);
    const Outcome ran = run_problem(name, file, {"grid.x.cells=101", "scheme.until=3", "output.every=7"});
    const Outcome checked = check(file);
    CHECK(checked.status == ExitStatus::done);
    CHECK(differences(ran, checked) == Names{});
    CHECK(checked.warnings.size() == 1);
    {
      const rubato::record::Reader reader(file);
      const std::vector<double> level = reader.read("/states/level");
      REQUIRE(level.size() > 3);
      CHECK(level.back() == static_cast<double>(ran.statistics.steps));  // the last state is stored whatever its number
    }
    const double sound = step_equation(checked);
    falsify(file, "/states/previous/u", 2 * 101 + 50, 1e-6);
    CHECK(step_equation(check(file)) > 100.0 * sound);
  }
}

TEST_CASE("check reads a record that ended between stored levels", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "ended.h5";
  const Outcome ran = run_problem("sine-gordon", file, {"grid.x.cells=101", "output.every=7", "scheme.max_steps=10"});
  REQUIRE(ran.status == ExitStatus::failed);
  const Outcome checked = check(file);
  CHECK_FALSE(checked.complete);
  CHECK(checked.statistics.steps == 10);
  CHECK(residual(checked, "energy").count() == 10.0 * 101.0);
  CHECK(checked.statistics.t == ran.statistics.t);
  CHECK(checked.statistics.errors.front().value.largest() == ran.statistics.errors.front().value.largest());
}

TEST_CASE("check knows that a run rounds at the integral of what S has of a constant", "[run][lattice]") {
  // S with 1 - cos u over a length of 4e6, where that is 25 ppm of 1: a run sums -cos u and adds the length.
  const Folder folder;
  const std::string file = folder / "long.h5";
  for (const char* lagrangian : {"box", "leapfrog", "splitting", "fourier"}) {
    INFO(lagrangian);
    run_problem(
        "sine-gordon", file,
        {"grid.x.from=-2e6", "grid.x.to=2e6", "grid.x.cells=63", "initial.u=0.01*sin(2*pi*x/4e6)", "initial.v=0",
         "scheme.levels=fixed", "scheme.step=0.1", "scheme.until=0.5", std::string("scheme.lagrangian=") + lagrangian});
    const Outcome checked = check(file);
    for (const Disagreement& disagreement : checked.disagreements) {
      UNSCOPED_INFO(to_string(disagreement));
    }
    CHECK(checked.disagreements.empty());
    // Four roundings of 4e6 are 1.8e-9: ten times as much is seen.
    falsify(file, "/levels/node_energy", 3, 2e-8);
    CHECK(check(file).status == ExitStatus::contradiction);
  }
}

TEST_CASE("check says of a damaged lattice record what is wrong", "[run][lattice]") {
  const Folder folder;
  const std::string file = folder / "damaged.h5";
  const std::vector<std::string> settings = {"grid.x.cells=51", "scheme.until=1"};
  const auto run_again = [&] { run_problem("sine-gordon", file, settings); };
  run_again();
  CHECK(check(file).status == ExitStatus::done);
  const auto names = [&](const std::string& path) {
    const Outcome checked = check(file);
    const bool named =
        std::ranges::find(checked.disagreements, path, &Disagreement::dataset) != checked.disagreements.end();
    return checked.status == ExitStatus::contradiction && named;
  };
  falsify(file, "/levels/t", 3, 1e-6);
  CHECK(names("/levels/t"));
  run_again();
  falsify(file, "/levels/h", 3, 1e-6);
  CHECK(names("/levels/h"));
  run_again();
  falsify(file, "/states/u", 60, 1.0 / 0.0);
  CHECK(names("/states/u"));
  run_again();
  falsify(file, "/states/level", 2, 5.0);
  CHECK_THROWS_WITH(names("/states/level"), Catch::Contains("'/states/level' goes from level"));  // no record at all
}
