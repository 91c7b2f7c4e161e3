// What a run shows, and what `check` makes of its record alone; and a run that stops at a singular point.

#include <catch2/catch.hpp>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/limits.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;

TEST_CASE("check reproduces the table of a run from the record alone") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  for (const char* name :
       {"pendulum", "kepler", "henon-heiles", "double-well", "non-separable", "harmonic-oscillator"}) {
    for (const char* levels : {"variable", "fixed"}) {
      INFO(name << ", " << levels);
      const Outcome ran = run_problem(name, file, {std::string("scheme.levels=") + levels});
      REQUIRE(ran.status == ExitStatus::done);
      const Outcome checked = check(file);
      CHECK(differences(ran, checked) == Names{});
      CHECK(checked.status == ExitStatus::done);
      CHECK(checked.disagreements.empty());
      // What only check shows: the states satisfy the equation of the step, to rounding of ∂A/∂z, whose terms are
      // below 4.
      REQUIRE(checked.statistics.residuals.size() == 1);
      CHECK(checked.statistics.residuals[0].value.largest() <= 1e-13);
    }
  }
}

TEST_CASE("check with every = 7 covers the stored steps") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  const Outcome ran = run_problem("pendulum", file, {"output.every=7"});
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  CHECK(differences(ran, checked) == Names{});
  REQUIRE(checked.warnings.size() == 1);
  CHECK_THAT(checked.warnings.front(), Catch::Contains("keeps every 7-th state"));
}

TEST_CASE("check sees a record that was altered") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  const Outcome ran = run_problem("pendulum", file);
  falsify(file, "/states/p", 100, 1e-9);
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::contradiction);
  CHECK(checked.statistics.relative_energy_deviation() > 1e-11);  // that of the states
  CHECK(checked.statistics.residuals.at(0).value.largest() > 1e-11);
  CHECK_FALSE(differences(ran, checked) == Names{});
  // Of an energy that was altered, too, the states show what it was.
  run_problem("pendulum", file);
  falsify(file, "/levels/energy", 100, 1.0);
  const Outcome mended = check(file);
  CHECK(mended.status == ExitStatus::contradiction);
  CHECK(mended.statistics.energy_deviation() <= 1e-13);
}

TEST_CASE("check allows for the rounding of terms that cancel in the energy, and for no more") {
  const Folder folder;
  const std::string file = folder / "orbit.h5";
  struct Case {
    std::string section, formula;
    double terms;  // the magnitudes of the terms of the energy
  };
  const std::string by_H = "[hamiltonian]\np = [\"p\"]\nH", by_L = "[lagrangian]\nL";
  for (const Case& example :
       {Case{by_H, "p^2/(2*2*1.5^2) + 2*9.81*1.5*(1-cos(q))", 60.0}, Case{by_H, "p^2/2 + cosh(q) - 1", 2.0},
        Case{by_H, "sqrt(10^2+p^2) - 10 + q^2/2", 20.0}, Case{by_H, "p^2/2 + exp(q) - q - 1", 2.0},
        Case{by_L, "2*1.5^2*q_dot^2/2 - 2*9.81*1.5*(1-cos(q))", 60.0}}) {
    INFO(example.formula);
    const Problem problem = parse_problem(
        fmt::format("{} = \"{}\"\nq = [\"q\"]\n[initial]\nq = 0.05\n{} = 0\n[scheme]\nstep = 0.01\nuntil = 5\n",
                    example.section, example.formula, example.section == by_H ? "p" : "q_dot"),
        "cancelling.toml", {});
    REQUIRE(run(problem, {.output = file, .overwrite = true}).status == ExitStatus::done);
    const Outcome checked = check(file);
    CHECK(checked.status == ExitStatus::done);
    CHECK(checked.disagreements.empty());
    // No more than a few of the operations round as much as the terms.
    falsify(file, "/levels/node_energy", 100, 16.0 * epsilon * example.terms);
    const Outcome altered = check(file);
    CHECK(altered.status == ExitStatus::contradiction);
    CHECK(std::ranges::count(altered.disagreements, "/levels/node_energy", &Disagreement::dataset) == 1);
  }
}

TEST_CASE("Kepler with e = 0.85 stops at the singular set, and says where; its record is whole") {
  // Γ changes its sign on the orbit for e² > 5/8 (theory, section 3).
  const Folder folder;
  const std::string file = folder / "singular.h5";
  const Outcome stopped = run_problem("kepler", file, {"parameters.e=0.85", "scheme.on_singular=stop"});
  CHECK(stopped.status == ExitStatus::singular);
  CHECK_FALSE(stopped.complete);
  CHECK(stopped.statistics.steps > 10);
  const rubato::record::Reader reader(file);
  const std::vector<double> t = reader.read("/levels/t");
  const std::vector<double> gamma = reader.read("/levels/gamma");
  const std::vector<double> h = reader.read("/levels/h");
  CHECK_THAT(stopped.message, Catch::Contains(fmt::format("t = {:.10g}", t.back())));
  CHECK_THAT(stopped.message, Catch::Contains(fmt::format("Gamma = {:.4g}", gamma.back())));
  CHECK_THAT(stopped.message, Catch::Contains(fmt::format("h = {:.4g}", h.back())));
  CHECK_THAT(stopped.message, Catch::Contains("use step_potential = \"auto\", on_singular = \"plain\""));
  CHECK(t.size() == stopped.statistics.steps + 1);
  CHECK(h.size() == stopped.statistics.steps);
  CHECK(reader.rows("/states/q") == t.size());
  CHECK(reader.rows("/states/p") == t.size());
  CHECK(t.back() == stopped.statistics.t);
  CHECK_FALSE(reader.header().finished);
  CHECK(differences(stopped, check(file)) == Names{});
  // The twins: e = 0.6 does not stop, and a record one step longer is distinguished.
  const Outcome whole = run_problem("kepler", folder / "whole.h5", {"scheme.on_singular=stop"});
  CHECK(whole.status == ExitStatus::done);
  CHECK(whole.message.empty());
  CHECK_FALSE(differences(stopped, whole) == Names{});
}

TEST_CASE("a stop with the forward Lagrangian says that no length keeps the energy") {
  // Its second step already finds none.
  const Folder folder;
  const Outcome stopped = run_problem("pendulum", folder / "forward.h5",
                                      {"scheme.lagrangian=forward", "scheme.until=0.4", "scheme.on_singular=stop"});
  CHECK(stopped.status == ExitStatus::singular);
  CHECK_THAT(stopped.message, Catch::Contains("no solution with the required energy"));
}

TEST_CASE("the forward discrete Lagrangian is refused as wrong input, and nothing is written") {
  const Folder folder;
  const std::string file = folder / "forward.h5";
  CHECK_THROWS_WITH(run_problem("pendulum", file, {"scheme.lagrangian=forward"}),
                    Catch::Contains("unstable") && Catch::Contains("allow_unstable"));
  CHECK_FALSE(std::filesystem::exists(file));
  CHECK_NOTHROW(run_problem("pendulum", file, {"scheme.lagrangian=forward", "scheme.until=0.3"}));
  CHECK(std::filesystem::exists(file));
}
