// [grid] left = { u = "sin(t)" }: walls that give fields their values in time, and the work that they do.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/catalogue/catalogue.hpp>
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

/// A breather whose middle is at x = 2: both walls move as it does.
constexpr const char* driven_breather = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + 1 - cos(u)"
[parameters]
W = 0.6
g = "sqrt(1 - W^2)"
[definitions]
breather = "4*atan(g/W*sin(W*t)*sech(g*(x - 2)))"
[grid]
x = { from = 0, to = 6, cells = 60, left = { u = "4*atan(g/W*sin(W*t)*sech(2*g))" }, right = { u = "breather" } }
[initial]
t = 0.5
u = "breather"
v = "4*g*cos(W*t)*sech(g*(x - 2))/(1 + (g/W*sin(W*t)*sech(g*(x - 2)))^2)"
[exact]
u = "breather"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.05
until = 8.5
)toml";

/// The equation as an action of corners.
const Settings driven_action = {
    "scheme.lagrangian=custom",
    "scheme.L=((u_10 - u_00)^2 + (u_11 - u_01)^2)/(4*h^2) - ((u_01 - u_00)^2 + (u_11 - u_10)^2)/(4*dx^2) - 1 + "
    "(cos(u_00) + cos(u_01) + cos(u_10) + cos(u_11))/4"};

Outcome driven_outcome(const Settings& settings, const std::string& problem = driven_breather) {
  const Folder folder;
  Outcome outcome = run(parse_problem(problem, "driven.toml", settings), {.output = folder / "a.h5", .threads = 1});
  REQUIRE(outcome.complete);
  return outcome;
}

const figures::Deviation& work_of(const Outcome& outcome) {
  const auto found =
      std::ranges::find(outcome.statistics.totals, std::string("work"), &figures::Named<figures::Deviation>::name);
  REQUIRE(found != outcome.statistics.totals.end());
  return found->value;
}

std::string driven_refusal(const Settings& settings, const std::string& problem = driven_breather) {
  return refusal_at_start(problem, "driven.toml", settings);
}

}  // namespace

TEST_CASE("walls that move as a breather lead it with the order of the scheme, and their work balances its energy") {
  for (const Settings& scheme : {Settings{}, Settings{"scheme.lagrangian=box"}, driven_action}) {
    std::vector<double> errors, balances;
    double work = 0.0;
    for (int halvings = 0; halvings < 3; ++halvings) {
      const Outcome outcome = driven_outcome(joined(scheme, {fmt::format("scheme.step={}", 0.05 / (1 << halvings)),
                                                             fmt::format("grid.x.cells={}", 60 << halvings)}));
      errors.push_back(outcome.statistics.errors.front().value.largest());
      balances.push_back(outcome.statistics.node_energy.max());  // less the work
      work = work_of(outcome).max();
    }
    INFO("errors " << errors[0] << ", " << errors[1] << ", " << errors[2] << ", balances " << balances[0] << ", "
                   << balances[1] << ", " << balances[2] << ", work " << work);
    for (std::size_t i = 0; i < 2; ++i) {
      CHECK(std::log2(errors[i] / errors[i + 1]) == Approx(2.0).margin(0.3));
      CHECK(std::log2(balances[i] / balances[i + 1]) == Approx(2.0).margin(0.3));
    }
    // The twin: without the work the energy changes by a good part of that of the breather, 16 g = 12.8.
    CHECK(work > 1.0);
    CHECK(balances.front() < 0.02 * work);
  }
  // The twin: a wall that goes elsewhere.
  CHECK(driven_outcome(
            {}, with(driven_breather, "right = { u = \"breather\" }", "right = { u = \"breather + (t - 0.5)/4\" }"))
            .statistics.errors.front()
            .value.largest() > 0.1);
}

TEST_CASE("data between driven walls have nothing to close on, as those of a ring have") {
  const Folder folder;
  const auto period_of = [&](const Problem& problem) {
    const auto found = run(problem, {.output = folder / "a.h5", .overwrite = true, .threads = 1}).judgement.reasons;
    return std::ranges::count(found, figures::ReasonKind::period, &figures::Reason::kind);
  };
  CHECK(period_of(read_problem("driven-end")) == 0);
  // The twin: the same half of a breather on a ring.
  std::string ring(std::ranges::find(catalogue::entries(), "driven-end", &catalogue::Entry::name)->text);
  const std::size_t walls = ring.find(", left ="), end = ring.find('\n', walls);
  ring.replace(walls, end - walls, " }");
  CHECK(period_of(parse_problem(ring, "ring.toml")) == 1);
}

