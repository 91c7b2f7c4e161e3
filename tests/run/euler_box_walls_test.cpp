// Walls of euler-box: rows that are solved by iteration, planes, energies, and what it has no walls for.

#include <catch2/catch.hpp>

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

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

/// Rows of p and q are not linear in what they give.
constexpr const char* euler_box_schroedinger = R"toml(
[multisymplectic]
fields = ["p", "q", "a", "b"]
M = [["p", "q", 1]]
K.x = [["p", "a", -1], ["q", "b", -1]]
S = "(a^2 + b^2)/2 + (p^2 + q^2)^2/2"
[grid]
x = { from = 0, to = 8, cells = 40 }
[initial]
p = "0"
q = "0"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.005
until = 0.5
)toml";

constexpr const char* euler_box_plane = R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2 + 1 - cos(u)"
[grid]
x = { from = 0, to = 4, cells = 20 }
y = { from = 0, to = 3, cells = 15 }
[initial]
u = "2*sin(pi*x/4)*(1 + cos(pi*y/3))"
v = "sin(pi*x/2)*cos(pi*y/3)"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.05
until = 2
)toml";

constexpr const char* euler_box_line = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + u^2/2 + u^3/3"
[grid]
x = { from = 0, to = 2, cells = 20, left = "fixed", right = "fixed" }
[initial]
u = "1 + x/2 + sin(pi*x/2)/4"
v = "0"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.02
until = 2
)toml";

struct EulerBoxRun {
  std::vector<double> last, energies;
};

EulerBoxRun euler_box_run(const std::string& problem, const Settings& settings, const char* field) {
  const Folder folder;
  REQUIRE(
      run(parse_problem(problem, "walls.toml", settings), {.output = folder / "a.h5", .overwrite = true, .threads = 1})
          .complete);
  CHECK(check(folder / "a.h5").status == ExitStatus::done);
  const record::Reader reader(folder / "a.h5");
  return {last_row(reader, fmt::format("/states/{}", field)), reader.read("/levels/node_energy")};
}

std::string euler_box_refusal(const std::string& problem, const Settings& settings) {
  return refusal_at_start(problem, "walls.toml", settings);
}

}  // namespace

TEST_CASE("between walls euler-box iterates rows as on the ring, and has half of its energy") {
  struct Case {
    const char* wall;
    Settings initial;
  };
  const std::vector<Case> cases = {
      {"free",
       {"initial.p=(3 + 2*cos(pi*x/8) + cos(pi*x/2))/5", "initial.q=cos(pi*x/4)/2", "grid.x.to=16", "grid.x.cells=80"}},
      {"fixed",
       {"initial.p=sin(pi*x/8) + sin(pi*x/2)/5", "initial.q=sin(pi*x/4)/2", "grid.x.to=16", "grid.x.cells=80"}}};
  for (const Case& one : cases) {
    INFO(one.wall);
    const EulerBoxRun ring = euler_box_run(euler_box_schroedinger, one.initial, "p");
    const Settings walls = joined({one.initial[0], one.initial[1]},
                                  {fmt::format("grid.x.left={}", one.wall), fmt::format("grid.x.right={}", one.wall)});
    const EulerBoxRun between = euler_box_run(euler_box_schroedinger, walls, "p");
    // 100 steps, each solved to some roundings of numbers of 1, over the width of a cell squared.
    CHECK(largest_distance(between.last, {ring.last.begin(), ring.last.begin() + 41}) < 1e-12);
    for (std::size_t k = 0; k < ring.energies.size(); ++k) {
      CHECK(std::abs(between.energies[k] - ring.energies[k] / 2.0) < 1e-12);
    }
    // The twin: the other kind of wall.
    const char* const other = std::string(one.wall) == "free" ? "left=fixed" : "left=free";
    CHECK(largest_distance(
              euler_box_run(euler_box_schroedinger, joined(walls, {fmt::format("grid.x.{}", other)}), "p").last,
              between.last) > 1e-3);
  }
}

