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
