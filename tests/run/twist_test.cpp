// [grid] phase: complex fields that turn by an angle from one period to the next, by the change of variables of Twists.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

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

/// A Bloch wave of Schroedinger's equation: psi = dn(x - ct, m) exp(i(cx/2 + (2 - m - c²/4)t)) solves i psi_t + psi_xx
/// + 2|psi|²psi = 0, and turns by cL/2 over the period L = 2K(m) of |psi|. The ring can begin anywhere, at x_0.
constexpr const char* bloch_wave = R"toml(
[multisymplectic]
fields = ["p", "q", "v", "w"]
M = [["p", "q", 1]]
K.x = [["p", "v", -1], ["q", "w", -1]]
S = "(v^2 + w^2)/2 + (p^2 + q^2)^2/2"
[parameters]
m = 0.7
c = 0.35
L = "2*ellipk(m)"
x_0 = 0
[grid]
x = { from = "x_0", to = "x_0 + L", cells = 41, phase = { charge = "c*L/2" } }
[initial]
p = "dn(x, m)*cos(c*x/2)"
q = "dn(x, m)*sin(c*x/2)"
[exact]
p = "dn(x - c*t, m)*cos(c*x/2 + (2 - m - c^2/4)*t)"
q = "dn(x - c*t, m)*sin(c*x/2 + (2 - m - c^2/4)*t)"
[symmetries]
charge = [["p", "q", -1], ["q", "p", 1], ["v", "w", -1], ["w", "v", 1]]
[invariants]
mass = "p^2 + q^2"
current = "p*dx(q) - q*dx(p)"
energy_of_psi = "(dx(p)^2 + dx(q)^2)/2 - (p^2 + q^2)^2/2"
[scheme]
lagrangian = "box"
levels = "fixed"
step = 0.02
until = 1
)toml";

/// An action of the corners of a cell, ½ p q_t - ½ q p_t + v p_x + w q_x - S at their means.
const std::string stated_action = [] {
  const auto mean = [](char f) { return fmt::format("({0}_00 + {0}_01 + {0}_10 + {0}_11)/4", f); };
  const auto by_t = [](char f) { return fmt::format("({0}_10 + {0}_11 - {0}_00 - {0}_01)/(2*h)", f); };
  const auto by_x = [](char f) { return fmt::format("({0}_01 + {0}_11 - {0}_00 - {0}_10)/(2*dx)", f); };
  return fmt::format(
      "scheme.L=({0}*{1} - {2}*{3})/2 + {4}*{5} + {6}*{7} - (({4})^2 + ({6})^2)/2 - (({0})^2 + "
      "({2})^2)^2/2",
      mean('p'), by_t('q'), mean('q'), by_t('p'), mean('v'), by_x('p'), mean('w'), by_x('q'));
}();

Problem problem_of(const Settings& settings, const std::string& text = bloch_wave) {
  return parse_problem(text, "bloch.toml", settings);
}

Outcome outcome_of(const Settings& settings, const std::string& text = bloch_wave) {
  const Folder folder;
  Outcome outcome = run(problem_of(settings, text), {.output = folder / "a.h5", .threads = 1});
  REQUIRE(outcome.complete);
  return outcome;
}

double error_of(const Settings& settings) {
  return outcome_of(settings).statistics.errors.front().value.largest();
}

std::string message(const Settings& settings, const std::string& text = bloch_wave) {
  return refusal(text, "bloch.toml", settings);
}

}  // namespace

