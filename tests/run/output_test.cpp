// [output] times, interval, quantities and states: what is reported when, resumed, checked, and refused.

#include <catch2/catch.hpp>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "records.hpp"
#include "told_along.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using rubato::record::Reader;

namespace {

const Settings orbit = {"scheme.until=3", "output.interval=0.13",
                        "output.quantities.energy=(u^2+v^2)/2-1/sqrt(x^2+y^2)", "output.quantities.late=t*x"};
const Settings lattice = {"grid.x.cells=51",
                          "scheme.until=2",
                          "output.interval=0.13",
                          "output.quantities.charge=integral(w)/(2*pi)",
                          "output.quantities.bump=u^2+dx(u)*x",
                          R"(output.quantities.probe={formula="u+t", at={x=3.3}})"};

}  // namespace

TEST_CASE("states at output times do not depend on which levels are stored", "[run]") {
  const Folder folder;
  for (const char* name : {"kepler", "sine-gordon"}) {
    const Settings& settings = std::string(name) == "kepler" ? orbit : lattice;
    run_problem(name, folder / "all.h5", settings);
    run_problem(name, folder / "some.h5", with(settings, {"output.every=7"}));
    const Reader all(folder / "all.h5"), some(folder / "some.h5");
    std::size_t compared = 0;
    for (const auto& info : all.datasets()) {
      if (info.path.starts_with("/output/") && !info.is_text) {
        CHECK(all.read(info.path) == some.read(info.path));
        ++compared;
      }
    }
    CHECK(compared >= 5);
    CHECK(all.read("/output/t")[3] == 3 * 0.13);
    CHECK(sound(folder / "all.h5", true));
    CHECK(sound(folder / "some.h5", true));
    // The twin: the levels do.
    CHECK(all.rows("/states/t") != some.rows("/states/t"));
    std::filesystem::remove(folder / "all.h5");
    std::filesystem::remove(folder / "some.h5");
  }
}

TEST_CASE("runs with output times are resumed bit by bit", "[run]") {
  // Before, at and after output times and levels, and past the end of an interval.
  check_resumes("kepler", orbit, {0.011, 0.5, 1.3, 2.6, 2.99}, 3.0);
  check_resumes("kepler", with(orbit, {"scheme.levels=fixed", "scheme.step=0.13"}), {1.3, 1.56}, 2.6);
  check_resumes("sine-gordon", lattice, {0.06, 0.7, 1.3}, 1.9);
  check_resumes("sine-gordon", with(lattice, {"output.states=false"}), {0.7}, 1.9);
  check_resumes("kepler", {"output.every=3", "output.states=false", "output.quantities.r=sqrt(x^2+y^2)"}, {0.5, 1.0},
                2.0);
}

TEST_CASE("quantities are what their formulas say", "[run]") {
  const Folder folder;
  // At levels, where no times are given: an integral is the invariant of the same density.
  const std::string file = folder / "levels.h5";
  run_problem("sine-gordon", file,
              {"grid.x.cells=51", "scheme.until=2", "output.quantities.charge=integral(w/(2*pi))",
               "output.quantities.share=u/integral(1)", R"(output.quantities.node={formula="u", at={x=-20}})",
               R"(output.quantities.here={formula="x+2*t", at={x=3.3}})"});
  const Reader reader(file);
  CHECK(reader.read("/output/quantities/charge") == reader.read("/laws/topological_charge"));
  CHECK(reader.read("/output/t") == reader.read("/levels/t"));
  const std::vector<double> u = reader.read("/states/u"), share = reader.read("/output/quantities/share"),
                            node = reader.read("/output/quantities/node"), t = reader.read("/output/t"),
                            here = reader.read("/output/quantities/here");
  REQUIRE(share.size() == u.size());
  for (std::size_t i = 0; i < u.size(); ++i) {
    CHECK(std::abs(share[i] - u[i] / 40.0) <= 1e-14 * std::abs(u[i]));  // the domain's length, a sum over the nodes
  }
  for (std::size_t k = 0; k < t.size(); ++k) {
    CHECK(node[k] == u[k * 51]);
    CHECK(here[k] == 3.3 + 2.0 * t[k]);
  }
  CHECK(sound(file));
  // Between levels: the Kepler problem's energy keeps the order of the scheme, and late is t x of the same row.
  const std::string kepler = folder / "kepler.h5";
  const Outcome outcome = run_problem("kepler", kepler, with(orbit, {"scheme.step=0.005"}));
  const Reader orbits(kepler);
  const std::vector<double> q = orbits.read("/output/q"), times = orbits.read("/output/t"),
                            late = orbits.read("/output/quantities/late"),
                            energy = orbits.read("/output/quantities/energy");
  for (std::size_t i = 0; i < times.size(); ++i) {
    CHECK(late[i] == times[i] * q[2 * i]);
    // E - H of a fraction θ of a step is θ² that of the step, at most.
    CHECK(std::abs(energy[i] - energy[0]) <= 1.5 * outcome.statistics.node_energy.max());
  }
}

