// Runs with a step potential, from problem files: recorded, checked, continued, refused.

#include <catch2/catch.hpp>

#include <cmath>

#include <fmt/format.h>

#include <rubato/problem/effective.hpp>
#include <rubato/record/error.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "run/problem_texts.hpp"
#include "run/records.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

const std::vector<std::string> rotating = {"scheme.step_potential=auto", "scheme.until=20"};
const std::vector<std::string> colliding = {"scheme.step_potential=auto", "scheme.lagrangian=fourier",
                                            "grid.x.cells=65", "scheme.until=30"};

std::vector<std::string> with(std::vector<std::string> settings, const std::string& setting) {
  settings.push_back(setting);
  return settings;
}

std::string refusal(const std::vector<std::string>& settings) {
  const Folder folder;
  try {
    run_problem("pendulum", folder / "a.h5", settings);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("a run with a step potential is never off the law, tells the potential, and is checked and replayed") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  for (const auto& [name, settings] : {std::pair("pendulum-rotation", rotating), {"sine-gordon-kinks", colliding}}) {
    for (const char* every : {"output.every=1", "output.every=3"}) {
      INFO(name << ", " << every);
      const Outcome ran = run_problem(name, file, with(settings, every));
      REQUIRE(ran.status == ExitStatus::done);
      CHECK(ran.statistics.off_law_steps == 0);
      CHECK(ran.statistics.potential.largest() > 0.0);
      CHECK_THAT(to_table(ran), Contains("step potential"));
      CHECK_THAT(to_json(ran), Contains("\"step_potential\": {\"max\"") && Contains("\"kappa\"") && Contains("\"p\""));
      const Outcome checked = check(file, {.replay = true});
      CHECK(checked.status == ExitStatus::done);
      CHECK(differences(ran, checked) == Names{});
    }
  }
  // The twin: the same orbit without it.
  const Outcome plain = run_problem("pendulum-rotation", file, {"scheme.until=20"});
  CHECK(plain.statistics.off_law_steps > 0);
  CHECK_THAT(to_table(plain), !Contains("step potential"));
}

TEST_CASE("a step potential that was altered in a record is found, and so is an energy without it") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const Outcome ran = run_problem("pendulum-rotation", file, rotating);
  REQUIRE(check(file).status == ExitStatus::done);
  falsify(file, "/levels/step_potential", 7, 1e-6);
  CHECK(check(file).status == ExitStatus::contradiction);
  run_problem("pendulum-rotation", file, rotating);
  falsify(file, "/levels/energy", 7, -1e-5);
  CHECK(check(file).status == ExitStatus::contradiction);
  for (std::size_t i = 0; i < 3; ++i) {
    run_problem("pendulum-rotation", file, rotating);
    falsify(file, "/checkpoint/step_potential", i, 1e-9);
    CHECK_THROWS_AS(check(file), record::Error);  // by the checksum of the checkpoint
  }
}

TEST_CASE("a run with a step potential goes on with it, bit by bit") {
  const Folder folder;
  for (const auto& [name, settings] : {std::pair("pendulum-rotation", rotating), {"sine-gordon-kinks", colliding}}) {
    INFO(name);
    const std::string straight = folder / "straight.h5", stopped = folder / "stopped.h5";
    run_problem(name, straight, settings);
    run_problem(name, stopped, with(settings, "scheme.until=9"));
    CHECK(resume(stopped, name == std::string("pendulum-rotation") ? 20.0 : 30.0, {.threads = 1}).status ==
          ExitStatus::done);
    const Names different = different_datasets(straight, stopped);
    CHECK(different == Names{});
    std::filesystem::remove(straight);
    std::filesystem::remove(stopped);
  }
}

TEST_CASE("a run that was too short for a look-ahead is replayed as it was begun when it was continued") {
  const Folder folder;
  const std::string file = folder / "a.h5", straight = folder / "straight.h5";
  const std::vector<std::string> settings = {"grid.x.cells=32", "scheme.lagrangian=splitting",
                                             "scheme.order=4",  "output.every=100",
                                             "laws.every=off",  R"(verdict.accept=["spectrum"])"};
  run_problem("sine-gordon", file, with(settings, "scheme.until=2"));
  CHECK(resume(file, 85.0, {.threads = 1}).status == ExitStatus::done);  // 1700 steps
  CHECK(check(file, {.replay = true}).status == ExitStatus::done);
  // The twins: a run begun with that end has another potential, and an altered energy is found all the same.
  run_problem("sine-gordon", straight, with(settings, "scheme.until=85"));
  CHECK(check(straight, {.replay = true}).status == ExitStatus::done);
  CHECK_FALSE(different_datasets(file, straight) == Names{});
  falsify(file, "/levels/iterations", 15, 1);
  CHECK(check(file, {.replay = true}).status == ExitStatus::contradiction);
}

TEST_CASE("an orbit that escapes after the end of the run takes no potential that is chosen for that") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  // Driven over the saddles of H, it is at infinity soon after t = 33.
  const std::string problem = R"toml(
