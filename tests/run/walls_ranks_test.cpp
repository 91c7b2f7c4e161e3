// Walls of lattices that ranks share, along the axis of their parts and across it: levels, laws, work and invariants
// are those of one process. Ranks are threads, as in lattice_ranks_test.cpp.

#include <catch2/catch.hpp>

#include <cmath>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/record/reader.hpp>
#include <rubato/run/check.hpp>

#include "run/mailboxes.hpp"
#include "run/problem_texts.hpp"
#include "run/records.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Matchers::Contains;

namespace {

/// Between two values that the walls hold, or free; S is not the same in a mirror.
constexpr const char* walled_line = R"toml(
[multisymplectic]
fields = ["u", "v", "w"]
M = [["u", "v", -1]]
K.x = [["u", "w", 1]]
S = "(v^2 - w^2)/2 + u^2/2 + u^3/3"
[grid]
x = { from = 0, to = 2, cells = 61, left = "fixed", right = "fixed" }
[initial]
u = "1 + x/2 + sin(pi*x/2)/4"
v = "0"
[invariants]
slope = "dx(u)^2 + x*dx(dx(u))"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.01
until = 0.3
[output]
every = 7
)toml";

constexpr const char* walled_plane = R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2 + 1 - cos(u)"
[grid]
x = { from = 0, to = 4, cells = 17 }
y = { from = 0, to = 3, cells = 44 }
[initial]
u = "2*sin(pi*x/2)*(1 + cos(2*pi*y/3))"
v = "sin(pi*x/2)*cos(2*pi*y/3)"
[invariants]
slope = "dx(u)*dy(u) + b*dy(dy(u))"
[scheme]
lagrangian = "leapfrog"
levels = "fixed"
step = 0.02
until = 0.6
[output]
every = 7
)toml";

/// Rows of p and q are not linear in what they give.
constexpr const char* walled_schroedinger = R"toml(
[multisymplectic]
fields = ["p", "q", "a", "b"]
M = [["p", "q", 1]]
K.x = [["p", "a", -1], ["q", "b", -1]]
S = "(a^2 + b^2)/2 + (p^2 + q^2)^2/2"
[grid]
x = { from = 0, to = 8, cells = 63, left = "free", right = "fixed" }
[initial]
p = "cos(pi*x/16)"
q = "cos(3*pi*x/16)/2"
[scheme]
lagrangian = "euler-box"
levels = "fixed"
step = 0.002
until = 0.1
)toml";

const Settings walls_in_x = {"grid.x.left=fixed", "grid.x.right=fixed"};
const Settings walls_in_y = {"grid.y.left=free", "grid.y.right=free"};
const Settings driven_in_x = {"grid.x.left.u=cos(2*pi*y/3)*sin(3*t)", "grid.x.right=fixed"};
const Settings driven_in_y = {"grid.y.left.u=2*sin(pi*x/2)*(2 + sin(3*t))", "grid.y.right=free"};

struct SharedWalls {
  std::string text;
  Settings settings;
};

}  // namespace

