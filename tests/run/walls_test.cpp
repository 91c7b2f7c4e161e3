// [grid] left and right: walls, by the mirrors of Mirrors.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <Eigen/Core>

#include <rubato/figures/verdict.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem_texts.hpp"
#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

/// Kinks that collide: of two kinks u is odd in x, of a kink and an antikink it is even. Half of the solution is a kink
/// that a wall at x = 0 returns, where it holds u or leaves it free. At x = 16 what is left of it is below 1e-4.
constexpr const char* collision = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + 1 - cos(u)"
[parameters]
c = 0.5
g = "1/sqrt(1 - c^2)"
[grid]
x = { from = 0, to = 16, cells = 80, left = "fixed", right = "free" }
[initial]
t = -2
u = "4*atan(c*sinh(g*x)/cosh(g*c*t))"
v = "-4*c^2*g*sinh(g*x)*sinh(g*c*t)/(cosh(g*c*t)^2 + c^2*sinh(g*x)^2)"
[exact]
u = "4*atan(c*sinh(g*x)/cosh(g*c*t))"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.1
until = 2
)toml";

/// Of a kink and an antikink, between free walls.
const Settings free_walls = {"grid.x.left=free", "initial.u=4*atan(sinh(g*c*t)/(c*cosh(g*x)))",
                             "initial.v=4*c^2*g*cosh(g*c*t)*cosh(g*x)/(c^2*cosh(g*x)^2 + sinh(g*c*t)^2)",
                             "exact.u=4*atan(sinh(g*c*t)/(c*cosh(g*x)))"};

/// Of u at the corners of a cell, the same in the mirror.
constexpr const char* stated_action =
    "scheme.L=((u_10 - u_00)^2 + (u_11 - u_01)^2)/(4*h^2) - ((u_01 - u_00)^2 + (u_11 - u_10)^2)/(4*dx^2) - 1 + "
    "(cos(u_00) + cos(u_01) + cos(u_10) + cos(u_11))/4";

Outcome outcome_of(const Settings& settings, const std::string& problem = collision) {
  const Folder folder;
  Outcome outcome = run(parse_problem(problem, "walls.toml", settings), {.output = folder / "a.h5", .threads = 1});
  REQUIRE(outcome.complete);
  return outcome;
}

double error_of(const Settings& settings, const std::string& problem = collision) {
  return outcome_of(settings, problem).statistics.errors.front().value.largest();
}

/// What reading or beginning a problem refuses.
std::string refusal(const Settings& settings, const std::string& problem = collision) {
  return refusal_at_start(problem, "walls.toml", settings);
}

}  // namespace

TEST_CASE("a kink returns from a fixed wall and from a free one with the order of each scheme") {
  struct Case {
    Settings scheme;
    double order;
    double step = 0.1;
    int cells = 80;
    bool refines_cells = true;
  };
  const std::vector<Case> cases = {
      {{"scheme.lagrangian=leapfrog"}, 2.0},
      {{"scheme.lagrangian=euler-box"}, 1.0},
      {{"scheme.lagrangian=box"}, 2.0},
      {{"scheme.lagrangian=fourier"}, 2.0, 0.1, 160, false},
      {{"scheme.lagrangian=splitting"}, 2.0, 0.1, 160, false},
      {{"scheme.lagrangian=splitting", "scheme.space=differences"}, 2.0},
      {{"scheme.lagrangian=fourier", "scheme.stages=2"}, 4.0, 0.4, 160, false},
      {{"scheme.lagrangian=custom", stated_action}, 2.0},
  };
  for (const bool free : {false, true}) {
    for (const Case& one : cases) {
      INFO((free ? "free, " : "fixed, ") << one.scheme.back());
      const auto error = [&](int halvings) {
        const int cells = one.refines_cells ? one.cells << halvings : one.cells;
        return error_of(
            joined(joined(free ? free_walls : Settings{}, one.scheme),
                   {fmt::format("scheme.step={}", one.step / (1 << halvings)), fmt::format("grid.x.cells={}", cells)}));
      };
      const double whole = error(0), half = error(1), quarter = error(2);
      INFO("errors " << whole << ", " << half << ", " << quarter);
      CHECK(std::log2(whole / half) == Approx(one.order).margin(0.3));
      CHECK(std::log2(half / quarter) == Approx(one.order).margin(0.3));
    }
  }
  // The twin: the other wall turns the kink into what it is not.
  CHECK(error_of({"grid.x.left=free"}) > 0.5);
}