TEST_CASE("a plane of euler-box between walls is a quarter of a ring") {
  const EulerBoxRun ring =
      euler_box_run(euler_box_plane, {"grid.x.to=8", "grid.x.cells=40", "grid.y.to=6", "grid.y.cells=30"}, "u");
  const EulerBoxRun between = euler_box_run(
      euler_box_plane, {"grid.x.left=fixed", "grid.x.right=fixed", "grid.y.left=free", "grid.y.right=free"}, "u");
  REQUIRE(between.last.size() == 21 * 16);
  double most = 0.0, twin = 0.0;
  for (std::size_t j = 0; j < 16; ++j) {
    for (std::size_t i = 0; i < 21; ++i) {
      most = std::max(most, std::abs(between.last[i + 21 * j] - ring.last[i + 40 * j]));
      twin = std::max(twin, std::abs(between.last[i + 21 * j] - ring.last[i + 1 + 40 * j]));
    }
  }
  CHECK(most < 1e-12);  // some roundings of numbers of 4 in each of 40 steps
  CHECK(twin > 0.1);
  for (std::size_t k = 0; k < ring.energies.size(); ++k) {
    CHECK(between.energies[k] == Approx(ring.energies[k] / 4.0).epsilon(1e-13));
  }
}

TEST_CASE("euler-box holds what walls begin with, whatever S is in a mirror, and has its energy") {
  const double dx = 0.1, h = 0.02;
  const auto by_hand = [&](double cubic) {
    std::vector<double> u(21), v(21, 0.0), energies;
    for (std::size_t i = 0; i < u.size(); ++i) {
      const double x = dx * static_cast<double>(i);
      u[i] = 1.0 + x / 2.0 + std::sin(M_PI * x / 2.0) / 4.0;
    }
    const auto energy = [&] {
      double sum = 0.0;
      for (std::size_t i = 0; i < u.size(); ++i) {
        const double weight = i == 0 || i == 20 ? 0.5 : 1.0;
        sum += dx * weight * (v[i] * v[i] / 2.0 + u[i] * u[i] / 2.0 + cubic * u[i] * u[i] * u[i] / 3.0);
        sum += i == 20 ? 0.0 : (u[i + 1] - u[i]) * (u[i + 1] - u[i]) / (2.0 * dx);
      }
      return sum;
    };
    energies.push_back(energy());
    for (int step = 0; step < 100; ++step) {
      for (std::size_t i = 1; i + 1 < u.size(); ++i) {
        v[i] += h * ((u[i + 1] - 2.0 * u[i] + u[i - 1]) / (dx * dx) - u[i] - cubic * u[i] * u[i]);
      }
      for (std::size_t i = 1; i + 1 < u.size(); ++i) {
        u[i] += h * v[i];
      }
      energies.push_back(energy());
    }
    return EulerBoxRun{u, energies};
  };
  const EulerBoxRun here = euler_box_run(euler_box_line, {}, "u"), same = by_hand(1.0);
  CHECK(largest_distance(here.last, same.last) < 1e-12);  // as above, of numbers of 2
  CHECK(largest_distance(here.energies, same.energies) < 1e-12);
  // The twin: another force.
  CHECK(largest_distance(here.last, by_hand(0.99).last) > 1e-4);
}

TEST_CASE("euler-box refuses walls that it has not, with reason and remedy") {
  const Settings free = {"grid.x.left=free"};
  CHECK(euler_box_refusal(euler_box_line, free).empty());
  CHECK(euler_box_refusal(with(euler_box_line, "+ u^3/3", "+ (1 + x)*u^3/3"), free).empty());
  CHECK_THAT(euler_box_refusal(euler_box_line, {"grid.x.left={u=\"1 + t\"}"}),
             Contains("no walls that drive") && Contains("leapfrog"));
  CHECK_THAT(euler_box_refusal(with(euler_box_line, "w^2)/2", "w^2)/2 - x*w^2/9"), {}),
             Contains("x") && Contains("between nodes") && Contains("fourier"));
  CHECK_THAT(euler_box_refusal(with(euler_box_line, "u^3/3", "u*w/9"), {}), Contains("u") && Contains("between nodes"));
  // Where both walls are fixed no sign of w changes.
  CHECK(euler_box_refusal(with(euler_box_line, "w^2)/2", "w^2)/2 - w/9"), {}).empty());
  CHECK_THAT(euler_box_refusal(with(euler_box_line, "w^2)/2", "w^2)/2 - w/9"), free),
             Contains("w") && Contains("mirror"));
  CHECK_THAT(euler_box_refusal(
                 with(with(euler_box_line, "fields = [\"u\", \"v\", \"w\"]", "fields = [\"u\", \"v\", \"w\", \"r\"]"),
                      "M = [[\"u\", \"v\", -1]]", "M = [[\"u\", \"v\", -1], [\"w\", \"r\", -1]]"),
                 {"multisymplectic.S=v^2/2 + r^2/2 + u^2/2 + w^2/2", "initial.w=0", "initial.r=0"}),
             Contains("joins") && Contains("w") && Contains("fourier"));
}