TEST_CASE("a point between the nodes is told by the waves of the grid", "[run][lattice]") {
  const Folder folder;
  for (const char* cells : {"grid.x.cells=32", "grid.x.cells=33"}) {
    const std::string file = folder / (std::string(cells) + ".h5");
    run_problem("sine-gordon", file,
                {cells, "scheme.lagrangian=fourier", "scheme.until=0.1", "initial.u=sin(2*pi*3*x/40)", "initial.v=0",
                 "parameters.omega=0.5", R"x(output.quantities.probe={formula="u^3+dx(u)", at={x="1+1/7"}})x"});
    const double k = 2.0 * std::acos(-1.0) * 3.0 / 40.0, x = 1.0 + 1.0 / 7.0;
    const double expected = std::pow(std::sin(k * x), 3) + k * std::cos(k * x);
    CHECK(std::abs(Reader(file).read("/output/quantities/probe").front() - expected) < 1e-13);
  }
}

TEST_CASE("without states the first and the last level are stored, and quantities in place of them", "[run]") {
  const Folder folder;
  const std::string file = folder / "none.h5";
  const Outcome outcome = run_problem("kepler", file, with(orbit, {"output.states=false"}));
  const Reader reader(file);
  CHECK(reader.read("/states/level") == std::vector<double>{0.0, static_cast<double>(outcome.statistics.steps)});
  CHECK_FALSE(reader.has("/output/q"));
  CHECK(reader.rows("/output/quantities/energy") == 24);
  CHECK(sound(file, true));
  // Without quantities the states at output times are what is left.
  run_problem("kepler", folder / "times.h5", {"scheme.until=1", "output.states=false", "output.times=[0, 0.25, 1]"});
  CHECK(Reader(folder / "times.h5").rows("/output/q") == 3);
  CHECK(sound(folder / "times.h5", true));
}

TEST_CASE("a record whose output was changed is found out", "[run]") {
  const Folder folder;
  for (const auto& [name, dataset, index] : std::vector<std::tuple<std::string, std::string, std::size_t>>{
           {"kepler", "/output/q", 9},
           {"kepler", "/output/t", 4},
           {"kepler", "/output/quantities/energy", 7},
           {"sine-gordon", "/output/u", 100},
           {"sine-gordon", "/output/quantities/charge", 3},
           {"sine-gordon", "/output/quantities/bump", 300}}) {
    INFO(dataset);
    const std::string file = folder / "a.h5";
    run_problem(name, file, name == "kepler" ? orbit : lattice);
    CHECK(sound(file));
    falsify(file, dataset, index, 1e-6);
    const Outcome outcome = check(file);
    CHECK(outcome.status == ExitStatus::contradiction);
    CHECK(std::ranges::count_if(outcome.disagreements, [&](const Disagreement& disagreement) {  // not by its checksum
            return disagreement.dataset == dataset && disagreement.row.has_value();
          }) == 1);
    std::filesystem::remove(file);
  }
}

