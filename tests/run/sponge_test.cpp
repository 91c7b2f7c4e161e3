// [grid] sponge: layers at both ends of the range that damp what comes there, and the balance of their energy.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem_texts.hpp"
#include "records.hpp"
#include "run/mailboxes.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

/// A packet of waves of length 2 that travels to the right, into a layer of four of them.
constexpr const char* packet = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + g*u^4/4"
[parameters]
g = 0
[grid]
x = { from = -15, to = 15, cells = 301, sponge = { width = 8, strength = 1.5 } }
[initial]
u = "exp(-x^2/4)*cos(pi*x)"
v = "-dx(u)"
[invariants]
energy_of_u = "(v^2 + dx(u)^2)/2 + g*u^4/4"
[scheme]
lagrangian = "fourier"
levels = "fixed"
step = 0.05
until = 30
)toml";

Problem problem_of(const Settings& settings, const std::string& text = packet) {
  return parse_problem(text, "packet.toml", settings);
}

Outcome outcome_of(const Settings& settings, const std::string& text = packet) {
  const Folder folder;
  Outcome outcome = run(problem_of(settings, text), {.output = folder / "a.h5", .threads = 1});
  REQUIRE(outcome.complete);
  return outcome;
}

double lost(const Outcome& outcome) {
  return named(outcome.statistics.totals, "energy_lost").max();
}

std::string message(const Settings& settings, const std::string& text = packet) {
  return refusal(text, "packet.toml", settings);
}

}  // namespace

TEST_CASE("a pulse leaves through a sponge in each scheme") {
  for (const char* scheme : {"fourier", "box", "splitting", "leapfrog", "euler-box"}) {
    INFO(scheme);
    const Outcome outcome =
        outcome_of({fmt::format("scheme.lagrangian={}", scheme), "grid.x.cells=201", "scheme.step=0.06"});
    const figures::Deviation& energy = named(outcome.statistics.invariants, "energy_of_u");
    CHECK(energy.initial > 1.0);
    // What is left of the energy was reflected, or has passed both layers: exp(-2·8·1.5) of it.
    CHECK(std::abs(1.0 - energy.max() / energy.initial) < 1e-4);
  }
  // The twins: a layer that is short beside the wavelength reflects, and one that is weak lets pass.
  const double energy = outcome_of({"scheme.until=0.1"}).statistics.node_energy.initial;
  CHECK(lost(outcome_of({"grid.x.sponge.width=0.3", "grid.x.sponge.strength=40"})) / energy < 0.99);
  CHECK(lost(outcome_of({"grid.x.sponge.strength=0.2"})) / energy < 0.99);
}

TEST_CASE("the energy that a sponge takes closes the balance") {
  for (const char* scheme : {"fourier", "box"}) {
    INFO(scheme);
    const Outcome outcome = outcome_of(
        {fmt::format("scheme.lagrangian={}", scheme), "parameters.g=1", "scheme.levels=variable", "scheme.until=15"});
    REQUIRE(outcome.statistics.variable_levels());
    CHECK(outcome.statistics.off_law_steps == 0);
    CHECK(outcome.statistics.relative_energy_deviation().value() < 1e-12);
    CHECK(lost(outcome) > 0.5 * outcome.statistics.node_energy.initial);
    // The node energy H(z_k) with what was taken differs by the truncation error of the step.
    CHECK(outcome.statistics.node_energy.max() < 0.02 * outcome.statistics.node_energy.initial);
    // The twin: without it H changes by what was taken.
    const auto& H = named(outcome.statistics.invariants, "energy_of_u");
    CHECK(H.max() > 0.5 * outcome.statistics.node_energy.initial);
  }
}

