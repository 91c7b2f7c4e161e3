// [grid] jump: fields that differ by a constant from one period to the next, by the change of variables of Jumps.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/converge.hpp>
#include <rubato/run/run.hpp>

#include "problem_texts.hpp"
#include "records.hpp"
#include "run/mailboxes.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

/// One sine-Gordon kink on the ring: u = π + 2 am(γ(x - ct)/√m, m) solves u_tt = u_xx - sin u, and grows by 2π over
/// L = 2√m K(m)/γ. The ring can begin anywhere, at x_0.
constexpr const char* kink = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + 1 - cos(u)"
[parameters]
m = 0.9
c = 0.5
g = "1/sqrt(1 - c^2)"
L = "2*sqrt(m)*ellipk(m)/g"
x_0 = "-L/2"
[grid]
x = { from = "x_0", to = "x_0 + L", cells = 41, jump = { u = "2*pi" } }
[initial]
u = "pi + 2*am(g*x/sqrt(m), m)"
v = "-c*dx(u)"
[exact]
u = "pi + 2*am(g*(x - c*t)/sqrt(m), m)"
w = "2*g/sqrt(m)*dn(g*(x - c*t)/sqrt(m), m)"
[invariants]
charge = "w/(2*pi)"
momentum_of_u = "v*dx(u)"
energy_of_u = "v^2/2 + dx(u)^2/2 + 1 - cos(u)"
[scheme]
lagrangian = "box"
levels = "fixed"
step = 0.05
until = 2
)toml";

/// An action of the corners of a cell, with S at the mean of its values.
constexpr const char* stated_action =
    "scheme.L=((u_10 + u_11 - u_00 - u_01)/(2*h))^2/2 - ((u_01 + u_11 - u_00 - u_10)/(2*dx))^2/2 - 1 + "
    "cos((u_00 + u_01 + u_10 + u_11)/4)";

Problem problem_of(const Settings& settings) {
  return parse_problem(kink, "kink.toml", settings);
}

Outcome outcome_of(const Settings& settings) {
  const Folder folder;
  Outcome outcome = run(problem_of(settings), {.output = folder / "a.h5", .threads = 1});
  REQUIRE(outcome.complete);
  return outcome;
}

double error_of(const Settings& settings) {
  return outcome_of(settings).statistics.errors.front().value.largest();
}

const figures::Deviation& invariant(const Outcome& outcome, const std::string& name) {
  const auto& all = outcome.statistics.invariants;
  const auto found = std::ranges::find(all, name, &figures::Named<figures::Deviation>::name);
  REQUIRE(found != all.end());
  return found->value;
}

std::string message(const Settings& settings, const std::string& text = kink) {
  return refusal(text, "kink.toml", settings);
}

}  // namespace

TEST_CASE("a kink alone on the ring has the order of each scheme") {
  struct Case {
    Settings scheme;
    double order;
    std::string cells;  ///< with h as many times smaller
    double step = 0.05;
  };
  const std::vector<Case> cases = {
      {{"scheme.lagrangian=box"}, 2.0, "81"},
      {{"scheme.lagrangian=box", "scheme.stages=2", "scheme.space_stages=3", "grid.x.cells=63"}, 4.0, "123", 0.2},
      {{"scheme.lagrangian=fourier", "grid.x.cells=64"}, 2.0, "64"},
      {{"scheme.lagrangian=fourier", "scheme.stages=2", "grid.x.cells=80"}, 4.0, "80", 0.2},
      {{"scheme.lagrangian=euler-box", "grid.x.cells=82"}, 1.0, "164", 0.025},
      {{"scheme.lagrangian=leapfrog"}, 2.0, "82"},
      {{"scheme.lagrangian=splitting", "grid.x.cells=64"}, 2.0, "64"},
      {{"scheme.lagrangian=splitting", "scheme.space=differences"}, 2.0, "82"},
      {{"scheme.lagrangian=splitting", "scheme.composition=blanes-moan-4", "grid.x.cells=80"}, 4.0, "80", 0.4},
      {{"scheme.lagrangian=custom", stated_action}, 2.0, "81"},
  };
  for (const Case& one : cases) {
    INFO(fmt::format("{}", one.scheme.back()));
    const auto error = [&](double step, const Settings& more) {
      return error_of(joined(joined(one.scheme, {fmt::format("scheme.step={}", step)}), more));
    };
    const double coarse = error(one.step, {}), fine = error(one.step / 2.0, {"grid.x.cells=" + one.cells});
    INFO("errors " << coarse << ", " << fine);
    CHECK(std::log2(coarse / fine) == Approx(one.order).margin(0.25));
    // The twin: half of what the data do, so that they are torn at the seam.
    CHECK(error(one.step, {"grid.x.jump.u=0"}) > 0.1);
  }
}