namespace {

/// A wave that both walls along x give to a plane, one way along y.
constexpr const char* plane = R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2"
[parameters]
k = "pi"
w = "sqrt(4 + k^2)"
[definitions]
wave = "sin(2*x - w*t)*cos(k*y)"
[grid]
x = { from = 0, to = 2, cells = 20, left = { u = "wave" }, right = { u = "wave" } }
y = { from = 0, to = 1, cells = 10, left = "free", right = "free" }
[initial]
u = "wave"
v = "-w*cos(2*x - w*t)*cos(k*y)"
[exact]
u = "wave"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.04
until = 2
)toml";

}  // namespace

TEST_CASE("a wall gives a plane values that depend on the place along it") {
  std::vector<double> errors, balances;
  for (int halvings = 0; halvings < 3; ++halvings) {
    const Outcome outcome =
        driven_outcome({fmt::format("scheme.step={}", 0.04 / (1 << halvings)),
                        fmt::format("grid.x.cells={}", 20 << halvings), fmt::format("grid.y.cells={}", 10 << halvings)},
                       plane);
    errors.push_back(outcome.statistics.errors.front().value.largest());
    balances.push_back(outcome.statistics.node_energy.max());
  }
  INFO("errors " << errors[0] << ", " << errors[1] << ", " << errors[2] << ", balances " << balances[0] << ", "
                 << balances[1] << ", " << balances[2]);
  for (std::size_t i = 0; i < 2; ++i) {
    CHECK(std::log2(errors[i] / errors[i + 1]) == Approx(2.0).margin(0.3));
    CHECK(std::log2(balances[i] / balances[i + 1]) == Approx(2.0).margin(0.3));
  }
}

TEST_CASE("records of driven walls are checked and resumed") {
  const Folder folder;
  static_cast<void>(run(parse_problem(plane, "plane.toml", Settings{}), {.output = folder / "plane.h5", .threads = 1}));
  CHECK(check(folder / "plane.h5").status == ExitStatus::done);
  for (const Settings& scheme : {Settings{}, Settings{"scheme.lagrangian=box"}, driven_action}) {
    static_cast<void>(run(parse_problem(driven_breather, "driven.toml", scheme),
                          {.output = folder / "a.h5", .overwrite = true, .threads = 1}));
    static_cast<void>(run(parse_problem(driven_breather, "driven.toml", joined(scheme, {"scheme.until=3"})),
                          {.output = folder / "part.h5", .overwrite = true, .threads = 1}));
    static_cast<void>(resume(folder / "part.h5", 8.5));
    const record::Reader whole(folder / "a.h5"), parts(folder / "part.h5");
    for (const char* path : {"/levels/node_energy", "/levels/energy", "/laws/totals/work"}) {
      CHECK(whole.read(path) == parts.read(path));
    }
    CHECK(last_row(whole, "/states/u") == last_row(parts, "/states/u"));
    CHECK(check(folder / "a.h5").status == ExitStatus::done);
  }
  falsify(folder / "a.h5", "/laws/totals/work", 40, 1e-6);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
}

TEST_CASE("between levels a driven wall has the value of its time, and so have the nodes beside it") {
  const Folder folder;
  const std::string file = folder / "a.h5";
  const auto breather = [](double x, double t) {
    const double W = 0.6, g = std::sqrt(1.0 - W * W);
    return 4.0 * std::atan(g / W * std::sin(W * t) / std::cosh(g * (x - 2.0)));
  };
  for (Settings settings : {Settings{"scheme.lagrangian=leapfrog"}, Settings{"scheme.lagrangian=box"}, driven_action}) {
    INFO(settings.front());
    for (const char* more : {"output.interval=0.13", "output.every=3",
                             "events.one={ crossing = \"u - 1\", at = { x = 0 } }", "scheme.until=4.5"}) {
      settings.emplace_back(more);
    }
    REQUIRE(
        run(parse_problem(driven_breather, "driven.toml", settings), {.output = file, .overwrite = true, .threads = 1})
            .complete);
    CHECK(check(file).status == ExitStatus::done);
    const record::Reader reader(file);
    constexpr std::size_t nodes = 61;
    const auto error = [&](const std::string& group, std::size_t first, std::size_t last, double shift = 0.0) {
      const std::vector<double> t = reader.read(group + "/t"), u = reader.read(group + "/u");
      REQUIRE(u.size() == nodes * t.size());
      double largest = 0.0;
      for (std::size_t i = 0; i < u.size(); ++i) {
        if (i % nodes >= first && i % nodes <= last) {
          const double x = 0.1 * static_cast<double>(i % nodes);
          largest = std::max(largest, std::abs(u[i] - breather(x, t[i / nodes] + shift)));
        }
      }
      return largest;
    };
    CHECK(error("/output", 0, 0) < 1e-14);
    CHECK(error("/output", nodes - 1, nodes - 1) < 1e-14);
    CHECK(error("/output", 0, 0, 0.025) > 1e-3);  // the twin: half a step off
    // Steps over a part have errors of their own, h² of them, as those from level to level.
    CHECK(error("/output", 0, nodes - 1) < 2.0 * error("/states", 0, nodes - 1));
    const std::vector<double> crossed = reader.read("/events/one/t");
    REQUIRE(crossed.size() == 2);  // up and down
    CHECK(std::abs(breather(0.0, crossed.front()) - 1.0) < 1e-10);
    CHECK(std::abs(breather(0.0, crossed.back()) - 1.0) < 1e-10);
  }
}