TEST_CASE("walls are the middle of a ring of mirrors") {
  const Folder folder;
  for (const char* scheme : {"leapfrog", "euler-box", "fourier", "splitting"}) {
    INFO(scheme);
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme), "grid.x.cells=64"};
    const Settings between = joined(joined(free_walls, settings), {});
    const std::string ring = with(with(collision, ", left = \"fixed\", right = \"free\"", ""),
                                  "from = 0, to = 16, cells = 80", "from = -16, to = 16, cells = 128");
    Settings whole = joined(Settings(free_walls.begin() + 1, free_walls.end()), settings);
    whole.back() = "grid.x.cells=128";
    static_cast<void>(
        run(parse_problem(collision, "a.toml", between), {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
    static_cast<void>(
        run(parse_problem(ring, "b.toml", whole), {.output = folder / "b.h5", .overwrite = true, .threads = 1}));
    const std::vector<double> a = last_row(record::Reader(folder / "a.h5"), "/states/u");
    std::vector<double> b = last_row(record::Reader(folder / "b.h5"), "/states/u");
    REQUIRE(a.size() == 65);
    b.erase(b.begin(), b.begin() + 64);
    b.push_back(last_row(record::Reader(folder / "b.h5"), "/states/u").front());
    // 40 steps, each solved to some roundings of numbers of 6.
    CHECK(largest_distance(a, b) < 1e-11);
    // The twin: a node further on.
    std::ranges::rotate(b, b.begin() + 1);
    CHECK(largest_distance(a, b) > 0.01);
  }
}

TEST_CASE("the energy law between walls holds to rounding with variable levels") {
  for (const char* scheme : {"leapfrog", "box", "fourier", "splitting"}) {
    for (const bool free : {false, true}) {
      INFO(scheme << (free ? ", free" : ", fixed"));
      const Outcome outcome = outcome_of(
          joined(free ? free_walls : Settings{}, {fmt::format("scheme.lagrangian={}", scheme), "scheme.levels=variable",
                                                  "scheme.step=0.02", "scheme.until=8", "grid.x.cells=128"}));
      CHECK(outcome.statistics.relative_energy_deviation().value() < 1e-13);
      // The energy of one kink, 8γ, of which the lattice makes an error of the order of Δx².
      CHECK(outcome.statistics.node_energy.initial == Approx(8.0 / std::sqrt(0.75)).epsilon(2e-3));
      // The force of the wall turns the momentum, 8γc, round; at the start the kink and its mirror still overlap.
      REQUIRE(outcome.statistics.totals.size() == 1);
      CHECK(outcome.statistics.totals.front().name == "momentum_balance");
      CHECK(outcome.statistics.totals.front().value.max() == Approx(8.0 / std::sqrt(0.75)).epsilon(0.15));
    }
  }
  // The twin: of the whole ring.
  const Outcome ring =
      outcome_of(joined(Settings(free_walls.begin() + 1, free_walls.end()), {"scheme.lagrangian=fourier"}),
                 with(with(collision, ", left = \"fixed\", right = \"free\"", ""), "from = 0,", "from = -16,"));
  CHECK(ring.statistics.node_energy.initial == Approx(16.0 / std::sqrt(0.75)).epsilon(2e-3));
  CHECK(ring.statistics.totals.front().name == "momentum");
}

TEST_CASE("local laws between walls are those of the ring") {
  for (const char* scheme : {"leapfrog", "euler-box", "fourier", "splitting"}) {
    INFO(scheme);
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme), "grid.x.cells=64"};
    const Outcome between = outcome_of(joined(free_walls, settings));
    Settings whole = joined(Settings(free_walls.begin() + 1, free_walls.end()), settings);
    whole.back() = "grid.x.cells=128";
    const Outcome ring = outcome_of(
        whole, with(with(collision, ", left = \"fixed\", right = \"free\"", ""), "from = 0,", "from = -16,"));
    for (std::size_t law = 0; law < 2; ++law) {
      const double here = between.statistics.residuals[law].value.max, there = ring.statistics.residuals[law].value.max;
      // Rounding of a residual is that of densities over the step or the spacing. One-sided differences look another
      // way in a mirror, so that the ring may have the largest residual there.
      CHECK(here < there + 1e-10);
      CHECK(here >
            (scheme == std::string("leapfrog") || scheme == std::string("euler-box") ? 0.9 * there : there - 1e-10));
    }
  }
}