TEST_CASE("a field that S does not name jumps and turns like any other") {
  struct Case {
    std::string equation, jump, initial, exact;
    Settings schemes;
  };
  const Case one = GENERATE(Case{"u_tt = u_xx",
                                 "jump = { u = 3 }",
                                 "u = \"3*x/L + cos(k*x)\"\nu_t = 0.2",
                                 "u = \"3*x/L + 0.2*t + cos(k*x)*cos(k*t)\"",
                                 {"box", "fourier", "splitting", "leapfrog"}},
                            Case{"i*psi_t + psi_xx = 0",
                                 "phase = { psi = \"2*pi/3\" }",
                                 "psi = \"exp(i*k*x/3)\"",
                                 "p = \"cos(k*x/3 - k^2/9*t)\"\nq = \"sin(k*x/3 - k^2/9*t)\"",
                                 {"box", "fourier", "splitting"}});
  for (const std::string& scheme : one.schemes) {
    INFO(one.equation << ", " << scheme);
    const auto error = [&](const std::string& jump) {
      const Folder folder;
      const Outcome outcome =
          run(parse_problem(
                  "[field]\nequation = \"" + one.equation +
                      "\"\n[parameters]\nL = 7\nk = \"2*pi/L\"\n[grid]\nx = { from = 0, to = \"L\", cells = 65, " +
                      jump + " }\n[initial]\n" + one.initial + "\n[exact]\n" + one.exact +
                      "\n[scheme]\nlagrangian = \"" + scheme + "\"\nstep = 0.05\nuntil = 2\n",
                  "jump.toml"),
              {.output = folder / "a.h5", .threads = 1});
      REQUIRE(outcome.complete);
      CHECK(check(folder / "a.h5").status == ExitStatus::done);
      return outcome.statistics.errors.front().value.largest();
    };
    // The phase error of order 2 over the time 2, of waves with the frequency k in time and on the cells.
    const double k = 2.0 * std::numbers::pi / 7.0, cell = 7.0 / 65.0;
    CHECK(error(one.jump) < 2.0 * k * k * k * (0.05 * 0.05 + cell * cell) / 12.0);
    // The twin: torn at the seam.
    CHECK(error(one.jump.starts_with("jump") ? "jump = { u = 0 }" : "phase = { psi = 0 }") > 0.1);
  }
}

TEST_CASE("where the ring begins makes no difference") {
  // Seven cells further the same nodes are reported; those that are behind the seam now are reported a turn later.
  for (const char* scheme : {"box", "leapfrog", "euler-box", "fourier", "splitting"}) {
    INFO(scheme);
    const Folder folder;
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme), "scheme.until=1"};
    static_cast<void>(run(problem_of(settings), {.output = folder / "a.h5", .threads = 1}));
    static_cast<void>(
        run(problem_of(joined(settings, {"parameters.x_0=-L/2 + 7*L/41"})), {.output = folder / "b.h5", .threads = 1}));
    const std::vector<double> a = last_row(record::Reader(folder / "a.h5"), "/states/u");
    std::vector<double> b = last_row(record::Reader(folder / "b.h5"), "/states/u");
    std::ranges::rotate(b, b.end() - 7);
    for (std::size_t i = 0; i < 7; ++i) {
      b[i] -= 2.0 * std::numbers::pi;
    }
    // 20 steps, each solved to some roundings of numbers of 10.
    CHECK(largest_distance(a, b) < 1e-11);
    b[3] += 2.0 * std::numbers::pi;
    CHECK(largest_distance(a, b) > 6.0);
  }
}