TEST_CASE("the work of walls, and what a sponge takes, are reported at every level whatever laws are taken") {
  const Folder folder;
  const std::string layer =
      with(driven_breather, "right = { u = \"breather\" }", "right = \"free\", sponge = { width = 3, strength = 1 }");
  for (const std::string& text : {std::string(driven_breather), with(layer, "[exact]\nu = \"breather\"\n", "")}) {
    std::vector<std::vector<double>> work;
    for (const char* every : {"1", "2", "false"}) {
      INFO("every = " << every);
      const Problem problem = parse_problem(text, "driven.toml", Settings{fmt::format("laws.every={}", every)});
      const Outcome outcome = run(problem, {.output = folder / "a.h5", .overwrite = true, .threads = 1});
      const auto found = check(folder / "a.h5");
      CHECK(found.status == ExitStatus::done);
      work.push_back(record::Reader(folder / "a.h5").read("/laws/totals/work"));
      CHECK(std::ranges::all_of(work.back(), [](double value) { return std::isfinite(value); }));
      CHECK(work.back() == work.front());
      CHECK(work_of(found).max() == work_of(outcome).max());
      CHECK(work_of(outcome).max() > 0.1);
      static_cast<void>(
          run(parse_problem(text, "driven.toml", Settings{fmt::format("laws.every={}", every), "scheme.until=3"}),
              {.output = folder / "part.h5", .overwrite = true, .threads = 1}));
      static_cast<void>(resume(folder / "part.h5", 8.5));
      CHECK(record::Reader(folder / "part.h5").read("/laws/totals/work") == work.front());
    }
  }
  // The twin.
  falsify(folder / "a.h5", "/laws/totals/energy_lost", 41, 1e-6);
  CHECK(check(folder / "a.h5").status == ExitStatus::contradiction);
}

TEST_CASE("what a driven wall gives is compared with its formula") {
  const Folder folder;
  static_cast<void>(run(parse_problem(driven_breather, "driven.toml", Settings{}), {.output = folder / "a.h5"}));
  const auto wall = [&] {
    const auto all = check(folder / "a.h5").disagreements;
    return std::ranges::count(all, std::string("what a wall of [grid] gives"), &Disagreement::reason);
  };
  CHECK(wall() == 0);
  constexpr std::size_t nodes = 61;
  falsify(folder / "a.h5", "/states/u", 20 * nodes + nodes - 1, 1e-9);
  CHECK(wall() == 1);
  falsify(folder / "a.h5", "/states/v", 20 * nodes, 1e-9);
  CHECK(wall() == 2);
}

TEST_CASE("driven walls are refused where they cannot be, and data that do not meet them reported") {
  CHECK(driven_refusal({}).empty());
  CHECK_THAT(driven_refusal({"scheme.levels=variable"}), Contains("levels") && Contains("fixed"));
  CHECK_THAT(driven_refusal({"scheme.lagrangian=fourier"}), Contains("leapfrog") && Contains("on a line, box"));
  CHECK_THAT(driven_refusal({}, with(driven_breather, "right = { u", "right = { q")), Contains("q is not a field"));
  CHECK_THAT(driven_refusal({}, with(driven_breather, "right = { u", "right = { w")), Contains("cannot drive w"));
  CHECK_THAT(driven_refusal({}, with(driven_breather, "right = { u = \"breather\"", "right = { u = \"u + t\"")),
             Contains("driven.toml:13:"));
  CHECK_THAT(driven_refusal({"initial.u=1"}), Contains("u differs by") && Contains("meet the wall"));
  const auto cautions = make_lattice(parse_problem(driven_breather, "driven.toml", Settings{"initial.v=0"})).cautions();
  REQUIRE(!cautions.empty());
  CHECK_THAT(cautions.front(), Contains("v misses by") && Contains("short waves"));
}