TEST_CASE("a Bloch wave has the order of each scheme") {
  struct Case {
    Settings scheme;
    double order;
    std::vector<int> cells;  ///< with steps of ratio 1/2
    double step;
  };
  const std::vector<Case> cases = {
      {{"scheme.lagrangian=box"}, 2.0, {41, 81, 161}, 0.04},
      {{"scheme.lagrangian=box", "scheme.stages=2", "scheme.space_stages=3"}, 4.0, {63, 105, 171}, 0.1},
      {{"scheme.lagrangian=fourier"}, 2.0, {40, 40, 40}, 0.04},
      {{"scheme.lagrangian=fourier", "scheme.stages=2"}, 4.0, {40, 40, 40}, 0.1},
      {{"scheme.lagrangian=splitting"}, 2.0, {40, 40, 40}, 0.01},
      {{"scheme.lagrangian=splitting", "scheme.space=differences"}, 2.0, {40, 80, 160}, 0.01},
      {{"scheme.lagrangian=splitting", "scheme.composition=blanes-moan-4"}, 4.0, {40, 40, 40}, 0.02},
      {{"scheme.lagrangian=custom", stated_action}, 2.0, {41, 81, 161}, 0.04},
  };
  for (const Case& one : cases) {
    INFO(fmt::format("{}", fmt::join(one.scheme, " ")));
    std::vector<double> errors;
    for (std::size_t i = 0; i < one.cells.size(); ++i) {
      const double step = one.step / static_cast<double>(1 << i);
      errors.push_back(error_of(
          joined(one.scheme, {fmt::format("grid.x.cells={}", one.cells[i]), fmt::format("scheme.step={}", step)})));
    }
    INFO("errors " << errors[0] << ", " << errors[1] << ", " << errors[2]);
    for (std::size_t i = 1; i < errors.size(); ++i) {
      CHECK(std::log2(errors[i - 1] / errors[i]) == Approx(one.order).margin(0.25));
    }
    // The twin: no turn, so that the data are torn at the seam.
    CHECK(error_of(joined(one.scheme, {fmt::format("grid.x.cells={}", one.cells[0]),
                                       fmt::format("scheme.step={}", one.step), "grid.x.phase.charge=0"})) > 0.1);
  }
}

TEST_CASE("a complex wave that turns has the order of explicit schemes, too") {
  // psi = A exp(i(kx - ωt)), ω² = k² + 1 + A², solves psi_tt = psi_xx - psi - |psi|²psi.
  const std::string wave = R"toml(
[field]
equation = "psi_tt = psi_xx - psi - abs2(psi)*psi"
psi = ["p", "q"]
[parameters]
A = 0.5
L = 4
k = "0.6 + 2*pi/L"
omega = "sqrt(k^2 + 1 + A^2)"
[grid]
x = { from = 0, to = "L", cells = 41, phase = { psi = "k*L" } }
[initial]
p = "A*cos(k*x)"
q = "A*sin(k*x)"
p_t = "A*omega*sin(k*x)"
q_t = "-A*omega*cos(k*x)"
[exact]
p = "A*cos(k*x - omega*t)"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.02
until = 1
)toml";
  for (const auto& [scheme, order] : {std::pair("euler-box", 1.0), {"box", 2.0}, {"splitting", 2.0}}) {
    INFO(scheme);
    std::vector<double> errors;
    for (int i = 0; i < 3; ++i) {
      Settings settings = {fmt::format("scheme.lagrangian={}", scheme), fmt::format("grid.x.cells={}", (40 << i) + 1),
                           fmt::format("scheme.step={}", 0.02 / (1 << i))};
      if (std::string(scheme) == "splitting") {
        settings.emplace_back("scheme.space=differences");
      }
      const Outcome outcome = outcome_of(settings, wave);
      errors.push_back(outcome.statistics.errors.front().value.largest());
      CHECK(named(outcome.statistics.totals, "charge").max() < 1e-12);
    }
    CHECK(std::log2(errors[0] / errors[1]) == Approx(order).margin(0.25));
    CHECK(std::log2(errors[1] / errors[2]) == Approx(order).margin(0.25));
  }
}

TEST_CASE("a wave that is constant but for its turn is no noise") {
  const std::string plane =
      with(with(with(bloch_wave, "dn(x, m)*cos", "cos"), "dn(x, m)*sin", "sin"), "[exact]", "[x]");
  const std::string text = plane.substr(0, plane.find("[x]")) + plane.substr(plane.find("[symmetries]"));
  CHECK(outcome_of({"scheme.lagrangian=fourier"}, text).judgement.verdict == figures::Verdict::good);
}

TEST_CASE("the angle counts but for whole turns") {
  const Outcome once = outcome_of({"scheme.lagrangian=fourier"});
  const Outcome more = outcome_of({"scheme.lagrangian=fourier", "grid.x.phase.charge=c*L/2 + 4*pi"});
  CHECK(more.statistics.errors.front().value.largest() ==
        Approx(once.statistics.errors.front().value.largest()).epsilon(1e-8));
  CHECK(error_of({"scheme.lagrangian=fourier", "grid.x.phase.charge=c*L/2 + pi"}) > 0.1);
}

