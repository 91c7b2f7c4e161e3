// [solve] of problem files: what it says, its record, the check of that, and what is wrong with one.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include <rubato/figures/text.hpp>
#include <rubato/problem/help.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/solve.hpp>

#include "records.hpp"

using namespace rubato;
using namespace rubato::tests;
using namespace rubato::run_tests;

namespace {

constexpr const char* pendulum = R"toml(title = "Pendulum to a place"
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 - cos(q)"
[parameters]
E = -0.2
[initial]
q = -1.5
p = 0
[invariants]
half = "p^2/4 - cos(q)/2"
[solve]
ends = { p_0 = 0, q_1 = 0.5 }
energy = "E"
[scheme]
lagrangian = "midpoint"
step = 0.1
until = 2.2
)toml";

Problem problem_with(const std::vector<std::string>& settings) {
  return parse_problem(pendulum, "pendulum.toml", settings);
}

std::string error_of(const std::vector<std::string>& settings) {
  try {
    static_cast<void>(problem_with(settings));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("solve: the record of a solution is checked from its states, and what was changed is found") {
  const Folder folder;
  const std::string file = folder / "solved.h5";
  const SolveOutcome outcome = solve_problem(problem_with({}), {.output = file});
  REQUIRE(outcome.status == ExitStatus::done);
  CHECK(outcome.statistics.steps == 22);
  CHECK(outcome.statistics.energy_deviation() < 1e-14);
  CHECK(to_json(outcome).find("\"residual\"") != std::string::npos);
  CHECK_THAT(to_table(outcome), Catch::Contains("verdict                    found"));
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  CHECK(checked.compared > 100);
  CHECK(checked.statistics.energy() == Approx(-0.2).epsilon(1e-14));
  // Refused: a record that is there, and to go on from one.
  CHECK_THROWS_AS(solve_problem(problem_with({}), {.output = file}), record::AlreadyExists);
  CHECK_THROWS_WITH(resume(file, 10.0), Catch::Contains("boundary-value problem"));
  // Twin: a state that is moved, with its checksums made to fit.
  for (const char* path : {"/states/q", "/levels/energy", "/levels/h"}) {
    CAPTURE(path);
    const std::string twin = folder / "twin.h5";
    std::filesystem::copy_file(file, twin, std::filesystem::copy_options::overwrite_existing);
    falsify(twin, path, 7, 1e-9);
    const Outcome found = check(twin);
    CHECK(found.status == ExitStatus::contradiction);
  }
}

TEST_CASE("solve: symmetric orbits by half are the periodic ones, with any levels") {
  const Folder folder;
  const std::vector<std::string> common = {"solve.energy=-0.5", "initial.q=1.0", "scheme.until=6.7"};
  const auto solved = [&](std::vector<std::string> more, const std::string& name) {
    more.insert(more.end(), common.begin(), common.end());
    return solve_problem(problem_with(more), {.output = folder / name});
  };
  const SolveOutcome half = solved({"solve.ends=symmetric", "solve.mirror=[\"p\"]"}, "half.h5");
  const SolveOutcome whole = solved({"solve.ends=periodic"}, "whole.h5");
  REQUIRE(half.status == ExitStatus::done);
  REQUIRE(whole.status == ExitStatus::done);
  // The same discretisation, 68 and 67 steps of order 2, of the period 4 K(sin²(q/2)), cos q = 1/2.
  const double period = 4.0 * std::comp_ellint_1(0.5);
  CHECK(half.solution.orbit.duration() == Approx(period).epsilon(2e-3));
  CHECK(whole.solution.orbit.duration() == Approx(period).epsilon(2e-3));
  CHECK(half.solution.orbit.segments() == 68);
  CHECK(check(folder / "half.h5").status == ExitStatus::done);
  // Mirrored in what it is not symmetric in: the half is found, and does not go on.
  const SolveOutcome wrong = solved(
      {"solve.ends=symmetric", "solve.mirror=[\"q\"]", "hamiltonian.H=p^2/2 - cos(q) + 0.1*sin(q)*p"}, "wrong.h5");
  CHECK(wrong.status == ExitStatus::failed);
  CHECK_FALSE(std::filesystem::exists(folder.path() / "wrong.h5"));
}

TEST_CASE("solve: a problem stated by L has the solution of its H, and its velocities are checked") {
  const Folder folder;
  const std::vector<std::string> common = {"scheme.lagrangian=gauss", "scheme.stages=2"};
  const auto by_L = [&](std::vector<std::string> more) {
    more.insert(more.begin(), common.begin(), common.end());
    std::string text = pendulum;
    text.replace(text.find("[hamiltonian]"), text.find("[parameters]") - text.find("[hamiltonian]"),
                 "[lagrangian]\nq = [\"q\"]\nL = \"(1 + 0.1*q^2)*q_dot^2/2 + 0.2*q*q_dot + cos(q)\"\n");
    more.insert(more.end(), {"-initial.p", "initial.q_dot=0.2", "solve.ends={ p_q_0 = 0, q_1 = 0.5 }",
                             "invariants.half=(1 + 0.1*q^2)*q_dot^2/2 - cos(q)"});
    return parse_problem(text, "pendulum.toml", more);
  };
  const std::string file = folder / "L.h5";
  const SolveOutcome stated_by_L = solve_problem(by_L({}), {.output = file});
  REQUIRE(stated_by_L.status == ExitStatus::done);
  // H = (p - 0.2 q)²/(2 (1 + 0.1 q²)) - cos q, by hand
  std::vector<std::string> by_hand = common;
  by_hand.emplace_back("hamiltonian.H=(p - 0.2*q)^2/(2*(1 + 0.1*q^2)) - cos(q)");
  const SolveOutcome stated_by_H = solve_problem(problem_with(by_hand), {.output = folder / "H.h5"});
  REQUIRE(stated_by_H.status == ExitStatus::done);
  CHECK(stated_by_L.solution.orbit.duration() == Approx(stated_by_H.solution.orbit.duration()).epsilon(1e-13));
  // The invariant is the energy at nodes, by velocities, which is off by O(h⁴).
  CHECK(stated_by_L.statistics.invariants.front().value.initial == Approx(-0.2).epsilon(1e-4));
  CHECK(check(file).status == ExitStatus::done);
  falsify(file, "/states/q_dot", 7, 1e-9);
  CHECK(check(file).status == ExitStatus::contradiction);
  // Refused: what has no formula of H, and quadratures of L itself.
  CHECK_THROWS_WITH(by_L({"lagrangian.L=-sqrt(1 - q_dot^2)", "initial.q_dot=0.2"}),
                    Catch::Contains("not quadratic in the velocities"));
  CHECK_THROWS_WITH(by_L({"scheme.lagrangian=lobatto", "scheme.stages=3"}), Catch::Contains("use gauss, midpoint"));
}

TEST_CASE("solve: further starts are tried in order") {
  const Folder folder;
  const auto solved = [&](const std::string& starts, const std::string& name) {
    return solve_problem(problem_with({"solve.energy=-0.2", "initial.q=-3", "solve.max_iterations=8", starts}),
                         {.output = folder / name});
  };
  const SolveOutcome found = solved("solve.starts=[{ q = -40 }, { q = -1.36 }]", "found.h5");
  REQUIRE(found.status == ExitStatus::done);
  CHECK(found.start == 3);
  CHECK_THAT(to_table(found), Catch::Contains("3 of 3"));
  CHECK(check(folder / "found.h5").status == ExitStatus::done);
  const SolveOutcome none = solved("solve.starts=[{ q = -40 }]", "none.h5");  // twin
  CHECK(none.status == ExitStatus::failed);
  CHECK_THAT(to_json(none), Catch::Contains("\"starts\": 2"));
  CHECK_THAT(error_of({"solve.starts=[{ r = 1 }]"}), Catch::Contains("r is no coordinate or momentum"));
  CHECK_THAT(error_of({"solve.starts=[1]"}), Catch::Contains("a table such as"));
}

TEST_CASE("solve: what fails says where, and writes nothing") {
  const Folder folder;
  const std::string file = folder / "none.h5";
  const SolveOutcome outcome = solve_problem(problem_with({"solve.energy=-0.99"}), {.output = file});
  CHECK(outcome.status == ExitStatus::failed);
  CHECK_THAT(outcome.message, Catch::Contains("the residual is") && Catch::Contains("the largest in"));
  CHECK_FALSE(std::filesystem::exists(file));
  CHECK_THROWS_WITH(
      solve_problem(parse_problem(pendulum, "p.toml", std::vector<std::string>{"-solve"}), {.output = file}),
      Catch::Contains("there is no [solve]"));
}

TEST_CASE("solve: wrong entries are refused with their place and a remedy") {
  CHECK_THAT(error_of({"solve.ends={ q_0 = 1, q_2 = 0 }"}), Catch::Contains("did you mean q_0?"));
  CHECK_THAT(error_of({"solve.ends={ q_0 = 1 }"}), Catch::Contains("2 are needed"));
  CHECK_THAT(error_of({"solve.ends=cyclic"}), Catch::Contains("periodic"));
  CHECK_THAT(error_of({"solve.ends=[\"q_0 = 1 = 2\", \"p_0\"]"}), Catch::Contains("one ="));
  CHECK_THAT(error_of({"solve.ends=[\"q_0 = r\", \"p_0\"]"}), Catch::Contains("r"));
  CHECK_THAT(error_of({"solve.period=3"}), Catch::Contains("write time"));
  CHECK_THAT(error_of({"solve.time=-3"}), Catch::Contains("sign"));
  CHECK_THAT(error_of({"solve.mirror=[\"q\"]"}), Catch::Contains("symmetric"));
  CHECK_THAT(error_of({"solve.ends=symmetric", "solve.mirror=[\"q\", \"p\"]"}), Catch::Contains("one of each pair"));
  CHECK_THAT(error_of({"solve.ends=connection"}), Catch::Contains("from and to"));
  CHECK_THAT(error_of({"solve.guess={ q = \"t\" }"}), Catch::Contains("no formula for p"));
  CHECK_THAT(error_of({"scheme.lagrangian=splitting"}), Catch::Contains("splitting"));
  CHECK_THAT(error_of({"scheme.lagrangian=forward"}), Catch::Contains("4 are needed"));
  CHECK_THAT(error_of({"hamiltonian.H=p^2/2 - cos(q)*t"}), Catch::Contains("H names t"));
  CHECK_THAT(error_of({"solve.endss=1"}), Catch::Contains("endss"));
  CHECK(error_of({}).empty());
}

TEST_CASE("solve: a branch in a parameter goes round a fold, and its end is a record of its own problem") {
  const Folder folder;
  const std::string file = folder / "bratu.h5";
  const std::vector<std::string> bratu = {"hamiltonian.H=p^2/2 + E*exp(q)",
                                          "parameters.E=1",
                                          "initial.q=0",
                                          "initial.p=0.5",
                                          "solve.ends={ q_0 = 0, q_1 = 0 }",
                                          "-solve.energy",
                                          "solve.time=1",
                                          "scheme.step=0.05",
                                          "scheme.until=1",
                                          "-invariants"};
  std::vector<std::string> round = bratu;
  round.emplace_back("solve.continue={ parameter = \"E\", to = 0.5, step = 0.2 }");
  const SolveOutcome outcome = solve_problem(problem_with(round), {.output = file});
  REQUIRE(outcome.status == ExitStatus::done);
  CHECK(std::ranges::count_if(outcome.branch, &BranchRow::is_fold) == 1);
  const auto fold = std::ranges::find_if(outcome.branch, &BranchRow::is_fold);
  CHECK(fold->parameter == Approx(3.513830719125162).epsilon(5e-3));  // O(h²), h = 0.05
  CHECK(outcome.branch.back().parameter == Approx(0.5).epsilon(1e-12));
  CHECK(check(file).status == ExitStatus::done);
  // Twin: the record says that its parameter is the last one.
  CHECK_THAT(record::Reader(file).header().problem, Catch::Contains("0.5"));
  std::string dependent = pendulum;
  dependent.insert(dependent.find("E = -0.2"), "half_of_it = \"E/2\"\n");
  CHECK_THROWS_WITH(solve_problem(parse_problem(dependent, "p.toml", round), {.output = file, .overwrite = true}),
                    Catch::Contains("half_of_it follows from E"));
  CHECK_THAT(error_of({"solve.continue={ parameter = \"F\", to = 1 }"}), Catch::Contains("energy, time"));
}