TEST_CASE("a sponge takes energy in a run backward in time as well") {
  for (const char* scheme : {"fourier", "box", "leapfrog"}) {
    INFO(scheme);
    const Settings settings = {fmt::format("scheme.lagrangian={}", scheme), "grid.x.cells=201"};
    const auto lost_in = [&](double step, double until) {
      Settings all = settings;
      all.push_back(fmt::format("scheme.step={}", step));
      all.push_back(fmt::format("scheme.until={}", until));
      return lost(outcome_of(all));
    };
    // Backward the packet goes to the left, through the same layer.
    const double forward = lost_in(0.06, 30), backward = lost_in(-0.06, -30);
    CHECK(forward > 1.0);
    CHECK(backward == Approx(forward).epsilon(1e-3));
  }
}

TEST_CASE("local laws of a step hold between the layers, and in them") {
  const auto residuals = [](const std::string& text) {
    const Folder folder;
    static_cast<void>(
        run(problem_of({"scheme.until=1", "laws.fields=true"}, text), {.output = folder / "a.h5", .threads = 1}));
    return last_row(record::Reader(folder / "a.h5"), "/laws/fields/energy");
  };
  const std::vector<double> one = residuals(packet);
  const std::vector<double> other = residuals(with(packet, ", sponge = { width = 8, strength = 1.5 }", ""));
  double outside = 0.0;
  for (std::size_t i = 0; i < one.size(); ++i) {
    if (std::abs(-15.0 + 30.0 * static_cast<double>(i) / 301.0) < 7.0) {
      outside = std::max(outside, std::abs(one[i] - other[i]));
    }
  }
  // Rounding of densities of 10, over the step and the spacing.
  CHECK(outside < 1e-11);

  // Of the box, whose laws hold to rounding where S is quadratic, also while the packet is in the layer.
  const Settings box = {"scheme.lagrangian=box", "scheme.until=9"};
  for (const auto& law : outcome_of(box).statistics.residuals) {
    INFO(law.name);
    CHECK(law.value.max < 1e-10);
  }
  // The twin: from one level to the next, with the damping in it.
  const Problem problem = problem_of(box);
  LatticeIntegrator lattice = make_lattice(problem);
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
  }
  const auto method = make_bare_method(problem);
  LocalLaws bare = make_local_laws(*method, lattice.system(), lattice.grid());
  CHECK(bare.residuals(lattice.previous(), lattice.level(), lattice.levels().last_step()).front().largest() > 1e-2);
}