[hamiltonian]
q = ["x", "y"]
p = ["u", "v"]
H = "(u^2+v^2)/2 + (x^2+y^2)/2 + x^2*y - y^3/3 + 0.1*x*cos(t)"
[initial]
x = 0.1
y = 0.2
u = 0.3
v = -0.1
[scheme]
lagrangian = "gauss"
stages = 4
step = 0.2
until = 20
)toml";
  const auto strongest = [&](const Outcome& outcome) {
    return outcome.statistics.potential.largest() / outcome.statistics.node_energy.values.largest();
  };
  for (const double step : {0.2, 0.025}) {  // and where K does not depend on the step up to the end
    const Outcome calm = run(parse_problem(with(problem, "0.2\nuntil", fmt::format("{}\nuntil", step)), "a.toml"),
                             {.output = file, .overwrite = true});
    REQUIRE(calm.status == ExitStatus::done);
    CHECK(calm.judgement.verdict == figures::Verdict::good);
    CHECK(calm.warnings.empty());
    CHECK(strongest(calm) < 1e-3);
    CHECK(check(file, {.replay = true}).status == ExitStatus::done);
  }
  // It goes on with that, and is replayed although a run with this end would have begun with another.
  CHECK(resume(file, 30.0).status == ExitStatus::done);
  CHECK(check(file, {.replay = true}).status == ExitStatus::done);
  // The twin: a run that has the escape in it.
  const Outcome wild =
      run(parse_problem(with(problem, "until = 20", "until = 33"), "a.toml"), {.output = file, .overwrite = true});
  CHECK(strongest(wild) > 0.1);
}

TEST_CASE("step potentials that cannot be are refused with the place") {
  CHECK_THAT(refusal({"scheme.step_potential=auto", "scheme.levels=fixed"}), Contains("levels = \"variable\""));
  CHECK_THAT(refusal({"scheme.step_potential=automatic"}), Contains("step_potential"));
  CHECK_THAT(refusal({"scheme.step_potential.kappa=2"}), Contains("needs kappa and p"));
  CHECK_THAT(refusal({"scheme.step_potential.kappa=2", "scheme.step_potential.p=2"}),
             Contains("greater than the order") && Contains("step_potential"));
  CHECK_THAT(refusal({"scheme.largest_step=2", "scheme.on_singular=plain"}), Contains("applies to step_potential"));
  CHECK_THAT(refusal({"scheme.step_potential=auto", "scheme.lagrangian=forward", "scheme.until=0.2"}),
             Contains("unstable"));
  CHECK(refusal({"scheme.largest_step=2", "scheme.until=2"}).empty());
  CHECK(refusal({"scheme.step_potential.kappa=2", "scheme.step_potential.p=4", "scheme.until=2"}).empty());
}

TEST_CASE("steps that are off the law by rounding errors alone are counted, and no warning") {
  const Folder folder;
  // A plane wave: nothing of it changes but its phase, and which h keeps the energy rounding decides.
  const Problem wave = parse_problem(R"toml(
[field]
equation = "i*psi_t + psi_xx + 2*abs2(psi)*psi = 0"
psi = ["p", "q"]
[grid]
x = { from = -20, to = 20, cells = 101, phase = { psi = "pi/3" } }
[initial]
p = "cos(pi/3*x/40)"
q = "sin(pi/3*x/40)"
[scheme]
step = 0.05
until = 0.5
)toml",
                                     "wave.toml");
  const Outcome calm = run(wave, {.output = folder / "wave.h5"});
  REQUIRE(calm.status == ExitStatus::done);
  CHECK(calm.warnings.empty());
  // The twin: a potential that is too weak.
  const Outcome weak =
      run_problem("pendulum", folder / "weak.h5",
                  {"scheme.lagrangian=gauss", "scheme.stages=3", "initial.p=2.0237511123762504", "scheme.step=-0.6",
                   "scheme.until=-60", "scheme.step_potential.kappa=3.31", "scheme.step_potential.p=7"});
  REQUIRE(weak.statistics.off_law_steps > 0);
  CHECK_THAT(to_json(weak), Contains("had no solution in spite of the step potential"));
}

TEST_CASE("an unstable equilibrium takes the first step all along, although rounding moves it after the end") {
  const auto outcome_of = [](const std::string& u) {
    const Folder folder;
    Outcome outcome = run(parse_problem("[field]\nequation = \"u_tt = u_xx - sin(u)\"\n[grid]\nx = { from = 0, to = 7, "
                                        "cells = 33 }\n[initial]\nu = \"" +
                                            u + "\"\nu_t = 0\n[scheme]\nlagrangian = \"box\"\nstep = 0.02\nuntil = 2\n",
                                        "rest.toml"),
                          {.output = folder / "a.h5", .threads = 1});
    CHECK(outcome.status == ExitStatus::done);
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
    return outcome;
  };
  const Outcome rest = outcome_of("pi");
  CHECK(rest.statistics.steps == 100);
  CHECK(rest.statistics.potential.largest() == 0.0);
  CHECK(rest.judgement.verdict == figures::Verdict::good);
  // The twin: it moves, by steps that the law sets.
  CHECK(outcome_of("3").statistics.potential.largest() > 0.0);
}