TEST_CASE("energy, momentum and charge of a kink alone are those of the whole field") {
  for (const char* scheme : {"box", "fourier", "leapfrog", "splitting"}) {
    INFO(scheme);
    const Outcome outcome = outcome_of({fmt::format("scheme.lagrangian={}", scheme), "scheme.levels=variable",
                                        "scheme.until=10", "scheme.step=0.02", "grid.x.cells=101"});
    CHECK(outcome.judgement.verdict == figures::Verdict::good);
    CHECK(outcome.statistics.relative_energy_deviation().value() < 1e-13);
    // Differences err by Δx²: the density of the kink, squared.
    const double tolerance = std::string(scheme) == "box" || std::string(scheme) == "leapfrog" ? 2e-3 : 1e-9;
    CHECK(outcome.statistics.node_energy.initial ==
          Approx(invariant(outcome, "energy_of_u").initial).epsilon(tolerance));
    CHECK(invariant(outcome, "charge").initial == Approx(1.0).epsilon(tolerance));
    CHECK(invariant(outcome, "charge").max() < 1e-12);
    const auto& totals = outcome.statistics.totals;
    REQUIRE(totals.size() == 1);
    CHECK(totals.front().name == "momentum");
    CHECK(totals.front().value.initial == Approx(invariant(outcome, "momentum_of_u").initial).epsilon(tolerance));
  }
  // The momentum of a translation is conserved where space is treated as it is: to rounding, and not by the ramp alone.
  const Outcome fourier = outcome_of({"scheme.lagrangian=fourier", "scheme.until=10", "grid.x.cells=80"});
  CHECK(fourier.statistics.totals.front().value.max() < 1e-12);
  // The twin: of the field without its ramp it is another number, which is not conserved.
  const Problem problem = problem_of({"scheme.lagrangian=fourier"});
  MultisymplecticSystem system = make_system(problem);
  CHECK(system.ramps().size() == 1);
  CHECK_FALSE(system.has_source(0));
  const MultisymplecticSystem twin(system.graph(), system.fields(), system.M(), {system.K(0)}, system.expression());
  CHECK(twin.has_source(0));
}

TEST_CASE("local laws of a kink alone are those of one of two on a longer ring") {
  // Two kinks on the line from 0 to 2L, whose jump is 4π, do the same twice.
  for (const char* scheme : {"box", "leapfrog", "euler-box", "fourier"}) {
    INFO(scheme);
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme), "scheme.until=1"};
    const bool needs_odd = std::string(scheme) == "box";
    const Settings one = joined(settings, {needs_odd ? "grid.x.cells=41" : "grid.x.cells=40"});
    const Settings many = joined(settings, {needs_odd ? "grid.x.cells=123" : "grid.x.cells=80",
                                            needs_odd ? "grid.x.to=x_0 + 3*L" : "grid.x.to=x_0 + 2*L",
                                            needs_odd ? "grid.x.jump.u=6*pi" : "grid.x.jump.u=4*pi"});
    const Outcome a = outcome_of(one), b = outcome_of(many);
    REQUIRE(a.statistics.residuals.size() == b.statistics.residuals.size());
    for (std::size_t law = 0; law < a.statistics.residuals.size(); ++law) {
      INFO(a.statistics.residuals[law].name);
      CHECK(a.statistics.residuals[law].name == b.statistics.residuals[law].name);
      // Rounding of a residual is that of densities over the step or the spacing.
      CHECK(a.statistics.residuals[law].value.max == Approx(b.statistics.residuals[law].value.max).margin(1e-10));
    }
    const double times = needs_odd ? 3.0 : 2.0;
    CHECK(times * a.statistics.totals.front().value.initial ==
          Approx(b.statistics.totals.front().value.initial).epsilon(1e-11));
  }
}

TEST_CASE("a medium beside a jump has its own source of momentum, and nothing of the ramp") {
  const std::string medium = with(kink, "1 - cos(u)\"", "(1 + cos(2*pi*x/L)/5)*(1 - cos(u))\"");
  const auto residuals = [&](const Settings& settings) {
    const Folder folder;
    return run(parse_problem(medium, "medium.toml", settings), {.output = folder / "a.h5", .threads = 1})
        .statistics.residuals;
  };
  for (const char* scheme : {"box", "euler-box", "fourier"}) {
    INFO(scheme);
    const auto largest = [&](int cells, double step) {
      const auto found = residuals({fmt::format("scheme.lagrangian={}", scheme), fmt::format("grid.x.cells={}", cells),
                                    fmt::format("scheme.step={}", step), "scheme.until=0.5"});
      const auto law = std::ranges::find_if(found, [](const auto& one) { return one.name == "momentum_balance"; });
      REQUIRE(law != found.end());
      return law->value.max;
    };
    // A source that is not right leaves a residual that no refinement takes away.
    const double coarse = largest(61, 0.02), fine = largest(123, 0.01);
    CHECK((fine < 1e-8 || fine < 0.62 * coarse));
  }
}