TEST_CASE("check and resume know of a sponge") {
  const Folder folder;
  for (const char* scheme : {"fourier", "box", "splitting", "leapfrog", "euler-box"}) {
    for (const char* levels : {"fixed", "variable"}) {
      if (std::string(levels) == "variable" && std::string(scheme) == "euler-box") {
        continue;
      }
      INFO(scheme << " " << levels);
      const Settings settings = {fmt::format("scheme.lagrangian={}", scheme),
                                 fmt::format("scheme.levels={}", levels),
                                 "scheme.until=8",
                                 "scheme.step=0.08",
                                 "parameters.g=0.5",
                                 "output.every=2",
                                 "levels.every=1",
                                 "grid.x.cells=101",
                                 "output.times=[4.03]"};
      static_cast<void>(run(problem_of(settings), {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
      const auto found = check(folder / "a.h5");
      CHECK(found.status == ExitStatus::done);
      static_cast<void>(run(problem_of(joined(settings, {"scheme.until=5"})),
                            {.output = folder / "part.h5", .overwrite = true, .threads = 1}));
      static_cast<void>(resume(folder / "part.h5", 8.0));
      const record::Reader whole(folder / "a.h5"), parts(folder / "part.h5");
      for (const char* path : {"/levels/node_energy", "/laws/totals/energy_lost"}) {
        CHECK(whole.read(path) == parts.read(path));
      }
    }
  }
  falsify(folder / "a.h5", "/laws/totals/energy_lost", 60, 1e-6);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
}

namespace {

/// The same packet between two kinds of walls.
std::string packet_between(const std::string& walls) {
  return with(packet, "cells = 301,", "cells = 300, " + walls + ",");
}
constexpr const char* fixed_and_free = R"(left = "fixed", right = "free")";

/// A breather's values drive the left end, and a layer ends the line.
constexpr const char* driven_line = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + 1 - cos(u)"
[parameters]
W = 0.6
A = 2
[grid]
x = { from = 0, to = 12, cells = 120, left = { u = "A*sin(2*W*t)*sin(W*t)^2" }, right = "free", sponge = { width = 6, strength = 2 } }
[initial]
u = "0"
v = "0"
[invariants]
energy_of_u = "(v^2 + w^2)/2 + 1 - cos(u)"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.05
until = 12
)toml";

}  // namespace

TEST_CASE("a pulse leaves through a layer beside a wall") {
  for (const char* scheme : {"fourier", "splitting", "leapfrog"}) {
    for (const bool is_swapped : {false, true}) {
      INFO(scheme << (is_swapped ? ", into the fixed wall" : ", into the free wall"));
      const std::string text = packet_between(is_swapped ? R"(left = "free", right = "fixed")" : fixed_and_free);
      const Outcome outcome =
          outcome_of({fmt::format("scheme.lagrangian={}", scheme), "grid.x.cells=200", "scheme.step=0.06"}, text);
      const figures::Deviation& energy = named(outcome.statistics.invariants, "energy_of_u");
      CHECK(energy.initial > 1.0);
      CHECK(std::abs(1.0 - energy.max() / energy.initial) < 1e-4);
    }
  }
  // The twin: a layer that is short beside the wavelength reflects.
  const double energy = outcome_of({"scheme.until=0.1"}, packet_between(fixed_and_free)).statistics.node_energy.initial;
  CHECK(lost(outcome_of({"grid.x.sponge.width=0.3", "grid.x.sponge.strength=40"}, packet_between(fixed_and_free))) /
            energy <
        0.99);
}

TEST_CASE("between walls the energy that a sponge takes closes the balance") {
  const Outcome outcome =
      outcome_of({"scheme.lagrangian=fourier", "parameters.g=1", "scheme.levels=variable", "scheme.until=15"},
                 packet_between(fixed_and_free));
  CHECK(outcome.statistics.off_law_steps == 0);
  CHECK(outcome.statistics.relative_energy_deviation().value() < 1e-12);
  // The twin: without it H changes by what was taken.
  CHECK(lost(outcome) > 0.5 * outcome.statistics.node_energy.initial);
  CHECK(named(outcome.statistics.invariants, "energy_of_u").max() > 0.5 * outcome.statistics.node_energy.initial);
}

TEST_CASE("the work of a driven wall is what the line has and its sponge took") {
  std::vector<double> balances;
  for (int halvings = 0; halvings < 3; ++halvings) {
    const Outcome outcome = outcome_of(
        {fmt::format("scheme.step={}", 0.05 / (1 << halvings)), fmt::format("grid.x.cells={}", 120 << halvings)},
        driven_line);
    balances.push_back(outcome.statistics.node_energy.max());
    // The twins: the balance needs the work and what was taken, each of them far above its error.
    CHECK(named(outcome.statistics.totals, "work").max() > 10.0 * balances.back());
    CHECK(outcome.statistics.energy_scale() == named(outcome.statistics.totals, "work").values.largest());
    CHECK(lost(outcome) > 10.0 * balances.back());
  }
  INFO("balances " << balances[0] << ", " << balances[1] << ", " << balances[2]);
  for (std::size_t i = 0; i < 2; ++i) {
    CHECK(std::log2(balances[i] / balances[i + 1]) == Approx(2.0).margin(0.3));
  }
}

TEST_CASE("layers across a driven wall leave what it gives") {
  const std::string plane = R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2 + 1 - cos(u)"
[grid]
x = { from = 0, to = 6, cells = 30, left = { u = "sin(1.5*t)^3*cos(pi*y/3)" }, right = "free", sponge = { width = 3, strength = 2 } }
y = { from = 0, to = 6, cells = 30, sponge = { width = 2, strength = 2 } }
[initial]
u = "0"
v = "0"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.05
until = 3
)toml";
  const Folder folder;
  const Outcome outcome = run(problem_of({}, plane), {.output = folder / "a.h5", .threads = 1});
  CHECK(lost(outcome) > 0.1);
  CHECK(check(folder / "a.h5").status == ExitStatus::done);
  const std::vector<double> u = last_row(record::Reader(folder / "a.h5"), "/states/u");
  const double given = std::pow(std::sin(4.5), 3);
  CHECK(u[0] == Approx(given));  // where the layer along y is strongest
  CHECK(u[15 * 31] == Approx(-given));
  // The twin: one node inside, it is damped.
  CHECK(std::abs(u[1] / u[15 * 31 + 1]) < 0.9);
}

TEST_CASE("check and resume know of a sponge between walls") {
  const Folder folder;
  const Settings action = {
      "scheme.lagrangian=custom",
      "scheme.L=((u_10 - u_00)^2 + (u_11 - u_01)^2)/(4*h^2) - ((u_01 - u_00)^2 + (u_11 - u_10)^2)/(4*dx^2) - 1 + "
      "(cos(u_00) + cos(u_01) + cos(u_10) + cos(u_11))/4"};
  const auto look_at = [&](const std::string& text, const Settings& settings, double until, const std::string& part,
                           const std::vector<std::string>& paths) {
    INFO(settings.front());
    static_cast<void>(run(problem_of(settings, text), {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
    static_cast<void>(run(problem_of(joined(settings, {"scheme.until=" + part}), text),
                          {.output = folder / "part.h5", .overwrite = true, .threads = 1}));
    static_cast<void>(resume(folder / "part.h5", until));
    const record::Reader whole(folder / "a.h5"), parts(folder / "part.h5");
    for (const std::string& path : paths) {
      CHECK(whole.read(path) == parts.read(path));
    }
  };
  for (const char* scheme : {"fourier", "splitting", "leapfrog"}) {
    look_at(packet_between(fixed_and_free),
            {fmt::format("scheme.lagrangian={}", scheme), "scheme.levels=variable", "scheme.until=8",
             "scheme.step=0.08", "parameters.g=0.5", "grid.x.cells=100"},
            8.0, "5", {"/levels/node_energy", "/laws/totals/energy_lost"});
  }
  for (const Settings& scheme : {Settings{"scheme.lagrangian=leapfrog"}, action}) {
    look_at(driven_line, scheme, 12.0, "7", {"/levels/node_energy", "/laws/totals/energy_lost", "/laws/totals/work"});
  }
  falsify(folder / "a.h5", "/laws/totals/energy_lost", 200, 1e-6);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
}

namespace {

/// Whether the driven end of the catalogue's line sends in within 40 periods what is large far from it, where the
/// evanescent wave of the end is not.
bool emits(double omega, double amplitude, int cells, const Settings& more = {}) {
  const double length = 80.0, far = 10.0;
  const double period = 2.0 * std::acos(-1.0) / omega;
  LatticeIntegrator lattice = make_lattice(read_problem(
      "supratransmission",
      joined({fmt::format("parameters.omega={}", omega), fmt::format("parameters.amplitude={:.17g}", amplitude),
              fmt::format("grid.x.cells={}", cells), fmt::format("scheme.step={}", 40.0 / cells),
              fmt::format("scheme.until={:.17g}", 40.0 * period)},
             more)));
  const auto first = static_cast<std::size_t>(std::lround(far / length * cells));
  while (!lattice.finished()) {
    if (lattice.step().status != Status::success) {
      FAIL("a step failed");
    }
    const auto u = lattice.field(0);
    if (std::ranges::any_of(u.subspan(first), [](double value) { return std::abs(value) > 1.0; })) {
      return true;
    }
  }
  return false;
}

/// Geniet and Leon (2002), for the wave of a sine-Gordon breather at rest.
double published_threshold(double omega) {
  return 4.0 * std::atan(std::sqrt(1.0 - omega * omega) / omega);
}

/// By bisection, to 1e-3 of the published one.
double threshold(double omega, int cells) {
  double below = 0.9 * published_threshold(omega), above = 1.1 * published_threshold(omega);
  REQUIRE(!emits(omega, below, cells));
  REQUIRE(emits(omega, above, cells));
  while (above - below > 1e-3 * published_threshold(omega)) {
    const double middle = 0.5 * (below + above);
    (emits(omega, middle, cells) ? above : below) = middle;
  }
  return 0.5 * (below + above);
}

}  // namespace

TEST_CASE("a driven end emits breathers above a threshold that is converged, and near the published one", "[long]") {
  for (const double omega : {0.7, 0.75, 0.85, 0.95}) {
    const double coarse = threshold(omega, 400), fine = threshold(omega, 800);
    INFO("omega " << omega << ": " << coarse << ", " << fine << ", published " << published_threshold(omega));
    CHECK(std::abs(coarse / fine - 1.0) < 0.01);
    // Towards smaller frequencies, whose breathers are larger, a sine is less and less the wave of one.
    CHECK(std::abs(fine / published_threshold(omega) - 1.0) < (omega < 0.75 ? 0.07 : 0.05));
  }
  CHECK(std::abs(threshold(0.9, 800) / threshold(0.9, 1600) - 1.0) < 0.01);
  // The twin: small waves have no threshold below which they stay out but their frequency.
  const Settings linear = {"multisymplectic.S=(v^2 - w^2 + u^2)/2"};
  CHECK(!emits(0.9, 4.0 * published_threshold(0.9), 400, linear));
  CHECK(emits(1.1, 2.0, 400, joined(linear, {"parameters.kappa=1"})));
}

TEST_CASE("sponges are refused where there can be none, with place, reason and remedy") {
  CHECK(message({}).empty());
  CHECK_THAT(message({}, with(packet, "width = 8", "width = 15")), Contains("packet.toml:10:") && Contains("half of"));
  CHECK_THAT(message({"grid.x.sponge.width=-1"}), Contains("width") && Contains("more than 0"));
  CHECK_THAT(message({"grid.x.sponge.strength=-1"}), Contains("strength") && Contains("leave sponge out"));
  CHECK_THAT(message({"grid.x.sponge.depth=-1"}), Contains("depth"));
  CHECK_THAT(message({"scheme.frame.velocity=0.5"}), Contains("frame"));
  CHECK_THAT(message({"grid.x.jump.u=0.5"}), Contains("jump"));
  CHECK_THAT(message({"output.every=2"}), Contains("every level"));
  CHECK(message({"grid.x.sponge.width=11"}, driven_line).empty());  // one layer
  CHECK_THAT(message({"grid.x.sponge.width=12"}, driven_line), Contains("sponge") && Contains("less than the range"));
  CHECK_THAT(message({}, with(driven_line, "right = \"free\"", "right = { u = \"sin(t)\" }")),
             Contains("both walls") && Contains("leave sponge out", Catch::CaseSensitive::No));
  const std::string kdv =
      "[multisymplectic]\nequation = \"kdv\"\n[grid]\nx = { from = 0, to = 6, cells = 31, sponge = { width = 1, "
      "strength = 1 } }\n[initial]\nu = \"cos(pi*x/3)\"\n[scheme]\nlagrangian = \"box\"\nlevels = \"fixed\"\nstep = "
      "0.01\nuntil = 0.1\n";
  CHECK_THAT(message({}, kdv), Contains("u is a derivative of"));

  const Folder folder;
  const auto shared = [&](const Settings& settings) -> std::string {
    const Problem problem = problem_of(joined({"scheme.lagrangian=leapfrog", "scheme.until=1"}, settings));
    try {
      static_cast<void>(with_ranks(2, [&](auto& rank) { return run(problem, on(rank, folder / "a.h5")); }));
    } catch (const ProblemError& error) {
      return error.what();
    }
    return "";
  };
  CHECK_THAT(shared({}),
             Contains("packet.toml:10:") && Contains("2 ranks cannot share this run") && Contains("sponge"));
}
