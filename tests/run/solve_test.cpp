// [solve] of problem files: what it says, its record, the check of that, and what is wrong with one.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <filesystem>
#include <numbers>

#include <fmt/format.h>

#include <rubato/figures/text.hpp>
#include <rubato/problem/help.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/record_scales.hpp>
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
  CHECK_THAT(to_table(outcome), Catch::Contains("verdict                    good"));
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

TEST_CASE("solve: an orbit of no duration is no solution, and one that rests is reported as an equilibrium") {
  const Folder folder;
  const auto closed = [&](std::vector<std::string> settings) {
    settings.insert(settings.end(), {"solve.ends=periodic", "scheme.levels=fixed", "scheme.until=6.5", "initial.q=0",
                                     "initial.p=1", "scheme.step=0.1"});
    return solve_problem(problem_with(settings), {.output = folder / "closed.h5", .overwrite = true});
  };
  // A pendulum of energy above 1 turns over, and no orbit of it closes. Residuals of an energy fall with the duration.
  for (const char* energy : {"solve.energy=50", "solve.energy=-2"}) {
    const SolveOutcome none = closed({energy});
    CHECK(none.status == ExitStatus::failed);
    CHECK_THAT(none.message, Catch::Contains("shrank"));
  }
  const SolveOutcome some = closed({"solve.energy=-0.5"});  // twin
  REQUIRE(some.status == ExitStatus::done);
  CHECK(some.solution.mean_energy == Approx(-0.5).epsilon(1e-12));
  CHECK(some.judgement.reasons.empty());
  // No oscillation has a period below 2 pi.
  const SolveOutcome rest = closed({"solve.period=3", "-solve.energy"});
  REQUIRE(rest.status == ExitStatus::done);
  CHECK_THAT(to_json(rest), Catch::Contains("equilibrium"));
  CHECK(rest.judgement.verdict == figures::Verdict::doubtful);
  CHECK(check(folder / "closed.h5").judgement.verdict == figures::Verdict::doubtful);
  CHECK(closed({"solve.period=8", "-solve.energy"}).judgement.reasons.empty());  // twin
  // The law of levels leaves their lengths open there.
  const auto other = [&](std::vector<std::string> settings, const std::string& until) {
    settings.insert(settings.end(), {"-solve.energy", "initial.q=0.5", "initial.p=0", "scheme.until=" + until});
    return solve_problem(problem_with(settings), {.output = folder / "other.h5", .overwrite = true});
  };
  for (const char* until : {"1", "3"}) {
    const SolveOutcome levels = other({"solve.ends=periodic"}, until);
    CHECK(levels.status == ExitStatus::done);
    CHECK_THAT(to_json(levels), Catch::Contains("equilibrium"));
    const SolveOutcome half = other({"solve.ends=symmetric", "solve.mirror=[\"p\"]"}, until);
    CHECK(half.status == ExitStatus::failed);
    CHECK_THAT(half.message, Catch::Contains("equilibrium"));
  }
  // The twin: the half of an orbit, begun from a guess of its period.
  CHECK(other({"solve.ends=symmetric", "solve.mirror=[\"p\"]", "solve.energy=-0.87758"}, "6.2").status ==
        ExitStatus::done);
}

