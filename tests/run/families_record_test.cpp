// Gauss collocation and splittings as a user of problem files meets them: runs, their records, and what `check` makes
// of these.

#include <catch2/catch.hpp>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/core.h>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

using Settings = std::vector<std::string>;

Settings gauss(int stages) {
  return {"scheme.lagrangian=gauss", "scheme.stages=" + std::to_string(stages)};
}
Settings splitting(const std::string& name) {
  return {"scheme.lagrangian=splitting", "scheme.composition=" + name};
}
Settings with(Settings settings, const Settings& more) {
  settings.insert(settings.end(), more.begin(), more.end());
  return settings;
}

const Settings fixed = {"scheme.levels=fixed", "scheme.until=20"};
const Settings variable = {"scheme.levels=variable", "scheme.until=20"};

/// Whether the step taken again from the stored states is what disagrees.
bool step_disagrees(const Outcome& outcome) {
  return std::ranges::any_of(outcome.disagreements, [](const Disagreement& found) {
    return found.reason.find("leaves of its equation") != std::string::npos;
  });
}
bool energy_disagrees(const Outcome& outcome) {
  return std::ranges::any_of(outcome.disagreements, [](const Disagreement& found) {
    return found.dataset == "/levels/energy" && found.reason.find("states around the step") != std::string::npos;
  });
}

}  // namespace

TEST_CASE("check takes the steps of every family again and finds the figures of the run") {
  const Folder folder;
  const std::string file = folder / "family.h5";
  std::vector<Settings> families;
  for (int stages = 1; stages <= 8; ++stages) {
    families.push_back(gauss(stages));
  }
  for (const char* name : {"golden", "verlet", "suzuki-4", "blanes-moan-4", "kahan-li-6", "kahan-li-8"}) {
    families.push_back(splitting(name));
  }
  for (const Settings& family : families) {
    INFO(family[0] << ", " << family[1]);
    const Outcome ran = run_problem("henon-heiles", file, with(family, fixed));
    REQUIRE(ran.status == ExitStatus::done);
    const Outcome checked = check(file);
    CHECK(checked.status == ExitStatus::done);
    CHECK(checked.disagreements.empty());
    CHECK(differences(ran, checked) == Names{});
    // Components of the states are below 1; a step taken again is off by a few roundings of the state and of its own.
    REQUIRE(checked.statistics.residuals.size() == 1);
    CHECK(checked.statistics.residuals[0].value.largest() <= 1e-14);
    // Only the golden splitting knows its Γ.
    CHECK(ran.statistics.gamma.any() == (family[1] == "scheme.composition=golden"));
    CHECK((to_table(ran).find("Gamma") != std::string::npos) == (family[1] == "scheme.composition=golden"));
  }
  // H that is not separable, and stages that need Newton's iteration.
  for (const char* step : {"0.1", "1"}) {
    REQUIRE(
        run_problem("non-separable", file, with(gauss(3), {"scheme.levels=fixed", std::string("scheme.step=") + step}))
            .status == ExitStatus::done);
    CHECK(check(file).disagreements.empty());
  }
}

TEST_CASE("check with variable levels, with steps off the law, and with every = 7") {
  const Folder folder;
  const std::string file = folder / "family.h5";
  for (const Settings& family : {gauss(2), gauss(3), splitting("golden")}) {
    for (const char* every : {"1", "7"}) {
      INFO(family[1] << ", every " << every);
      const Outcome ran =
          run_problem("henon-heiles", file, with(with(family, variable), {std::string("output.every=") + every}));
      REQUIRE(ran.status == ExitStatus::done);
      CHECK(ran.statistics.relative_energy_deviation() < 1e-13);
      const Outcome checked = check(file);
      CHECK(checked.status == ExitStatus::done);
      CHECK(differences(ran, checked) == Names{});
    }
  }
  const Outcome crossing =
      run_problem("pendulum-rotation", file, with(splitting("golden"), {"scheme.step_potential=none"}));
  REQUIRE(crossing.status == ExitStatus::done);
  CHECK(crossing.statistics.off_law_steps > 10);
  CHECK(check(file, {.replay = true}).status == ExitStatus::done);
}