TEST_CASE("where the ring of a Bloch wave begins makes no difference") {
  // Seven cells further the same nodes are stored; those that are behind the seam now have turned.
  for (const char* scheme : {"box", "fourier", "splitting"}) {
    INFO(scheme);
    const Folder folder;
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme), "scheme.until=0.5"};
    static_cast<void>(run(problem_of(settings), {.output = folder / "a.h5", .threads = 1}));
    static_cast<void>(
        run(problem_of(joined(settings, {"parameters.x_0=7*L/41"})), {.output = folder / "b.h5", .threads = 1}));
    const record::Reader a(folder / "a.h5"), b(folder / "b.h5");
    std::vector<double> p = last_row(b, "/states/p"), q = last_row(b, "/states/q");
    const double cells = 41.0, L = cells * (last_row(a, "/grid/x").size() == 1 ? a.read("/grid/x")[1] : 0.0);
    const double angle = -0.35 * L / 2.0;
    for (std::size_t i = p.size() - 7; i < p.size(); ++i) {
      const double turned = std::cos(angle) * p[i] - std::sin(angle) * q[i];
      q[i] = std::sin(angle) * p[i] + std::cos(angle) * q[i];
      p[i] = turned;
    }
    std::ranges::rotate(p, p.end() - 7);
    // 25 steps, each solved to some roundings of numbers of 1.
    CHECK(largest_distance(last_row(a, "/states/p"), p) < 1e-11);
    std::ranges::rotate(q, q.end() - 7);
    CHECK(largest_distance(last_row(a, "/states/q"), q) < 1e-11);
    p[3] = last_row(b, "/states/p")[p.size() - 4];
    CHECK(largest_distance(last_row(a, "/states/p"), p) > 1e-2);
  }
}

TEST_CASE("energy, momentum and charge of a Bloch wave are those of psi, and stay") {
  for (const char* scheme : {"box", "fourier", "splitting"}) {
    INFO(scheme);
    const Outcome outcome = outcome_of({fmt::format("scheme.lagrangian={}", scheme), "scheme.levels=variable",
                                        "scheme.until=2", "scheme.step=0.01", "grid.x.cells=81"});
    CHECK(outcome.statistics.relative_energy_deviation().value() < 1e-13);
    const double tolerance = std::string(scheme) == "box" ? 1e-2 : 1e-9;  // differences err by Δx²
    const auto& invariants = outcome.statistics.invariants;
    CHECK(outcome.statistics.node_energy.initial ==
          Approx(-named(invariants, "energy_of_psi").initial).epsilon(tolerance));
    CHECK(std::abs(named(outcome.statistics.totals, "momentum").initial) ==
          Approx(0.5 * std::abs(named(invariants, "current").initial)).epsilon(tolerance));
    CHECK(std::abs(named(outcome.statistics.totals, "charge").initial) ==
          Approx(0.5 * named(invariants, "mass").initial).epsilon(tolerance));
    CHECK(named(outcome.statistics.totals, "charge").max() < 1e-12);
    if (std::string(scheme) != "splitting") {  // whose fluxes are integrated to its order
      CHECK(named(outcome.statistics.residuals, "charge").max < 1e-10);
    }
  }
  // The momentum of a translation is conserved where space is treated as it is.
  const Outcome fourier = outcome_of({"scheme.lagrangian=fourier", "grid.x.cells=40"});
  CHECK(named(fourier.statistics.totals, "momentum").max() < 1e-12);
  // The twin: without what the turn adds it is another number.
  const MultisymplecticSystem system = make_system(problem_of({}));
  REQUIRE(system.turns().size() == 1);
  const grids::Grid grid = make_grid(problem_of({}));
  const auto total = [&](const MultisymplecticSystem& one) {
    const Problem problem = problem_of({"scheme.lagrangian=fourier"});
    const LatticeLevel level = make_initial_level(problem, make_system(problem), grid);
    return make_local_laws(*make_method(problem), one, grid, {}).totals(level)[1];
  };
  const MultisymplecticSystem twin(system.graph(), system.fields(), system.M(), {system.K(0)}, system.expression());
  CHECK(std::abs(total(system) - total(twin)) > 0.1);
}