TEST_CASE("momentum and the force on both walls balance with the local residuals") {
  // Δx Σ_i r_i = (P_{k+1} - P_k)/h + F_N - F_0 over the cells, P = -Δx Σ (δ⁻z)ᵀM₊z, F = S(z̄) + (D_t z)ᵀM₊z̄ at a node.
  const Folder folder;
  const Problem problem =
      parse_problem(collision, "walls.toml", Settings{"laws.fields=true", "scheme.until=0", "output.every=1"});
  static_cast<void>(run(problem, {.output = folder / "a.h5", .threads = 1}));
  const record::Reader reader(folder / "a.h5");
  const MultisymplecticSystem system = make_system(problem);
  const Eigen::MatrixXd& plus = system.structure().M_plus;
  const std::size_t nodes = 81, levels = reader.read("/states/t").size();
  const double dx = 0.2, h = 0.1;
  std::vector<std::vector<double>> fields;
  for (const std::string& name : system.fields()) {
    fields.push_back(reader.read("/states/" + name));
  }
  const std::vector<double> residuals = reader.read("/laws/fields/momentum_balance");
  const auto at = [&](std::size_t level, std::size_t node) {
    return Eigen::Vector3d(fields[0][level * nodes + node], fields[1][level * nodes + node],
                           fields[2][level * nodes + node]);
  };
  const auto momentum = [&](std::size_t level) {
    double sum = 0.0;
    for (std::size_t node = 1; node < nodes; ++node) {
      sum -= (at(level, node) - at(level, node - 1)).dot(plus * at(level, node));
    }
    return sum;
  };
  const auto force = [&](std::size_t level, std::size_t node) {
    const Eigen::Vector3d mean = 0.5 * (at(level, node) + at(level + 1, node));
    const double S = (mean(1) * mean(1) - mean(2) * mean(2)) / 2.0 + 1.0 - std::cos(mean(0));
    return S + ((at(level + 1, node) - at(level, node)) / h).dot(plus * mean);
  };
  double impulse = 0.0;
  for (std::size_t level = 0; level + 1 < levels; ++level) {
    double sum = 0.0;
    for (std::size_t node = 1; node < nodes; ++node) {
      sum += dx * residuals[(level + 1) * nodes + node];
    }
    const double change = (momentum(level + 1) - momentum(level)) / h;
    const double forces = force(level, nodes - 1) - force(level, 0);
    // Rounding of momenta of 5 over h, and of 80 residuals of the same.
    CHECK(std::abs(sum - change - forces) < 1e-11);
    impulse += h * std::abs(forces);
  }
  // The twin: without the forces nothing balances.
  CHECK(impulse > 3.0);
}