TEST_CASE("solve: the verdict is by half the step, and a check finds it again") {
  const Folder folder;
  const std::string file = folder / "closed.h5";
  const auto closed = [&](std::vector<std::string> settings) {
    settings.insert(settings.end(), {"solve.ends=periodic", "-solve.energy"});
    return solve_problem(problem_with(settings), {.output = file, .overwrite = true});
  };
  // Four steps of order 2 in a turn have an error of a seventh of it, by the elliptic integral.
  const SolveOutcome coarse = closed({"solve.energy=-0.5", "initial.q=1", "scheme.until=6.7", "scheme.step=1.675"});
  CHECK(coarse.status == ExitStatus::done);
  CHECK(coarse.judgement.verdict == figures::Verdict::doubtful);
  CHECK_THAT(to_table(coarse), Catch::Contains("doubtful: the steps do not resolve the orbit"));
  CHECK_THAT(to_json(coarse), Catch::Contains("\"what\": \"resolution\"") && Catch::Contains("\"step_error\""));
  CHECK(check(file).judgement.verdict == figures::Verdict::doubtful);
  CHECK(closed({"solve.energy=-0.5", "initial.q=1", "scheme.until=6.7", "scheme.step=1.675",
                "verdict.accept=[\"resolution\"]"})
            .judgement.verdict == figures::Verdict::good);
  CHECK(closed({"solve.energy=-0.5", "initial.q=1", "scheme.until=6.7", "scheme.step=0.2"}).judgement.verdict ==
        figures::Verdict::good);  // twin
  // Seven steps of order 8 close on a zigzag, which no orbit of the pendulum follows.
  const SolveOutcome none =
      closed({"scheme.lagrangian=gauss", "scheme.stages=4", "scheme.levels=fixed", "initial.q=3", "initial.p=0",
              "solve.period=20", "scheme.until=20", "scheme.step=2.857142857142857"});
  CHECK(none.judgement.verdict != figures::Verdict::good);
  // Lost is a status of its own, and has a record that is sound.
  const SolveOutcome lost =
      closed({"scheme.lagrangian=midpoint", "scheme.levels=variable", "initial.q=3", "initial.p=0", "solve.period=20",
              "scheme.until=20", "scheme.step=1.6666666666666667"});
  CHECK(lost.status == ExitStatus::lost);
  CHECK_THAT(lost.message, Catch::Contains("a solution was found, but it is lost"));
  const Outcome checked = check(file);
  CHECK(checked.status == ExitStatus::done);
  CHECK(checked.judgement.verdict == figures::Verdict::lost);
  // Twin: a measure that was made better.
  falsify(file, "/checkpoint/verdict", 21, -1.0);
  CHECK_THROWS_WITH(check(file), Catch::Contains("is damaged"));
}