TEST_CASE("local laws of a Bloch wave are those of three periods on a longer ring") {
  for (const char* scheme : {"box", "fourier"}) {
    INFO(scheme);
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme), "scheme.until=0.5"};
    const Outcome one = outcome_of(settings);
    const Outcome three =
        outcome_of(joined(settings, {"grid.x.cells=123", "grid.x.to=x_0 + 3*L", "grid.x.phase.charge=3*c*L/2"}));
    REQUIRE(one.statistics.residuals.size() == three.statistics.residuals.size());
    for (std::size_t law = 0; law < one.statistics.residuals.size(); ++law) {
      INFO(one.statistics.residuals[law].name);
      // Rounding of a residual is that of densities over the step or the spacing.
      CHECK(one.statistics.residuals[law].value.max == Approx(three.statistics.residuals[law].value.max).margin(1e-10));
    }
    for (const char* name : {"momentum", "charge"}) {
      CHECK(3.0 * named(one.statistics.totals, name).initial ==
            Approx(named(three.statistics.totals, name).initial).epsilon(1e-11));
    }
  }
}

TEST_CASE("records of a Bloch wave have psi; check, resume, output and initial data of a record know of it") {
  const Folder folder;
  for (const char* scheme : {"box", "fourier", "splitting"}) {
    INFO(scheme);
    const Settings settings = {
        fmt::format("scheme.lagrangian={}", scheme), "output.every=3", "output.times=[0.33]",
        "output.quantities={ there = { formula = \"q\", at = { x = 0.5 } }, current = "
        "\"integral(p*dx(q) - q*dx(p))\", bent = { formula = \"dx(dx(p))\", at = { x = 0.5 } } }",
        "events={ dark = { crossing = \"p - 0.9\", at = { x = 0.1 } } }"};
    static_cast<void>(run(problem_of(settings), {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
    const record::Reader reader(folder / "a.h5");
    CHECK(largest_distance(last_row(reader, "/states/p"), last_row(reader, "/exact/p")) < 0.05);
    CHECK(largest_distance(last_row(reader, "/output/p"), last_row(reader, "/states/p")) > 0.1);
    const double current = reader.read("/laws/current").front();
    CHECK(reader.read("/output/quantities/current").front() == Approx(current).epsilon(1e-2));
    // q = dn(y, m) sin φ there, with y = 0.5 - 0.33 c; dn = 1 - my²/2 up to y⁴/12.
    const double y = 0.5 - 0.35 * 0.33, phase = 0.35 * 0.25 + (1.3 - 0.35 * 0.35 / 4.0) * 0.33;
    CHECK(reader.read("/output/quantities/there").front() ==
          Approx((1.0 - 0.35 * y * y) * std::sin(phase)).margin(0.02));
    CHECK(reader.read("/output/quantities/bent").front() < -0.3);
    CHECK(reader.read("/events/dark/t").size() == 1);
    CHECK(check(folder / "a.h5").status == ExitStatus::done);

    static_cast<void>(run(problem_of(joined(settings, {"scheme.until=0.5"})),
                          {.output = folder / "part.h5", .overwrite = true, .threads = 1}));
    static_cast<void>(resume(folder / "part.h5", 1.0));
    CHECK(record::Reader(folder / "part.h5").read("/levels/node_energy") == reader.read("/levels/node_energy"));
  }
  falsify(folder / "a.h5", "/states/p", 60, 1e-9);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);

  const std::string from = with(with(bloch_wave, "p = \"dn(x, m)*cos(c*x/2)\"\nq = \"dn(x, m)*sin(c*x/2)\"",
                                     fmt::format("from = \"{}\"", folder / "start.h5")),
                                "box", "fourier");
  static_cast<void>(run(problem_of({"scheme.lagrangian=fourier", "grid.x.cells=40", "scheme.until=0.5"}),
                        {.output = folder / "start.h5", .threads = 1}));
  for (const char* cells : {"40", "50"}) {
    const Folder here;
    const Outcome outcome =
        run(problem_of({fmt::format("grid.x.cells={}", cells)}, from), {.output = here / "b.h5", .threads = 1});
    CHECK(outcome.status == ExitStatus::done);
    CHECK(outcome.statistics.errors.front().value.largest() < 2e-2);
    CHECK(check(here / "b.h5").status == ExitStatus::done);
  }
}

TEST_CASE("convergence of a Bloch wave is estimated on other cells, too") {
  const ConvergenceOutcome outcome = converge(problem_of({"scheme.until=0.2"}), std::nullopt, {.threads = 1});
  CHECK(outcome.status == ExitStatus::done);
}

TEST_CASE("ranks share a lattice whose fields turn, along it and across") {
  const std::string plane = R"toml(
[field]
equation = "i*psi_t + psi_xx + psi_yy + abs2(psi)*psi = 0"
psi = ["p", "q"]
[grid]
x = { from = 0, to = 5, cells = 20, phase = { psi = 1 } }
y = { from = 0, to = 6, cells = 15, phase = { psi = "-pi/3" } }
[initial]
p = "(1 + cos(2*pi*x/5)/4)*cos(x/5 - pi*y/18)"
q = "(1 + cos(2*pi*x/5)/4)*sin(x/5 - pi*y/18)"
[scheme]
lagrangian = "splitting"
levels = "fixed"
step = 0.01
until = 0.3
[output]
every = 5
)toml";
  const Folder folder;
  const Problem problem = problem_of({}, plane);
  const Outcome one = run(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
  REQUIRE(one.status == ExitStatus::done);
  const Outcome all = with_ranks(3, [&](auto& rank) { return run(problem, on(rank, folder / "all.h5")); });
  REQUIRE(all.status == ExitStatus::done);
  for (const char* field : {"/states/p", "/states/q"}) {
    CHECK(largest_distance(record::Reader(folder / "one.h5").read(field),
                           record::Reader(folder / "all.h5").read(field)) < 1e-12);
  }
  CHECK(check(folder / "all.h5").status == ExitStatus::done);
}

TEST_CASE("twists are refused where they are none, with place, reason and remedy") {
  CHECK(message({}).empty());
  CHECK_THAT(message({}, with(bloch_wave, "phase = { charge", "phase = { chrage")),
             Contains("bloch.toml:13:") && Contains("did you mean charge"));
  CHECK_THAT(message({}, with(bloch_wave, "phase = { charge = \"c*L/2\" }", "phase = { p = \"pi\" }")),
             Contains("real field") && Contains("twice the ring"));
  CHECK_THAT(message({}, with(bloch_wave, "phase = { charge = \"c*L/2\" }", "phase = { p = 1 }")),
             Contains("cannot turn by 1") && Contains("complex unknown"));
  CHECK_THAT(message({}, with(bloch_wave, "phase = { charge = \"c*L/2\" }", "phase = {}")), Contains("names nothing"));
  CHECK_THAT(message({"invariants.mass=p^2"}), Contains("invariant") && Contains("p^2") && Contains("seam"));
  CHECK_THAT(message({"scheme.frame.velocity=0.5"}), Contains("frame") && Contains("phase"));
  CHECK_THAT(message({}, with(bloch_wave, "(p^2 + q^2)^2/2", "(p^2 + q^2)^2/2 + p^4")),
             Contains("not a symmetry of S"));
  CHECK_THAT(message({"scheme.lagrangian=custom", stated_action + " + p_00^2/100"}),
             Contains("L has to be the same") && Contains("p_00"));
  CHECK_THAT(message({}, with(bloch_wave, "phase = {", "jump = { p = 1 }, phase = {")), Contains("jump"));
  // A field without the one that it turns with.
  const auto run_message = [](const std::string& text) -> std::string {
    try {
      const Problem problem = problem_of({}, text);
      static_cast<void>(make_initial_fields(problem, make_grid(problem)));
    } catch (const ProblemError& error) {
      return error.what();
    }
    return "";
  };
  CHECK(run_message(bloch_wave).empty());
  CHECK_THAT(run_message(with(bloch_wave, "q = \"dn(x, m)*sin(c*x/2)\"\n[exact]", "q = \"dx(p)\"\n[exact]")),
             Contains("turns") && Contains("initial q"));
}

TEST_CASE("an angle that the data do not have is told of") {
  const auto warnings = [](const Settings& settings) {
    return make_lattice(problem_of(joined({"scheme.lagrangian=splitting"}, settings))).cautions();
  };
  const auto tells = [](const std::vector<std::string>& all) {
    return std::ranges::any_of(all, [](const std::string& one) { return one.find("not periodic") != one.npos; });
  };
  CHECK_FALSE(tells(warnings({"grid.x.cells=101"})));
  CHECK(tells(warnings({"grid.x.cells=101", "grid.x.phase.charge=0"})));
}