TEST_CASE("output times and quantities are refused with a remedy", "[run]") {
  const auto kepler = [](const char* setting) { return refusal("kepler", {"scheme.until=2", setting}); };
  const auto wave = [](const char* setting) { return refusal("sine-gordon", {"grid.x.cells=51", setting}); };
  CHECK_THAT(kepler("output.times=[]"), Catch::Contains("there is no time in it"));
  CHECK_THAT(kepler("output.times=1"), Catch::Contains("expected an array"));
  CHECK_THAT(kepler("output.times=[0.5, 0.5]"), Catch::Contains("each once"));
  CHECK_THAT(kepler("output.times=[1, 0.5]"), Catch::Contains("direction of the run"));
  CHECK_THAT(kepler("output.times=[1, 3]"), Catch::Contains("outside the run"));
  CHECK_THAT(kepler("output.times=[-1]"), Catch::Contains("outside the run"));
  CHECK_THAT(kepler("output.times=[nan]"), Catch::Contains("not a finite number"));
  CHECK_THAT(kepler("output.times=[true]"), Catch::Contains("expected a number or a formula"));
  CHECK_THAT(kepler("output.interval=0"), Catch::Contains("has to be positive"));
  CHECK_THAT(kepler("output.interval=-0.1"), Catch::Contains("has to be positive"));
  CHECK_THAT(kepler("output.interval=1e-300"), Catch::Contains("lost in rounding"));
  CHECK_THAT(kepler("output.interval=1e-9"), Catch::Contains("a million in each"));
  CHECK_THAT(refusal("kepler", {"output.interval=0.1", "output.times=[0.1]"}), Catch::Contains("leave one of them"));
  CHECK_THAT(kepler("output.states=1"), Catch::Contains("true or false"));
  CHECK_THAT(kepler("output.quantities=1"), Catch::Contains("a table, [output.quantities]"));
  CHECK_THAT(kepler("output.quantities.t=x"), Catch::Contains("records have something else"));
  CHECK_THAT(kepler("output.quantities.r=xx"), Catch::Contains("unknown name"));
  CHECK_THAT(kepler("output.quantities.r=integral(x)"), Catch::Contains("of a lattice only"));
  CHECK_THAT(kepler(R"(output.quantities.r={formula="x", at={x=1}})"), Catch::Contains("leave it out"));
  CHECK_THAT(kepler(R"(output.quantities.r={at={x=1}})"), Catch::Contains("needs formula"));
  CHECK_THAT(kepler(R"(output.quantities.r={formula="x", where=1})"), Catch::Contains("known here: formula, at"));
  CHECK_THAT(wave("output.quantities.r=integral(integral(u))"), Catch::Contains("there is no integral"));
  CHECK_THAT(wave("output.quantities.r=integral(u, v)"), Catch::Contains("takes one formula"));
  CHECK_THAT(wave(R"(output.quantities.r={formula="u", at={y=1}})"), Catch::Contains("the grid has x"));
  CHECK_THAT(wave(R"(output.quantities.r={formula="u", at={x=21}})"), Catch::Contains("outside the grid"));
  CHECK_THAT(wave(R"(output.quantities.r={formula="u", at={}})"), Catch::Contains("x is missing"));
  CHECK_THAT(wave(R"(output.quantities.r={formula="u", at=3})"), Catch::Contains("{ x = 3.5 }"));
  CHECK_THAT(wave("output.quantities.x=u"), Catch::Contains("records have something else"));
  CHECK_THAT(refusal("kdv", {"grid.x.cells=51", "output.quantities.r=w"}), Catch::Contains("middle of steps"));
  CHECK_THAT(refusal("kdv", {"grid.x.cells=51", "output.quantities.r=integral(dx(w))"}),
             Catch::Contains("middle of steps"));
}