TEST_CASE("solve: conditions that leave the orbit open are named, and the verdict is doubtful") {
  const Folder folder;
  const auto solved = [&](std::vector<std::string> settings) {
    settings.insert(settings.end(), {"initial.q=0", "initial.p=1", "scheme.until=3"});
    return solve_problem(problem_with(settings), {.output = folder / "open.h5", .overwrite = true});
  };
  const SolveOutcome twice = solved({"solve.ends=[\"q_0 = 0\", \"2*q_0 = 0\"]", "-solve.energy"});
  CHECK(twice.status == ExitStatus::done);
  CHECK(twice.judgement.verdict == figures::Verdict::doubtful);
  CHECK_THAT(to_table(twice), Catch::Contains("dependent conditions       the end condition q_0 = 0; the end condition "
                                              "2*q_0 = 0") &&
                                  Catch::Contains("does not determine the energy of the orbit"));
  CHECK_THAT(to_json(twice),
             Catch::Contains("\"dependent_conditions\"") && Catch::Contains("\"what\": \"conditions\""));
  CHECK(check(folder / "open.h5").judgement.verdict == figures::Verdict::doubtful);
  const SolveOutcome energy = solved(
      {"solve.ends=[\"q_0 = 0\", \"p_0 = 1\"]", "solve.energy=-0.5", "scheme.lagrangian=gauss", "scheme.stages=4"});
  CHECK_THAT(to_table(energy), Catch::Contains("does not determine the duration of the orbit"));
  // Twins: another condition; a member of the family that is taken as it is; a family that is asked for.
  CHECK(solved({"solve.ends=[\"q_0 = 0\", \"2*q_1 = 1\"]", "-solve.energy"}).judgement.reasons.empty());
  CHECK(solved({"solve.ends=[\"q_0 = 0\", \"2*q_0 = 0\"]", "-solve.energy", "verdict.accept=[\"conditions\"]"})
            .judgement.verdict == figures::Verdict::good);
  CHECK(solve_problem(problem_with({"solve.ends=periodic", "solve.period=free", "-solve.energy", "initial.q=1",
                                    "initial.p=0", "scheme.until=6.7"}),
                      {.output = folder / "free.h5"})
            .judgement.reasons.empty());
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

namespace {

constexpr const char* lattice_breather = R"toml(title = "Breather on a ring"
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + 1 - cos(u)"
[grid]
x = { from = -6, to = 6, cells = 25 }
[parameters]
G = "2/sqrt(3)"
[initial]
u = "0"
v = "1.7*sech(0.44*x)"
[solve]
ends = "periodic"
[scheme]
lagrangian = "box"
levels = "fixed"
step = 0.25
until = 7
)toml";

Problem lattice_with(const std::vector<std::string>& settings) {
  return parse_problem(lattice_breather, "ring.toml", settings);
}

std::string lattice_error(const std::vector<std::string>& settings) {
  try {
    static_cast<void>(lattice_with(settings));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("solve: the record of a periodic lattice is that of a run that closes, and a change of it is found") {
  const Folder folder;
  const std::string file = folder / "ring.h5";
  const SolveOutcome outcome = solve_problem(lattice_with({}), {.output = file});
  REQUIRE(outcome.status == ExitStatus::done);
  CHECK(outcome.solution.orbit.duration() == Approx(7.0).epsilon(1e-13));
  CHECK(*outcome.closing < 1e-12);  // 28 steps of a stable orbit: rounding
  CHECK(outcome.statistics.steps == 28);
  CHECK_THAT(to_table(outcome), Catch::Contains("period") && Catch::Contains("closing"));
  CHECK_THAT(to_json(outcome), Catch::Contains("\"closing\""));
  const record::Reader reader(file);
  CHECK(reader.read("/solve/residual").back() < 1e-12);
  CHECK(check(file).status == ExitStatus::done);
  CHECK_THROWS_WITH(resume(file, 20.0), Catch::Contains("boundary-value problem"));
  CHECK_THROWS_AS(solve_problem(lattice_with({}), {.output = file}), record::AlreadyExists);
  // Twin: the run from the guess does not close, and contradicts itself if it is called a solution.
  for (const bool is_called_solution : {false, true}) {
    const std::string guess = folder / (is_called_solution ? "called.h5" : "guess.h5");
    const auto scales = is_called_solution ? history_scales(outcome.solution.history) : std::vector<record::Scale>();
    REQUIRE(run_with_scales(lattice_with({}), {.output = guess}, scales).status == ExitStatus::done);
    CHECK(check(guess).status == (is_called_solution ? ExitStatus::contradiction : ExitStatus::done));
  }
}

TEST_CASE("solve: multipliers do not depend on the unit of momenta, nor the index on the direction of time") {
  const std::vector<std::string> common = {"solve.ends=periodic", "scheme.lagrangian=gauss", "scheme.stages=3",
                                           "initial.q=1"};
  const auto solved = [&](std::vector<std::string> more) {
    more.insert(more.end(), common.begin(), common.end());
    SolveOutcome outcome = solve_problem(problem_with(more), {.output = Folder() / "a.h5"});
    REQUIRE(outcome.status == ExitStatus::done);
    return outcome;
  };
  for (const double m : {1.0, 1e-12, 1e15}) {
    INFO(m);
    const SolveOutcome outcome = solved({fmt::format("hamiltonian.H={0}*((p/{0})^2/2 - cos(q))", m),
                                         fmt::format("parameters.E={}", -0.2 * m), "scheme.until=7"});
    REQUIRE(outcome.multipliers.size() == 2);
    for (const std::complex<double>& multiplier : outcome.multipliers) {
      CHECK(std::abs(multiplier - 1.0) < 1e-6);  // double, so to the root of what its matrix is off by
    }
  }
  const SolveOutcome forward = solved({"scheme.until=7"}), backward = solved({"scheme.step=-0.1", "scheme.until=-7"});
  REQUIRE(forward.index.has_value());
  CHECK(forward.index == std::optional<std::size_t>(1));
  CHECK(backward.index == forward.index);
}

TEST_CASE("solve: a jump of an orbit that closes leaves H as it is") {
  const auto message = [&](const std::string& jump) -> std::string {
    try {
      static_cast<void>(
          solve_problem(problem_with({"solve.ends=periodic", "solve.energy=2", "initial.q=0", "initial.p=2.5",
                                      "scheme.until=2.6", "solve.jump={ q = \"" + jump + "\" }"}),
                        {.output = Folder() / "a.h5"}));
    } catch (const ProblemError& error) {
      return error.what();
    }
    return "";
  };
  CHECK(message("2*pi").empty());
  CHECK_THAT(message("3"), Catch::Contains("H has to be the same at both ends") && Catch::Contains("cos(q)"));
}

TEST_CASE("solve: a lattice of few steps, whose breather is another one with half the step, is not good") {
  const Folder folder;
  const auto solved = [&](const std::string& steps) {
    const SolveOutcome outcome =
        solve_problem(lattice_with({"solve.steps=" + steps}), {.output = folder / "ring.h5", .overwrite = true});
    CAPTURE(outcome.message);
    REQUIRE(outcome.found());
    CHECK(check(folder / "ring.h5").judgement.verdict == outcome.judgement.verdict);
    return outcome.judgement.verdict;
  };
  CHECK(solved("8") != figures::Verdict::good);
  CHECK(solved("28") == figures::Verdict::good);  // twin
}

TEST_CASE("solve: a lattice takes a splitting, with waves of either kind") {
  const Folder folder;
  for (const char* space : {"fourier", "differences"}) {
    const std::string file = folder / (std::string(space) + ".h5");
    const SolveOutcome outcome = solve_problem(
        lattice_with({"scheme.lagrangian=splitting", fmt::format("scheme.space={}", space)}), {.output = file});
    CAPTURE(outcome.message);
    REQUIRE(outcome.status == ExitStatus::done);
    CHECK(*outcome.closing < 1e-12);  // 28 steps of a stable orbit: rounding
    CHECK(check(file).status == ExitStatus::done);
  }
  // Of turns, a plane wave: its phase goes on at the rate 2|ψ|².
  constexpr const char* turning = R"toml(title = "Condensate"
[multisymplectic]
fields = ["p", "q", "v", "w"]
M = [["p", "q", 1]]
K.x = [["p", "v", -1], ["q", "w", -1]]
S = "(v^2 + w^2)/2 + (p^2 + q^2)^2/2"
[grid]
x = { from = 0, to = 1, cells = 9 }
[initial]
p = 1
q = 0
[solve]
ends = "periodic"
steps = 32
period = 3
[scheme]
lagrangian = "splitting"
levels = "fixed"
step = 0.1
until = 3.2
)toml";
  const SolveOutcome turned = solve_problem(parse_problem(turning, "turn.toml"), {.output = folder / "turn.h5"});
  CAPTURE(turned.message);
  REQUIRE(turned.status == ExitStatus::done);
  const record::Reader reader(folder / "turn.h5");
  const std::vector<double> p = reader.read("/states/p", 0, 1), q = reader.read("/states/q", 0, 1);
  // The turn 2|ψ|²T = 2π is exact in a splitting.
  CHECK(p[0] * p[0] + q[0] * q[0] == Approx(std::numbers::pi / 3.0).epsilon(1e-12));
}

TEST_CASE("solve: a period or an energy of a lattice may be given") {
  const Folder folder;
  const auto solved = [&](const std::vector<std::string>& settings, const std::string& name) {
    return solve_problem(lattice_with(settings), {.output = folder / name});
  };
  const SolveOutcome by_period = solved({"solve.period=7.05"}, "period.h5");
  REQUIRE(by_period.status == ExitStatus::done);
  CHECK(by_period.solution.orbit.duration() == Approx(7.05).epsilon(1e-13));
  const double energy = by_period.solution.mean_energy;
  const SolveOutcome by_energy = solved({fmt::format("solve.energy={:.17g}", energy)}, "energy.h5");
  REQUIRE(by_energy.status == ExitStatus::done);
  CHECK(by_energy.solution.mean_energy == Approx(energy).epsilon(1e-12));
  // One orbit of the family has the energy.
  CHECK(by_energy.solution.orbit.duration() == Approx(7.05).epsilon(1e-8));
  const SolveOutcome free = solved({"solve.period=free"}, "free.h5");
  REQUIRE(free.status == ExitStatus::done);
  CHECK(check(folder / "energy.h5").status == ExitStatus::done);
}

TEST_CASE("solve: a travelling wave is a periodic orbit of one step in its frame, and a moving breather one of many") {
  const Folder folder;
  constexpr const char* wave = R"toml(title = "Wave"
[field]
fields = ["u"]
equation = "u_tt = u_xx - u - u^3"
[grid]
x = { from = 0, to = "2*pi", cells = 33 }
[initial]
u = "0.45*cos(x)"
u_t = "0.45*1.479*sin(x)"
[solve]
ends = "periodic"
steps = 1
[scheme]
frame = { velocity = 1.479 }
lagrangian = "fourier"
levels = "fixed"
step = 0.5
until = 0.5
)toml";
  const std::string file = folder / "wave.h5";
  REQUIRE(solve_problem(parse_problem(wave, "wave.toml"), {.output = file}).status == ExitStatus::done);
  CHECK(check(file).status == ExitStatus::done);
  // u = a cos(x - ct) + O(a³/32) where c² = 2 + 3a²/4.
  const std::vector<double> u = record::Reader(file).read("/states/u");
  CHECK(*std::ranges::max_element(u) == Approx(0.5).epsilon(0.01));
  // Twin: in the laboratory it is none.
  const std::vector<std::string> without = {"-scheme.frame"};
  const SolveOutcome none = solve_problem(parse_problem(wave, "wave.toml", without), {.output = folder / "none.h5"});
  CHECK(none.status == ExitStatus::failed);
  CHECK_THAT(none.message, Catch::Contains("state of rest"));

  // A breather of ω = 0.8 at the velocity c = 1/2: its phase is ωt/Γ - ωΓcx in its frame.
  const std::vector<std::string> moving = {
      "scheme.frame={ velocity = 0.5 }",
      "grid.x={ from = -10, to = 10, cells = 61 }",
      "initial.u=4*atan(0.75*sin(-0.4*G*x)*sech(0.6*G*x))",
      "initial.v=2.4*G*sech(0.6*G*x)*(cos(0.4*G*x) - 0.375*sin(0.4*G*x)*tanh(0.6*G*x))"
      "/(1 + (0.75*sin(0.4*G*x)*sech(0.6*G*x))^2)",
      "scheme.step=2*pi*G/0.8/40",
      "scheme.until=2*pi*G/0.8"};
  const SolveOutcome breather = solve_problem(lattice_with(moving), {.output = folder / "moving.h5"});
  CAPTURE(breather.message);
  REQUIRE(breather.status == ExitStatus::done);
  CHECK(check(folder / "moving.h5").status == ExitStatus::done);
  // -∫ u_t u_x of the first level: 16 √(1-ω²) Γ c on the line, but for the squares of ωh and of cells and the tail.
  const auto momentum = [&](const char* name) {
    const record::Reader reader(folder / name);
    const std::vector<double> u = reader.read("/states/u"), v = reader.read("/states/v");
    constexpr std::size_t nodes = 61;
    double sum = 0.0;
    for (std::size_t i = 0; i < nodes; ++i) {
      sum -= 0.5 * v[i] * (u[(i + 1) % nodes] - u[(i + nodes - 1) % nodes]);
    }
    return sum;
  };
  CHECK(momentum("moving.h5") == Approx(16.0 * 0.6 / std::sqrt(3.0)).epsilon(0.05));
  std::vector<std::string> in_laboratory = moving;
  in_laboratory[0] = "solve.max_iterations=10";
  const SolveOutcome other = solve_problem(lattice_with(in_laboratory), {.output = folder / "rest.h5"});
  CHECK((other.status == ExitStatus::failed || std::abs(momentum("rest.h5")) < 0.1));  // twin
}

TEST_CASE("solve: wrong entries of a lattice are refused with their place and a remedy") {
  CHECK_THAT(lattice_error({"scheme.levels=variable"}), Catch::Contains("write levels = \"fixed\""));
  CHECK_THAT(lattice_error({"scheme.stages=2"}), Catch::Contains("one stage"));
  CHECK_THAT(lattice_error({"scheme.lagrangian=euler-box"}), Catch::Contains("box and fourier"));
  CHECK_THAT(lattice_error({"solve.ends=connection"}), Catch::Contains("ends = \"periodic\""));
  CHECK_THAT(lattice_error({"solve.guess={ u = 1 }"}), Catch::Contains("guess is for orbits of [hamiltonian]"));
  CHECK_THAT(lattice_error({"solve.energy=initial"}), Catch::Contains("give a number"));
  CHECK_THAT(lattice_error({"solve.time=7"}), Catch::Contains("write period"));
  CHECK_THAT(lattice_error({"solve.period=-7"}), Catch::Contains("the sign of until - t"));
  CHECK_THAT(lattice_error({"grid.x.cells=1001"}), Catch::Contains("too many to solve for at once"));
  CHECK_THAT(lattice_error({"scheme.lagrangian=fourier", "grid.x.left=fixed", "grid.x.right=fixed"}),
             Catch::Contains("on rings"));
  CHECK_THAT(lattice_error({"solve.perod=7"}), Catch::Contains("did you mean period"));
  const Folder folder;
  const SolveOutcome none = solve_problem(lattice_with({"solve.energy=-5"}), {.output = folder / "none.h5"});
  CHECK(none.status == ExitStatus::failed);
  CHECK_THAT(none.message, Catch::Contains("the residual is") && Catch::Contains("nothing was written"));
  CHECK_FALSE(std::filesystem::exists(folder.path() / "none.h5"));
}