TEST_CASE("check sees a family's record that was altered, by the step taken again") {
  const Folder folder;
  const std::string file = folder / "family.h5";
  for (const Settings& family : {gauss(3), splitting("golden"), splitting("kahan-li-8")}) {
    INFO(family[1]);
    const auto altered = [&](const std::string& dataset, std::size_t index, double change) {
      REQUIRE(run_problem("henon-heiles", file, with(family, fixed)).status == ExitStatus::done);
      falsify(file, dataset, index, change);
      const Outcome outcome = check(file);
      CHECK(outcome.status == ExitStatus::contradiction);
      return outcome;
    };
    // States of size 1 in steps of 0.1: roundings of some 1e-16, and 64 of them are 1e-14.
    CHECK(step_disagrees(altered("/states/q", 100, 1e-12)));
    CHECK(step_disagrees(altered("/states/p", 101, -1e-12)));
    CHECK(step_disagrees(altered("/levels/h", 50, 1e-11)));
    CHECK(energy_disagrees(altered("/levels/energy", 50, 1e-13)));
    CHECK_FALSE(step_disagrees(altered("/levels/energy", 50, 1e-13)));  // the twin: nothing is wrong with the states
  }
}

TEST_CASE("a record of one family is not one of another") {
  // The same numbers with another scheme in the problem: K and the map of each are its own.
  const Folder folder;
  const std::string file = folder / "family.h5";
  REQUIRE(run_problem("henon-heiles", file, with(splitting("suzuki-4"), fixed)).status == ExitStatus::done);
  const std::string text = rubato::record::Reader(file).header().problem;
  const std::string name = "suzuki-4";
  std::string other = text;
  REQUIRE(other.find(name) != std::string::npos);
  other.replace(other.find(name), name.size(), "blanes-moan-4");
  replace_problem(file, other);
  const Outcome outcome = check(file);
  CHECK(outcome.status == ExitStatus::contradiction);
  CHECK(step_disagrees(outcome));
  CHECK(energy_disagrees(outcome));
}

TEST_CASE("a resumed run of a family is that of one never stopped, bit for bit") {
  const Folder folder;
  for (const Settings& family : {gauss(2), gauss(4), splitting("golden"), splitting("kahan-li-6")}) {
    const bool levels = family[1] == "scheme.stages=2" || family[1] == "scheme.composition=golden";
    INFO(family[1]);
    const std::string whole = folder / "whole.h5", stopped = folder / "stopped.h5";
    const Settings settings = with(family, levels ? variable : fixed);
    REQUIRE(run_problem("henon-heiles", whole, with(settings, {"scheme.until=20"})).status == ExitStatus::done);
    REQUIRE(run_problem("henon-heiles", stopped, with(settings, {"scheme.until=7"})).status == ExitStatus::done);
    REQUIRE(resume(stopped, 20.0, {.threads = 1}).status == ExitStatus::done);
    CHECK(different_datasets(stopped, whole) == Names{});
  }
}

TEST_CASE("where the level equation of a family has no solution the run ends, and says why") {
  // η of Verlet and of the higher splittings changes its sign on this orbit.
  const Folder folder;
  const std::string file = folder / "family.h5";
  for (const Settings& family : {splitting("verlet"), splitting("suzuki-4"), gauss(2)}) {
    INFO(family[1]);
    const bool is_gauss = family[0] == "scheme.lagrangian=gauss";
    const Settings bare = with(family, {"scheme.step_potential=none"});
    const Outcome ended = run_problem("pendulum-rotation", file, with(bare, {"scheme.on_singular=stop"}));
    CHECK(ended.status == ExitStatus::singular);
    CHECK(ended.statistics.off_law_steps == 0);
    CHECK_THAT(ended.message, Contains("dE/dh") && !Contains("Gamma") && Contains("step_potential = \"auto\"") &&
                                  Contains("on_singular = \"plain\"") && Contains("levels = \"fixed\""));
    CHECK_THAT(ended.message, is_gauss || family[1] != "scheme.composition=verlet" ? Contains("(24/(20 h^3)) dE/dh")
                                                                                   : Contains("-(4/h) dE/dh"));
    CHECK(check(file).status == ExitStatus::done);
    // The remedies that are named help.
    const Outcome plain = run_problem("pendulum-rotation", file, with(bare, {"scheme.on_singular=plain"}));
    CHECK(plain.status == ExitStatus::done);
    CHECK(plain.statistics.off_law_steps > 0);
    for (const std::string& warning : plain.warnings) {
      CHECK_THAT(warning, !Contains("Gamma"));
    }
    CHECK(check(file).status == ExitStatus::done);
    CHECK(run_problem("pendulum-rotation", file, with(family, {"scheme.levels=fixed"})).status == ExitStatus::done);
    // And so does the step potential, which these families have where nothing is said of it.
    const Outcome levels = run_problem("pendulum-rotation", file, with(family, {"scheme.step_potential=auto"}));
    CHECK(levels.status == ExitStatus::done);
    CHECK(levels.statistics.off_law_steps == 0);
    CHECK(levels.statistics.potential.largest() > 0.0);
    CHECK(check(file).status == ExitStatus::done);
  }
}