TEST_CASE("records of a jump have the whole field; check, resume and initial data of a record know of it") {
  const Folder folder;
  for (const char* scheme : {"box", "fourier", "leapfrog", "euler-box", "splitting"}) {
    INFO(scheme);
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme),
                               "scheme.until=1",
                               "output.every=3",
                               "output.times=[0.33]",
                               "output.quantities={ there = { formula = \"u\", at = { x = 0.5 } }, "
                               "slope = \"integral(dx(u))\" }",
                               "events={ half = { crossing = \"u - pi\", at = { x = 0.1 } } }"};
    static_cast<void>(run(problem_of(settings), {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
    const record::Reader reader(folder / "a.h5");
    const double t = reader.read("/states/t").back();
    const double g = 1.0 / std::sqrt(0.75), period = reader.read("/grid/x").back() - reader.read("/grid/x").front();
    CHECK(period > 4.0);
    CHECK(largest_distance(last_row(reader, "/states/u"), last_row(reader, "/exact/u")) < 0.05 * (1.0 + t));
    CHECK(reader.read("/output/quantities/slope").front() == Approx(2.0 * std::numbers::pi).epsilon(1e-12));
    // u = π + 2γ(x - ct)/√m about where it is π; the next term is smaller by the square of that.
    CHECK(reader.read("/output/quantities/there").front() ==
          Approx(std::numbers::pi + 2.0 * g * (0.5 - 0.5 * 0.33) / std::sqrt(0.9)).margin(0.1));
    REQUIRE(reader.read("/events/half/t").size() == 1);
    CHECK(reader.read("/events/half/t").front() == Approx(0.2).margin(0.03));
    CHECK(check(folder / "a.h5").status == ExitStatus::done);

    static_cast<void>(run(problem_of(joined(settings, {"scheme.until=0.5"})),
                          {.output = folder / "part.h5", .overwrite = true, .threads = 1}));
    static_cast<void>(resume(folder / "part.h5", 1.0));
    CHECK(record::Reader(folder / "part.h5").read("/levels/node_energy") == reader.read("/levels/node_energy"));
  }
  falsify(folder / "a.h5", "/states/u", 60, 1e-9);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
}

TEST_CASE("data of a record with a jump go on, with other cells, too") {
  const Folder folder;
  static_cast<void>(run(problem_of({"scheme.lagrangian=fourier", "grid.x.cells=64", "scheme.until=0.5"}),
                        {.output = folder / "a.h5", .threads = 1}));
  const std::string from = with(
      with(kink, "u = \"pi + 2*am(g*x/sqrt(m), m)\"\nv = \"-c*dx(u)\"", fmt::format("from = \"{}\"", folder / "a.h5")),
      "box", "fourier");
  for (const char* cells : {"64", "80"}) {
    const Folder here;
    const Outcome outcome = run(parse_problem(from, "b.toml", Settings{fmt::format("grid.x.cells={}", cells)}),
                                {.output = here / "b.h5", .threads = 1});
    CHECK(outcome.status == ExitStatus::done);
    CHECK(outcome.statistics.errors.front().value.largest() < 2e-2);
    CHECK(check(here / "b.h5").status == ExitStatus::done);
  }
}

TEST_CASE("ranks share a lattice with a jump, along it and across") {
  for (const char* axis : {"x", "y"}) {
    INFO(axis);
    const Folder folder;
    const bool along_x = std::string(axis) == "x";
    Settings settings = {fmt::format("grid.{}.jump.u=2*pi", axis), "output.every=5",
                         along_x ? "initial.u=pi*(x + 1)/3 + sin(pi*x/3)*exp(cos(2*pi*(y - 0.3)/6.7))"
                                 : "initial.u=2*pi*(y - 0.3)/6.7 + sin(pi*x/3)*exp(cos(2*pi*(y - 0.3)/6.7))"};
    for (const Settings& scheme : {Settings{"scheme.lagrangian=euler-box"},
                                   {"scheme.lagrangian=leapfrog"},
                                   {"scheme.lagrangian=splitting"},
                                   {"scheme.lagrangian=fourier", "scheme.frame.velocity=[0.4, -0.3]"}}) {
      INFO(fmt::format("{}", fmt::join(scheme, " ")));
      Settings more = joined(settings, scheme);
      more.insert(more.begin(), "invariants={ mass = \"sin(u)^2 + b\" }");
      const Problem problem = wave_on_torus(20, 15, more);
      const Outcome one = run(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
      REQUIRE(one.status == ExitStatus::done);
      const Outcome all = with_ranks(3, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
      REQUIRE(all.status == ExitStatus::done);
      CHECK(largest_distance(record::Reader(folder / "one.h5").read("/states/u"),
                             record::Reader(folder / "all.h5").read("/states/u")) < 1e-11);
      CHECK(check(folder / "all.h5").status == ExitStatus::done);
    }
  }
}

TEST_CASE("jumps are refused where they are none, with place, term and remedy") {
  CHECK(message({}).empty());
  CHECK_THAT(message({"grid.x.jump.u=3"}),
             Contains("S has to be the same") && Contains("u -> u + 3") && Contains("cos(u)") && Contains("leave"));
  CHECK_THAT(message({}, with(kink, "jump = { u = \"2*pi\" }", "jump = { u = 1 }")), Contains("kink.toml:14:"));
  CHECK_THAT(message({"grid.x.jump.v=1"}), Contains("v -> v + 1") && Contains("v^2"));
  CHECK_THAT(message({"grid.x.jump.w=1"}), Contains("w cannot jump") && Contains("no equation of motion"));
  CHECK_THAT(message({"grid.x.jump.U=1"}), Contains("not a field"));
  CHECK_THAT(message({"grid.x.jump={}"}), Contains("names no field"));
  CHECK_THAT(message({"invariants.charge=u*v"}), Contains("invariant") && Contains("u*v"));
  CHECK(message({"invariants.charge=cos(u)*v"}).empty());
  // A piece that is 0 at the points where others differ, and one that goes round with u.
  CHECK_THAT(message({"invariants.charge=max(0, u - 20)*v"}), Contains("invariant") && Contains("max(0, u - 20)"));
  CHECK(message({"invariants.charge=abs(u - 2*pi*floor(u/(2*pi)) - pi)*v"}).empty());
  CHECK_THAT(message({"scheme.lagrangian=custom", std::string(stated_action) + " + u_00/100"}),
             Contains("L has to be the same") && Contains("u_00"));
  const std::string kdv =
      "[multisymplectic]\nequation = \"kdv\"\n[grid]\nx = { from = 0, to = 6, cells = 31, jump = { "
      "phi = 1 } }\n[initial]\nu = \"cos(pi*x/3)\"\n[scheme]\nlagrangian = \"box\"\nlevels = "
      "\"fixed\"\nstep = 0.01\nuntil = 0.1\n";
  CHECK_THAT(message({}, kdv), Contains("phi cannot jump") && Contains("mean slope"));
}

TEST_CASE("a jump that the data do not have is told of") {
  const auto warnings = [](const Settings& settings) {
    const Folder folder;
    return run(problem_of(joined({"scheme.until=0.1"}, settings)), {.output = folder / "a.h5", .threads = 1}).warnings;
  };
  const auto tells = [](const std::vector<std::string>& all) {
    return std::ranges::any_of(all, [](const std::string& one) { return one.find("not periodic") != one.npos; });
  };
  CHECK_FALSE(tells(warnings({"grid.x.cells=101"})));
  CHECK(tells(warnings({"grid.x.cells=101", "grid.x.jump.u=4*pi"})));
}

TEST_CASE("a field that is rounding errors alone does not break at the seam") {
  const auto breaks = [](const std::string& u_t) {
    const Folder folder;
    const std::string at_rest =
        "[field]\nequation = \"u_tt = u_xx - sin(u)\"\n[grid]\nx = { from = -20, to = 20, cells = 201, jump = { u = "
        "\"2*pi\" } }\n[initial]\nu = \"4*atan(exp(x))\"\nu_t = \"" +
        u_t + "\"\n[scheme]\nlagrangian = \"fourier\"\nlevels = \"fixed\"\nstep = 0.1\nuntil = 3\n";
    const auto reasons =
        run(parse_problem(at_rest, "t.toml"), {.output = folder / "a.h5", .threads = 1}).judgement.reasons;
    return std::ranges::find(reasons, figures::ReasonKind::period, &figures::Reason::kind) != reasons.end();
  };
  CHECK_FALSE(breaks("0"));
  CHECK(breaks("0.1*exp(x/20)"));
}