TEST_CASE("explicit schemes between walls hold what they begin with, whatever S is in a mirror") {
  // Leapfrog written by hand between two held ends, the same to some roundings of numbers of 3 in each of 100 steps.
  const Folder folder;
  const std::string problem = with(collision, "1 - cos(u)", "u^2/2 + u^3/3");
  const auto states = [&](const Settings& more) {
    const Settings settings = {"grid.x={from=0, to=2, cells=20, left=\"fixed\", right=\"fixed\"}",
                               "initial.t=0",
                               "initial.u=1 + x/2 + sin(pi*x/2)/4",
                               "initial.v=0",
                               "scheme.step=0.02",
                               "scheme.until=2"};
    static_cast<void>(
        run(parse_problem(with(problem, "u = \"4*atan(c*sinh(g*x)/cosh(g*c*t))\"\n[scheme]", "u = \"1\"\n[scheme]"),
                          "walls.toml", joined(settings, more)),
            {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
    return last_row(record::Reader(folder / "a.h5"), "/states/u");
  };
  const auto by_hand = [](double cubic) {
    const double dx = 0.1, h = 0.02;
    std::vector<double> u(21), v(21, 0.0), force(21, 0.0);
    for (std::size_t i = 0; i < u.size(); ++i) {
      const double x = 0.1 * static_cast<double>(i);
      u[i] = 1.0 + x / 2.0 + std::sin(M_PI * x / 2.0) / 4.0;
    }
    const auto kick = [&] {
      for (std::size_t i = 1; i + 1 < u.size(); ++i) {
        v[i] += 0.5 * h * ((u[i + 1] - 2.0 * u[i] + u[i - 1]) / (dx * dx) - u[i] - cubic * u[i] * u[i]);
      }
    };
    for (int step = 0; step < 100; ++step) {
      kick();
      for (std::size_t i = 1; i + 1 < u.size(); ++i) {
        u[i] += h * v[i];
      }
      kick();
    }
    return u;
  };
  CHECK(largest_distance(states({}), by_hand(1.0)) < 1e-12);
  CHECK(largest_distance(states({"scheme.lagrangian=custom",
                                 "scheme.L=((u_10 - u_00)^2 + (u_11 - u_01)^2)/(4*h^2) - ((u_01 - u_00)^2 + (u_11 - "
                                 "u_10)^2)/(4*dx^2) - (u_00^2 + u_01^2 + u_10^2 + u_11^2)/8"}),
                         by_hand(0.0)) < 1e-12);
  // The twin: another force.
  CHECK(largest_distance(states({}), by_hand(0.99)) > 1e-4);
  // Variable levels keep E; the twin, fixed ones, do not.
  const auto deviation = [&](const char* levels) {
    return outcome_of({"grid.x={from=0, to=2, cells=20, left=\"fixed\", right=\"fixed\"}", "initial.t=0",
                       "initial.u=1 + x/2 + sin(pi*x/2)/4", "initial.v=0", "scheme.step=0.02", "scheme.until=4",
                       fmt::format("scheme.levels={}", levels)},
                      problem)
        .statistics.relative_energy_deviation()
        .value();
  };
  CHECK(deviation("variable") < 1e-13);
  CHECK(deviation("fixed") > 1e-9);
}

TEST_CASE("a kink rests between walls that hold it at different values") {
  const std::string resting = with(collision, "from = 0, to = 16, cells = 80, left = \"fixed\", right = \"free\"",
                                   "from = 0, to = 20, cells = 200, left = \"fixed\", right = \"fixed\"");
  const auto outcome = [&](const char* more) {
    const std::string kink = fmt::format("4*atan(exp(x - 10)){}", more);
    return outcome_of(
        {"initial.t=0", "initial.u=" + kink, "initial.v=0", "exact.u=" + kink, "scheme.step=0.05", "scheme.until=20"},
        resting);
  };
  const Outcome rests = outcome("");
  // The lattice changes the kink by Δx² u_xxxx/12 over S'', Δx²/6, and an oscillation doubles that.
  CHECK(rests.statistics.errors.front().value.largest() < 0.1 * 0.1 / 3.0);
  CHECK(figures::judge(rests.statistics).verdict == figures::Verdict::good);
  CHECK(rests.statistics.node_energy.initial == Approx(8.0).epsilon(0.1 * 0.1 / 6.0));
  // The twin: what is no solution at rest moves.
  CHECK(outcome(" + sin(pi*x/20)/4").statistics.errors.front().value.largest() > 0.1);
}

TEST_CASE("a square drum, and a strip between walls in one direction, sound as they should") {
  const std::string drum = R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2 + 1 - cos(u)"
[grid]
x = { from = 0, to = 1, cells = 8, left = "fixed", right = "fixed" }
y = { from = 0, to = 1, cells = 8, left = "fixed", right = "fixed" }
[parameters]
kx = "2*pi"
ky = "pi"
e = 1e-5
[initial]
u = "e*sin(kx*x)*sin(ky*y)"
v = "0"
[exact]
u = "e*sin(kx*x)*sin(ky*y)*cos(sqrt(1 + kx^2 + ky^2)*t)"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.04
until = 1
)toml";
  // So little that the sine adds e³ = 1e-15.
  const Settings strip = {"grid.x.left=free", "grid.x.right=free", "initial.u=e*cos(kx*x)*sin(ky*y)",
                          "exact.u=e*cos(kx*x)*sin(ky*y)*cos(sqrt(1 + kx^2 + ky^2)*t)"};
  const std::string ring = with(drum, "cells = 8, left = \"fixed\", right = \"fixed\" }\ny", "cells = 8 }\ny");
  for (const int kind : {0, 1, 2}) {
    const auto error = [&](int halvings) {
      return error_of(joined(kind == 1 ? strip : Settings{}, {fmt::format("scheme.step={}", 0.04 / (1 << halvings)),
                                                              fmt::format("grid.x.cells={}", 8 << halvings),
                                                              fmt::format("grid.y.cells={}", 8 << halvings)}),
                      kind == 2 ? ring : drum);
    };
    const double whole = error(0), half = error(1), quarter = error(2);
    INFO("kind " << kind << ": errors " << whole << ", " << half << ", " << quarter);
    CHECK(std::log2(whole / half) == Approx(2.0).margin(0.3));
    CHECK(std::log2(half / quarter) == Approx(2.0).margin(0.3));
  }
}

namespace {

/// Of which the momentum along the walls is about 6, wherever the wave begins.
constexpr const char* strip_with_momentum = R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2 + u^2/2"
[parameters]
shift = 0
[grid]
x = { from = 0, to = 4, cells = 8, left = "fixed", right = "fixed" }
y = { from = 0, to = 3, cells = 12 }
[initial]
u = "sin(pi*x/4)*cos(2*pi*(y/3 - shift/12))"
v = "sin(pi*x/4)*sin(2*pi*(y/3 - shift/12))"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.02
until = 1
)toml";

}  // namespace

TEST_CASE("totals of a strip between walls do not depend on where its other direction closes") {
  const auto momentum = [](int shift) {
    const Problem problem =
        parse_problem(strip_with_momentum, "strip.toml", Settings{fmt::format("parameters.shift={}", shift)});
    LatticeIntegrator lattice = make_lattice(problem);
    const std::vector<std::string>& names = lattice.laws().names();
    const auto found = std::ranges::find(names, "momentum_y");
    REQUIRE(found != names.end());
    return lattice.totals()[static_cast<std::size_t>(found - names.begin())];
  };
  // The integral of v u_y is 2 pi, and a difference over two of twelve cells has sin(pi/6)/(pi/6) of the slope.
  const double there = momentum(0);
  CHECK(std::abs(there) == Approx(6.0).epsilon(1e-12));
  for (const int shift : {1, 2, 3}) {  // twelve rows, of which the seam's two have from none to a third of the sum
    CHECK(momentum(shift) == Approx(there).epsilon(1e-12));
  }
}

TEST_CASE("records between walls have both ends; check, resume and output know of them") {
  const Folder folder;
  for (const char* scheme : {"leapfrog", "euler-box", "box", "fourier", "splitting"}) {
    INFO(scheme);
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme),
                               "scheme.until=-0.5",
                               "output.every=3",
                               "output.times=[-1.3333]",
                               "output.quantities={ there = { formula = \"u\", at = { x = 1.234 } }, slope = "
                               "\"integral(dx(u))\" }",
                               "laws.fields=true"};
    static_cast<void>(run(parse_problem(collision, "walls.toml", settings),
                          {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
    const record::Reader reader(folder / "a.h5");
    const std::vector<double> x = reader.read("/grid/x");
    REQUIRE(x.size() == 81);
    CHECK(x.back() == 16.0);
    CHECK(reader.read("/grid/x_cell").size() == 80);
    // ∫u_x is u at the right end, 2π but for 1e-4; the trapezium errs by the square of the spacing.
    CHECK(reader.read("/output/quantities/slope").front() == Approx(6.28318).margin(0.02));
    const double g = 1.0 / std::sqrt(0.75);
    CHECK(reader.read("/output/quantities/there").front() ==
          Approx(4.0 * std::atan(0.5 * std::sinh(g * 1.234) / std::cosh(0.5 * g * 1.3333))).margin(0.02));
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
    static_cast<void>(run(parse_problem(collision, "walls.toml", joined(settings, {"scheme.until=-1.2"})),
                          {.output = folder / "part.h5", .overwrite = true, .threads = 1}));
    static_cast<void>(resume(folder / "part.h5", -0.5));
    CHECK(record::Reader(folder / "part.h5").read("/levels/node_energy") == reader.read("/levels/node_energy"));
    CHECK(last_row(record::Reader(folder / "part.h5"), "/states/u") == last_row(reader, "/states/u"));
  }
  falsify(folder / "a.h5", "/states/u", 100, 1e-9);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
}

TEST_CASE("data that do not meet a wall are reported with their size, or refused") {
  const auto cautions = [](const Settings& settings) {
    const std::vector<std::string> all = make_lattice(parse_problem(collision, "walls.toml", settings)).cautions();
    return all.empty() ? std::string() : all.front();
  };
  const std::string by_fourier = "scheme.lagrangian=fourier";
  CHECK(cautions({}).empty());
  CHECK_THAT(cautions({by_fourier, "initial.u=4*atan(c*sinh(g*x)/cosh(g*c*t)) + 0.01*exp(-x)"}),
             Contains("misses by 0.01") && Contains("x = 0"));
  CHECK_THAT(cautions({"initial.v=-4*c^2*g*sinh(g*x)*sinh(g*c*t)/(cosh(g*c*t)^2 + c^2*sinh(g*x)^2) + 0.005*exp(-x)"}),
             Contains("v misses by 0.005") && Contains("x = 0"));
  CHECK_THAT(cautions({"initial.u=4*atan(c*sinh(g*x)/cosh(g*c*t)) + 0.1*sin(x)"}),
             Contains("slope of u") && Contains("x = 16"));
  // A slope is compared with the field where the field does not vary along the wall's axis but by rounding.
  const auto flat_in_y = [&](const std::string& u) {
    return cautions({"multisymplectic.fields=[\"u\", \"v\", \"w\", \"b\"]", "multisymplectic.K.y=[[\"u\", \"b\", 1]]",
                     "multisymplectic.S=(v^2 - w^2 - b^2)/2", "grid.x={ from = 0, to = 10, cells = 32 }",
                     "grid.y={ from = 0, to = 10, cells = 32, left = \"free\", right = \"free\" }", "initial.u=" + u,
                     "initial.v=0", "exact.u=0"});
  };
  CHECK(flat_in_y("0.3*cos(2*pi*x/10)*cos(2*pi*y/10)^2 + 0.3*cos(2*pi*x/10)*sin(2*pi*y/10)^2").empty());
  CHECK_THAT(flat_in_y("0.3*cos(2*pi*x/10) + 1e-9*y"), Contains("slope of u is 1e-09"));
  CHECK_THAT(refusal({"initial.v=cos(x)"}), Contains("v differs by up to 1 from 0") && Contains("holds it"));
  CHECK_THAT(refusal({by_fourier, "grid.x.right=fixed"}), Contains("x = 16") && Contains("meet the wall"));
}

TEST_CASE("walls are refused where they cannot be, with place, reason and remedy") {
  CHECK(refusal({}).empty());
  CHECK_THAT(refusal({"grid.x.left=periodic"}), Contains("left") && Contains("fixed"));
  CHECK_THAT(refusal({}, with(collision, "left = \"fixed\", ", "")), Contains("walls.toml:11:") && Contains("left"));
  CHECK_THAT(refusal({"grid.x.jump.u=2*pi"}), Contains("jump"));
  CHECK_THAT(refusal({"scheme.frame.velocity=0.5"}), Contains("walls"));
  CHECK_THAT(refusal({"scheme.lagrangian=box", "scheme.stages=2"}),
             Contains("box with stages = 2 has no walls") && Contains("fourier"));
  CHECK_THAT(refusal({"scheme.lagrangian=custom", std::string(stated_action) + " + (u_00*u_11 - u_01*u_10)/9"}),
             Contains("mirror") && Contains("L"));
  CHECK_THAT(refusal({"scheme.lagrangian=custom", std::string(stated_action) + " + w_00*w_01"}),
             Contains("w has none"));
  CHECK_THAT(refusal({"scheme.lagrangian=fourier"}, with(collision, "1 - cos(u)", "u^2/2 + u^3/3")),
             Contains("u^3") && Contains("fixed"));
  CHECK_THAT(
      refusal({}, with(collision, "K.x = [[\"u\", \"w\", 1]]", "K.x = [[\"u\", \"w\", 1], [\"u\", \"v\", 0.5]]")),
      Contains("mirror") && Contains("couple"));
}

TEST_CASE("an equation's own field is what walls hold or leave free, whatever others it is written with") {
  struct Case {
    std::string equation, initial, exact, field;
    const char* wall;
  };
  // Beams that are pinned or guided, Maxwell's equations of either order, and waves of which u is φ_x.
  const std::vector<Case> all = {
      {"\"u_tt + u_xxxx = 0\"", "u = \"sin(2*x)\"\nu_t = 0", "sin(2*x)*cos(4*t)", "u", "fixed"},
      {"\"u_tt + u_xxxx = 0\"", "u = \"cos(2*x)\"\nu_t = 0", "cos(2*x)*cos(4*t)", "u", "free"},
      {"\"u_tt = u_xx - u_xxxx\"", "u = \"sin(x)\"\nu_t = 0", "sin(x)*cos(sqrt(2)*t)", "u", "fixed"},
      {"[\"E_t = -B_x\", \"B_t = -E_x\"]", "E = \"sin(x)\"\nB = 0", "sin(x)*cos(t)", "E", "fixed"},
      {"[\"B_t = -E_x\", \"E_t = -B_x\"]", "B = \"sin(x)\"\nE = 0", "sin(x)*cos(t)", "B", "fixed"},
      {"[\"E_t = -B_x\", \"B_t = -E_x\"]", "E = \"cos(x)\"\nB = 0", "cos(x)*cos(t)", "E", "free"}};
  const Folder folder;
  for (const Case& one : all) {
    const auto error = [&](const char* wall) {
      const std::string file = folder / "wall.h5";
      const std::string text = fmt::format(
          "[field]\nequation = {}\n[grid]\nx = {{ from = 0, to = \"pi\", cells = 24, left = \"{}\", right = \"{}\" }}\n"
          "[initial]\n{}\n[exact]\n{} = \"{}\"\n[scheme]\nlagrangian = \"fourier\"\nstages = 3\nlevels = \"fixed\"\n"
          "step = 0.05\nuntil = 1\n",
          one.equation, wall, wall, one.initial, one.field, one.exact);
      const Outcome outcome = run(parse_problem(text, "walls.toml"), {.output = file, .overwrite = true, .threads = 1});
      return std::pair(outcome.judgement.verdict, outcome.statistics.errors.front().value.largest());
    };
    INFO(one.equation << ", " << one.wall);
    const auto [verdict, worst] = error(one.wall);
    CHECK(verdict == figures::Verdict::good);
    CHECK(worst < 1e-6);  // (ωh)^7 over some thousands, times the steps
    CHECK(check(folder / "wall.h5").status == ExitStatus::done);
    // The twin: a wall of the other kind, which such data do not meet.
    try {
      const double wrong = error(std::string(one.wall) == "fixed" ? "free" : "fixed").second;
      CHECK(wrong > 1e-2);
    } catch (const ProblemError& refused) {
      CHECK_THAT(refused.what(), Contains("meet the wall"));
    }
  }
}

TEST_CASE("a wall says which of two fields it holds where an equation joins one with the slope of the other") {
  const auto cautions = [](const std::string& L, const std::string& wall) {
    const std::string text =
        "[field]\nfields = [\"u\", \"r\"]\nL = \"" + L + "\"\n[grid]\nx = { from = 0, to = 10, cells = 40, left = \"" +
        wall + "\", right = \"" + wall +
        "\" }\n[initial]\nu = \"exp(-4*(x - 5)^2)\"\nu_t = 0\nr = 0\nr_t = 0\n[scheme]\nlagrangian = "
        "\"fourier\"\nlevels = \"fixed\"\nstep = 0.05\nuntil = 0.1\n";
    const Folder folder;
    const Outcome outcome = run(parse_problem(text, "pair.toml"), {.output = folder / "a.h5", .threads = 1});
    std::string all;
    for (const std::string& warning : outcome.warnings) {
      all += warning + "\n";
    }
    return all;
  };
  const std::string beam = "u_t^2/2 + r_t^2/2 - (u_x - r)^2/2 - r_x^2/2";
  CHECK_THAT(cautions(beam, "fixed"), Contains("the fixed wall at x = 0 holds u and leaves r free"));
  CHECK_THAT(cautions(beam, "free"), Contains("the free wall at x = 10 holds r and leaves u free"));
  // The twin: fields that S alone joins.
  const std::string strings = "u_t^2/2 + r_t^2/2 - (u - r)^2/2 - u_x^2/2 - r_x^2/2";
  CHECK_THAT(cautions(strings, "fixed"), !Contains("leaves"));
  CHECK_THAT(cautions(strings, "free"), !Contains("leaves"));
}

TEST_CASE("what a stated action leaves undetermined, and another equation, are named between walls, too") {
  const auto warnings = [](const std::string& rate, const std::string& slope) {
    const std::string text =
        "[field]\nequation = \"u_tt = u_xx + u_yy - u\"\n[grid]\nx = { from = 0, to = 3, cells = 12, left = \"fixed\", "
        "right = \"fixed\" }\ny = { from = 0, to = 2, cells = 8, left = \"free\", right = \"free\" }\n[initial]\nu = "
        "\"sin(pi*x/3)\"\nu_t = 0\n[scheme]\nlagrangian = \"custom\"\nL = \"" +
        rate + " - " + slope +
        "*((u_010 - u_000)^2 + (u_011 - u_001)^2 + (u_110 - u_100)^2 + (u_111 - u_101)^2)/(8*dy^2) - ((u_001 - "
        "u_000)^2 + (u_011 - u_010)^2 + (u_101 - u_100)^2 + (u_111 - u_110)^2)/(8*dx^2) - (u_000^2 + u_001^2 + u_010^2 "
        "+ u_011^2 + u_100^2 + u_101^2 + u_110^2 + u_111^2)/16\"\nlevels = \"fixed\"\nstep = 0.02\nuntil = 0.02\n";
    const Folder folder;
    const Outcome outcome = run(parse_problem(text, "plane.toml"), {.output = folder / "a.h5", .threads = 1});
    std::string all;
    for (const std::string& warning : outcome.warnings) {
      all += warning + "\n";
    }
    return all;
  };
  const std::string nodes = "((u_100 - u_000)^2 + (u_101 - u_001)^2 + (u_110 - u_010)^2 + (u_111 - u_011)^2)/(8*h^2)";
  const std::string middle = "(u_100 + u_101 + u_110 + u_111 - u_000 - u_001 - u_010 - u_011)^2/(32*h^2)";
  CHECK_THAT(warnings(middle, "1"), Contains("sawtooth (-1)^i") && Contains("undetermined"));
  CHECK_THAT(warnings(nodes, "1.1"), Contains("does not approximate the equation"));
  CHECK_THAT(warnings(nodes, "1"), !Contains("undetermined") && !Contains("approximate"));
}
