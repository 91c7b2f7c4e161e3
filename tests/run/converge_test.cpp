// How accurate is it? Runs with halves and quarters of the step, and of the spacings.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/converge.hpp>

#include "problem/problem_texts.hpp"

using namespace rubato;
using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;

namespace {

std::string refusal(const std::string& text, const std::vector<std::string>& settings) {
  try {
    static_cast<void>(converge(parse_problem(text, "t.toml", settings), std::nullopt));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE(
    "the estimate of an orbit's error is its error, and the order that of its scheme, with both kinds of levels") {
  // The end by Gauss of order 12, whose own error at this step is rounding.
  const std::vector<std::string> exact = {"scheme.lagrangian=gauss", "scheme.stages=6", "scheme.levels=fixed"};
  OrbitIntegrator reference = make_integrator(parse_problem(pendulum, "t.toml", exact));
  while (reference.t() < 10.0 - 1e-9) {
    REQUIRE(reference.step().status == Status::success);
  }
  // With levels of its own the midpoint scheme: a step potential would be chosen anew for every first step.
  for (const std::string levels : {"fixed", "variable"}) {
    for (const int stages : {1, 2}) {
      INFO(levels << ", " << stages);
      if (levels == "variable" && stages > 1) {
        continue;
      }
      std::vector<std::string> settings = {"scheme.levels=" + levels};
      if (levels == "fixed") {
        settings.insert(settings.end(), {"scheme.lagrangian=gauss", "scheme.stages=" + std::to_string(stages)});
      }
      const Problem problem = parse_problem(pendulum, "t.toml", settings);
      const ConvergenceOutcome outcome = converge(problem, 1e-8);
      REQUIRE(outcome.status == ExitStatus::done);
      REQUIRE(outcome.quantities.size() == 2);
      for (const Convergence& quantity : outcome.quantities) {
        REQUIRE(quantity.step.order());
        CHECK(*quantity.step.order() == Approx(2.0 * stages).margin(0.2));
        CHECK_FALSE(quantity.grid);
      }
      // At equal steps the last level is the end itself.
      if (levels == "fixed") {
        OrbitIntegrator orbit = make_integrator(problem);
        while (orbit.t() < 10.0 - 1e-9) {
          REQUIRE(orbit.step().status == Status::success);
        }
        const double error = std::abs(orbit.q()[0] - reference.q()[0]);
        // Richardson's estimate is off by h² of itself, with constants of some tens over ten time units.
        CHECK(outcome.quantities[0].step.error() == Approx(error).epsilon(0.1));
      }
      REQUIRE(outcome.step_for_tolerance);
      CHECK(*outcome.step_for_tolerance < 0.1);
    }
  }
}

TEST_CASE("a lattice's errors by its step and by its grid are told apart") {
  const std::string text = replaced(replaced(breather, "until = 20", "until = 1"),
                                    "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", "");
  const auto outcome_of = [&](const std::vector<std::string>& settings) {
    return converge(parse_problem(text, "t.toml", settings), std::nullopt);
  };
  const ConvergenceOutcome fine_step = outcome_of({"scheme.step=0.02", "grid.x.cells=151"});
  REQUIRE(fine_step.quantities.size() == 3);
  for (const Convergence& quantity : fine_step.quantities) {
    INFO(quantity.name);
    REQUIRE(quantity.grid);
    CHECK(quantity.step.order().value() == Approx(2.0).margin(0.2));
    CHECK(quantity.grid->order().value() == Approx(2.0).margin(0.3));
    CHECK(quantity.grid->error() > 3.0 * quantity.step.error());
  }
  CHECK_THAT(to_json(fine_step), Contains("\"dominant\": \"grid\""));
  // The twin: Fourier resolves the breather on this grid, and the step is all there is.
  const ConvergenceOutcome coarse_step =
      outcome_of({"scheme.lagrangian=fourier", "scheme.step=0.1", "grid.x.cells=151"});
  CHECK(coarse_step.quantities[0].step.error() > 10.0 * coarse_step.quantities[0].grid->error());
  CHECK_THAT(to_json(coarse_step), Contains("\"dominant\": \"step\"") && !Contains(": nan"));
}

TEST_CASE("elements stay odd in number when a lattice's spacings are halved, and show their order") {
  const std::string text = replaced(replaced(breather, "until = 20", "until = 1"),
                                    "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", "");
  // Steps whose error is far below that of the cells.
  for (const int space_stages : {1, 3}) {
    const std::vector<std::string> settings = {"grid.x.cells=141", "scheme.step=0.1", "scheme.stages=4",
                                               "scheme.levels=fixed",
                                               "scheme.space_stages=" + std::to_string(space_stages)};
    const ConvergenceOutcome outcome = converge(parse_problem(text, "t.toml", settings), std::nullopt);
    INFO(space_stages);
    REQUIRE(outcome.status == ExitStatus::done);
    REQUIRE(outcome.quantities[0].grid);
    REQUIRE(outcome.quantities[0].grid->order());
    CHECK(*outcome.quantities[0].grid->order() == Approx(2.0 * space_stages).margin(0.4));
  }
}

TEST_CASE("convergence that cannot be measured is refused, or told") {
  CHECK_THAT(refusal(pendulum, {"scheme.step=auto", "scheme.energy_tolerance=1e-3"}), Contains("give it as a number"));
  CHECK_THAT(refusal(pendulum + "[ensemble]\ngrid = { initial.p = [1, 2] }\n", {}), Contains("leave [ensemble] out"));
  const ConvergenceOutcome stopped =
      converge(parse_problem(pendulum, "t.toml", std::vector<std::string>{"scheme.max_steps=150"}), std::nullopt);
  CHECK(stopped.status == ExitStatus::failed);
  CHECK_THAT(stopped.message, Contains("of the step: max_steps"));
  // A free particle has no error: nothing is said of an order.
  const ConvergenceOutcome free = converge(parse_problem(replaced(pendulum, "p^2/2 - cos(q)", "p^2/2"), "t.toml",
                                                         std::vector<std::string>{"scheme.levels=fixed"}),
                                           1e-6);
  REQUIRE(free.status == ExitStatus::done);
  CHECK_FALSE(free.quantities[0].step.order());
  CHECK_FALSE(free.step_for_tolerance);
  CHECK_THAT(to_table(free), Contains("rounding") && Contains("cannot be said"));
}

TEST_CASE("what is wanted of a run converges as its states do") {
  // With an interval, and with states or without: converge looks at the end.
  const std::string quantities = R"toml([output]
interval = 0.3
states = false
[output.quantities]
twice = "2*q"
p = "3*q"
minus = "3 - p"
nowhere = "log(q - 100)"
)toml";
  const ConvergenceOutcome outcome =
      converge(parse_problem(pendulum + quantities, "t.toml", std::vector<std::string>{"scheme.levels=fixed"}), 1e-6);
  REQUIRE(outcome.status == ExitStatus::done);
  const auto of = [&outcome](const std::string& name) {
    return *std::ranges::find(outcome.quantities, name, &Convergence::name);
  };
  REQUIRE(outcome.quantities.size() == 6);
  CHECK(of("output.quantities.p").step.error() == Approx(3.0 * of("q").step.error()).epsilon(1e-9));
  CHECK(of("q").step.order().value() == Approx(2.0).margin(0.2));
  CHECK(of("twice").step.error() == 2.0 * of("q").step.error());  // the twin: not the error of q itself
  CHECK(of("twice").size == 2.0 * of("q").size);
  CHECK(of("minus").step.error() == Approx(of("p").step.error()).epsilon(1e-9));
  CHECK_FALSE(of("nowhere").step.order());
  CHECK_THAT(to_table(outcome), Contains("not defined"));
  CHECK_THAT(to_json(outcome), !Contains("nan"));
  const ConvergenceOutcome without = converge(
      parse_problem(pendulum, "t.toml", std::vector<std::string>{"scheme.levels=fixed", "output.every=3"}), 1e-6);
  CHECK(without.quantities.size() == 2);
  CHECK(without.quantities[0].step.error() == of("q").step.error());

  const std::string lattice = replaced(replaced(breather, "until = 20", "until = 1"),
                                       "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", "");
  const ConvergenceOutcome reported = converge(
      parse_problem(lattice, "t.toml",
                    std::vector<std::string>{"scheme.step=0.1", "grid.x.cells=101", "output.interval=0.5",
                                             "output.quantities.twice=2*u", "output.quantities.all=integral(u)",
                                             "output.quantities.probe={ formula = \"u\", at = { x = 0 } }"}),
      std::nullopt);
  REQUIRE(reported.status == ExitStatus::done);
  REQUIRE(reported.quantities.size() == 6);
  for (const Convergence& quantity : reported.quantities) {
    INFO(quantity.name);
    REQUIRE(quantity.grid);
    CHECK(quantity.step.order().value() == Approx(2.0).margin(0.2));
    CHECK(quantity.grid->order().value() == Approx(2.0).margin(0.4));
  }
  const auto u = std::ranges::find(reported.quantities, "u", &Convergence::name);
  const auto twice = std::ranges::find(reported.quantities, "twice", &Convergence::name);
  CHECK(twice->grid->error() == Approx(2.0 * u->grid->error()).epsilon(1e-9));
}

TEST_CASE("an exact solution that differs by more than the errors of step and grid is reported") {
  const auto of = [](const std::string& factor) {
    return converge(
        parse_problem(breather, "t.toml",
                      std::vector<std::string>{"exact.u=4*atan(" + factor + "*gamma/omega*sin(omega*t)*sech(gamma*x))",
                                               "scheme.until=2", "grid.x.cells=101", "-symmetries"}),
        std::nullopt);
  };
  const ConvergenceOutcome right = of("1"), wrong = of("1.1");
  for (const ConvergenceOutcome* outcome : {&right, &wrong}) {
    REQUIRE(outcome->status == ExitStatus::done);
    CHECK(outcome->quantities[0].exact);
    CHECK_THAT(to_table(*outcome), Contains("from [exact]"));
  }
  CHECK(right.quantities[0].explains_exact());
  CHECK(to_json(right).find("does not solve") == std::string::npos);
  CHECK_FALSE(wrong.quantities[0].explains_exact());
  CHECK_THAT(to_json(wrong), Contains("[exact] does not solve the problem: u differs from it by"));
}

TEST_CASE("a step that is too long for finer grids is refined with them") {
  const auto of = [](double step) {
    return converge(parse_problem("[field]\nequation = \"u_tt = u_xx - sin(u)\"\n[grid]\n"
                                  "x = { from = 0, to = 20, cells = 100 }\n[initial]\n"
                                  "u = \"exp(-(x - 10)^2)\"\nu_t = \"0\"\n[scheme]\nlagrangian = \"leapfrog\"\n"
                                  "levels = \"fixed\"\nuntil = 3\n",
                                  "t.toml", std::vector<std::string>{"scheme.step=" + std::to_string(step)}),
                    std::nullopt);
  };
  // The limit is h = Δx, here 0.2: with a quarter of the spacings it is 0.05.
  for (const double step : {0.1, 0.04}) {
    INFO(step);
    const ConvergenceOutcome outcome = of(step);
    REQUIRE(outcome.ended);
    CHECK(outcome.findings.verdict() == figures::Verdict::good);
    CHECK(outcome.grid_step == (step == 0.1 ? 0.25 * step : step));
    CHECK((to_table(outcome).find("quarter of the step") != std::string::npos) == (step == 0.1));
    for (const Convergence& quantity : outcome.quantities) {
      CHECK(quantity.grid->order().value() == Approx(2.0).margin(0.3));
    }
  }
}

TEST_CASE("errors as large as the quantity itself are no estimates, and the verdict is doubtful") {
  // A plane wave that is unstable: a rounding error of the start is of size 1 at the end.
  const auto of = [](double until) {
    return converge(parse_problem("[field]\nequation = \"i*psi_t + psi_xx + 2*abs2(psi)*psi = 0\"\n[grid]\n"
                                  "x = { from = 0, to = \"2*pi*sqrt(2)\", cells = 65 }\n[initial]\n"
                                  "psi = \"1 + 1e-4*cos(x/sqrt(2))\"\n[scheme]\nlagrangian = \"splitting\"\n"
                                  "step = 0.02\nuntil = 30\n",
                                  "t.toml"),
                    std::nullopt, {}, {.until = until, .grids = false});
  };
  const ConvergenceOutcome late = of(30), early = of(3);
  CHECK_THAT(to_json(late), Contains("\"verdict\": \"doubtful\"") && Contains("\"resolution\""));
  CHECK_THAT(to_table(late), Contains("doubtful (of 3 runs: 2 good, 1 doubtful, 0 lost)"));
  CHECK_THAT(to_table(early), Contains("good (of 3 runs: 3 good, 0 doubtful, 0 lost)"));
}

TEST_CASE("a state at the end that could not be solved for is no good verdict", "[run]") {
  // The mean of sin(u) along x is that of the force, which vanishes at odd multiples of 1/80, where all whole steps
  // have their middles. The whole of the step, shortened to the end, has its own at .925, where no u has the force's
  // mean.
  const auto of = [](const std::string& force) {
    return converge(parse_problem("[field]\nequation = \"u_xt = sin(u) + " + force +
                                      "*t*cos(40*pi*t)^2\"\n[grid]\nx = { from = 0, to = \"2*pi\", cells = 17 }\n"
                                      "[initial]\nu = \"sin(x)\"\n[scheme]\nlagrangian = \"box\"\nstages = 1\n"
                                      "levels = \"variable\"\nstep = 0.1\nuntil = 0.95\n",
                                  "t.toml"),
                    std::nullopt);
  };
  const ConvergenceOutcome outcome = of("0.9");
  CHECK(outcome.status == ExitStatus::failed);
  CHECK_THAT(outcome.message, Contains("could not be solved"));
  for (const std::string& warning : outcome.findings.warnings("runs")) {
    CHECK_THAT(warning, !Contains("[output.quantities]"));  // of which there is none
  }
  CHECK(of("0.001").status == ExitStatus::done);
}