TEST_CASE("lattices between walls are the same for every number of ranks") {
  const auto [text, settings] = GENERATE(
      SharedWalls{walled_line, {}}, SharedWalls{walled_line, {"scheme.levels=variable"}},
      SharedWalls{walled_line, {"scheme.lagrangian=euler-box"}},
      SharedWalls{walled_line, {"grid.x.left=free", "grid.x.right=free", "initial.u=cos(pi*x)"}},
      SharedWalls{with(walled_line, "left = \"fixed\"", "left = { u = \"1 + sin(2*t)\" }"), {"initial.v=2*exp(-10*x)"}},
      SharedWalls{walled_schroedinger, {}}, SharedWalls{walled_plane, walls_in_x},
      SharedWalls{walled_plane, walls_in_y}, SharedWalls{walled_plane, joined(walls_in_x, walls_in_y)},
      SharedWalls{walled_plane, joined(joined(walls_in_x, walls_in_y), {"scheme.lagrangian=euler-box"})},
      SharedWalls{walled_plane, joined(joined(walls_in_x, walls_in_y), {"scheme.levels=variable"})},
      SharedWalls{walled_plane, joined(driven_in_x, {"initial.v=3*cos(2*pi*y/3)*exp(-4*x)", "initial.u=0"})},
      SharedWalls{walled_plane, joined(joined(walls_in_x, driven_in_y),
                                       {"initial.u=4*sin(pi*x/2)", "initial.v=6*sin(pi*x/2)*exp(-4*y)"})});
  INFO(fmt::format("{} {}", text, fmt::join(settings, " ")));
  const Folder folder;
  check_shared_run(
      folder, [&](const Settings& more) { return parse_problem(text, "walls.toml", joined(settings, more)); },
      text == walled_schroedinger ? "0.05" : "0.14", {2, 3}, false, Continued::last);

  // The twin: all that the rank in the middle sends after a while.
  const Problem whole = parse_problem(text, "walls.toml", settings);
  Mailboxes tampered(3);
  tampered.tamper_with([sent = 0](int from, std::vector<double>& numbers) mutable {
    if (from == 1 && ++sent > 60) {
      for (double& number : numbers) {
        number += 1e-6;
      }
    }
  });
  static_cast<void>(with_ranks(tampered, [&](auto& rank) { return run(whole, on(rank, folder / "all.h5")); }));
  CHECK_FALSE(different_on_ranks(folder / "one.h5", folder / "all.h5").empty());
}

TEST_CASE("a record whose driven wall went elsewhere is found out by ranks as by one process") {
  const Folder folder;
  const Problem problem = parse_problem(walled_plane, "walls.toml",
                                        joined(driven_in_x, {"initial.v=3*cos(2*pi*y/3)*exp(-4*x)", "initial.u=0"}));
  const std::string file = folder / "one.h5";
  REQUIRE(run(problem, {.output = file, .threads = 1}).status == ExitStatus::done);
  // On the wall at x = 0, in the middle of the part of the second of two ranks, at the third stored level.
  constexpr std::size_t line = 18, lines = 44;
  falsify(file, "/states/u", 2 * line * lines + 33 * line, 1e-6);
  const Outcome one = check(file);
  CHECK(one.status == ExitStatus::contradiction);
  for (const int size : {2, 3}) {
    CHECK(to_json(with_ranks(size, [&](auto& rank) { return check(file, {.ranks = &rank}); })) == to_json(one));
  }
}

TEST_CASE("walls that ranks cannot share are refused, with place, reason and remedy") {
  const Folder folder;
  const auto refusal_of = [&](const Settings& settings, int size, const std::string& text = walled_line) {
    const std::vector<std::string> said = with_ranks(size, [&](auto& rank) {
      return said_of(parse_problem(text, "walls.toml", settings), on(rank, folder / "never.h5"));
    });
    return said.empty() ? std::string() : said.front();
  };
  // Ghosts of leapfrog are three planes beyond each wall, and of each part.
  CHECK(refusal_of({}, 5).empty());
  CHECK_THAT(refusal_of({}, 6), Contains("walls.toml:8:") &&
                                    Contains("6 ranks cannot share 62 nodes between walls along x") &&
                                    Contains("each needs 12") && Contains("start fewer"));
  // Walls across the other axis ask for nothing.
  CHECK(refusal_of(walls_in_x, 6, walled_plane).empty());
  CHECK_THAT(refusal_of(walls_in_y, 6, walled_plane), Contains("45 nodes between walls along y"));
  // Schemes on the ring of mirrors, and rows that are closed at the walls.
  const std::string even = with(walled_line, "u^2/2 + u^3/3", "u^2/2");
  const Settings zero = {"initial.u=sin(pi*x/2)"};
  for (const char* scheme : {"fourier", "splitting", "box"}) {
    CHECK_THAT(
        refusal_of(joined(zero, {fmt::format("scheme.lagrangian={}", scheme)}), 2, even),
        Contains("between walls") && Contains("\"euler-box\", \"leapfrog\";") && !Contains("\"box\" with one stage"));
  }
}