TEST_CASE("order chooses the splitting") {
  const Folder folder;
  const Settings base = with({"scheme.lagrangian=splitting"}, fixed);
  for (const auto& [order, name] : {std::pair("2", "golden"), std::pair("4", "blanes-moan-4"),
                                    std::pair("6", "kahan-li-6"), std::pair("8", "kahan-li-8")}) {
    INFO(order);
    const std::string by_order = folder / "order.h5", by_name = folder / "name.h5", other = folder / "other.h5";
    run_problem("henon-heiles", by_order, with(base, {std::string("scheme.order=") + order}));
    run_problem("henon-heiles", by_name, with(base, {std::string("scheme.composition=") + name}));
    run_problem("henon-heiles", other, with(base, {"scheme.composition=verlet"}));
    CHECK(different_datasets(by_order, by_name) == Names{});
    CHECK_FALSE(different_datasets(by_order, other) == Names{});
  }
  const std::string plain = folder / "plain.h5", golden = folder / "golden.h5";
  run_problem("henon-heiles", plain, base);
  run_problem("henon-heiles", golden, with(base, {"scheme.composition=golden"}));
  CHECK(different_datasets(plain, golden) == Names{});
}

TEST_CASE("check takes steps again that are too long to be solved from nothing") {
  // Two coupled pendula with eight stages and steps as long as an oscillation: the run solves them because each begins
  // where the one before ended. How long they become hangs on the last digits; of three first steps one will do.
  const auto pendula = [](const char* step) {
    return parse_problem(fmt::format(R"toml(
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "0.7667*u^2 + 1.07*v^2 - 1.54*cos(x) - 1.948*cos(y) - 0.6873*cos(y - x)"
[initial]
x = -0.04732
y = 0.8838
u = -0.4391
v = -0.4242
[scheme]
lagrangian = "gauss"
stages = 8
step_potential = "none"
step = {}
until = -66
on_singular = "plain"
[output]
every = 3
)toml",
                                     step),
                         "pendula.toml");
  };
  const Folder folder;
  const std::string file = folder / "pendula.h5";
  double longest = 0.0;
  for (const char* step : {"-0.59", "-0.8", "-0.61"}) {
    INFO(step);
    const Outcome ran = run(pendula(step), {.output = file, .overwrite = true});
    REQUIRE(ran.status == ExitStatus::done);
    longest = std::max(longest, -ran.statistics.h.min);
    const Outcome checked = check(file);
    CHECK(checked.status == ExitStatus::done);
    CHECK(checked.disagreements.empty());
  }
  CHECK(longest > 2.0);
  falsify(file, "/states/q", 41, 1e-7);
  CHECK(check(file).status == ExitStatus::contradiction);
}

TEST_CASE("the record of a lattice's run that ended by failure keeps the level before its last one") {
  // Every 16th level is stored, and the last, with the one before: the third step has no solution.
  const Problem problem = parse_problem(R"toml(
[multisymplectic]
fields = ["p1", "q1", "p2", "q2"]
M = [["p1", "q1", 1], ["p2", "q2", 1]]
K.x = [["p1", "q2", 1], ["q1", "p2", -1]]
S = "-0.6513*(p1^2 + q1^2 - p2^2 - q2^2) + 0.06884*(p1^2 + q1^2 - p2^2 - q2^2)^2"
[grid]
x = { from = 0, to = 11.84, cells = 34 }
[initial]
p1 = "-0.2123*sin(pi*x/5.92 + 3.468) + 0.01658*sin(pi*x/5.92 + 5.182)"
q1 = "-0.08094*sin(pi*x/2.96 + 2.918)"
p2 = "0.04378 - 0.5401*sin(pi*x/5.92 + 4.875) + 0.1613*sin(pi*x/5.92 + 4.975)"
q2 = "0.2096*sin(pi*x/2.96 + 4.613) + 0.5842*sin(pi*x/2.96 + 1.818)"
[scheme]
lagrangian = "splitting"
step = 0.03659
until = 0.378
on_singular = "stop"
[output]
every = 16
)toml",
                                        "dirac.toml");
  const Folder folder;
  const std::string file = folder / "dirac.h5";
  const Outcome ran = run(problem, {.output = file});
  REQUIRE(ran.status == ExitStatus::singular);
  REQUIRE(ran.statistics.steps >= 2);
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  CHECK(checked.disagreements.empty());
  falsify(file, "/states/previous/p1", 40, 1e-7);
  CHECK(check(file).status == ExitStatus::contradiction);
}
