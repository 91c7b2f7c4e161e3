// Lattices run from problem files: resumed, on several threads, in two and three dimensions, and refused.

#include <catch2/catch.hpp>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

#include <rubato/problem/problem.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run.hpp>

#include "problem/problem_texts.hpp"
#include "records.hpp"

using namespace rubato;
using namespace rubato::run_tests;

namespace {

/// Runs to `middle` and resumes to `end`; and once without stopping.
void check_resumes(const std::string& name, std::vector<std::string> settings, double middle, double end,
                   bool tangents = false) {
  INFO(name);
  const Folder folder;
  const std::string stopped = folder / "stopped.h5";
  const std::string whole = folder / "whole.h5";
  const auto until = [&](double t) {
    std::vector<std::string> all = settings;
    all.push_back("scheme.until=" + std::to_string(t));
    return all;
  };
  run_problem(name, stopped, until(middle), tangents);
  const Outcome resumed = resume(stopped, end, {.threads = 1});
  const Outcome straight = run_problem(name, whole, until(end), tangents);
  REQUIRE(straight.status == ExitStatus::done);
  CHECK(different_datasets(stopped, whole) == Names{});
  CHECK(resumed.statistics.steps == straight.statistics.steps);
  CHECK(differences(straight, resumed) == Names{});
  if (std::ranges::find(settings, "output.every=7") == settings.end()) {
    CHECK(differences(straight, check(stopped)) == Names{});
  }
}

/// The breather, for a moment only.
const std::string short_breather =
    replaced(replaced(breather, "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", ""), "until = 20",
             "until = 0.1");

/// Ends before the first step, and resumes.
void check_resumes_at_start(const std::string& name, std::vector<std::string> settings) {
  INFO(name);
  const Folder folder;
  settings.push_back("grid.x.cells=51");
  settings.push_back("scheme.until=0.5");
  const std::atomic<bool> interrupt = true;
  const std::string file = folder / "stopped.h5";
  const Outcome stopped = run(read_problem(name, settings), {.output = file, .threads = 1, .interrupt = &interrupt});
  REQUIRE(stopped.status == ExitStatus::interrupted);
  REQUIRE(stopped.statistics.steps == 0);
  CHECK(check(file).statistics.steps == 0);
  CHECK(resume(file, std::nullopt, {.threads = 1}).status == ExitStatus::done);
  run_problem(name, folder / "whole.h5", settings);
  CHECK(different_datasets(file, folder / "whole.h5") == Names{});
}

/// A plane wave of the linear Klein-Gordon equation in two dimensions, in a box that is no square.
const std::string plane_wave = R"toml(
[multisymplectic]
fields = ["u", "v", "a", "b"]
M = [["u", "v", -1]]
K.x = [["u", "a", 1]]
K.y = [["u", "b", 1]]
S = "(v^2 - a^2 - b^2)/2 + u^2/2"
[grid]
x = { from = 0, to = "2*pi", cells = 61 }
y = { from = 0, to = "6*pi", cells = 41 }
[initial]
u = "sin(x + y)"
v = "-sqrt(3)*cos(x + y)"
[scheme]
step = 0.05
until = 0.2
)toml";

std::string complaint(const std::string& text) {
  const Folder folder;
  try {
    const std::string file = folder / "refused.h5";
    const Outcome outcome = run(parse_problem(text, "f.toml"), {.output = file, .threads = 1});
    CHECK(outcome.status == ExitStatus::done);
    CHECK(std::filesystem::exists(file));
    return {};
  } catch (const ProblemError& error) {
    CHECK_FALSE(std::filesystem::exists(folder / "refused.h5"));
    return error.what();
  }
}

}  // namespace

TEST_CASE("a lattice run that is stopped and resumed is the same, bit by bit", "[run][lattice]") {
  check_resumes("sine-gordon", {"grid.x.cells=101"}, 1.3, 3.0);
  check_resumes("sine-gordon", {"grid.x.cells=101", "output.every=7"}, 1.3, 3.0);
  check_resumes("sine-gordon", {"grid.x.cells=101"}, 1.3, 2.0, true);
  check_resumes("kdv", {"grid.x.cells=101"}, 0.03, 0.06);  // w exists at midpoints only
  check_resumes("bbm", {"grid.x.cells=101"}, 0.5, 1.0);
  check_resumes("sine-gordon", {"grid.x.cells=64", "scheme.lagrangian=fourier"}, 0.5, 1.0);
  check_resumes("sine-gordon", {"grid.x.cells=64", "scheme.lagrangian=fourier", "scheme.stages=3"}, 0.5, 1.0);
  check_resumes("kdv", {"grid.x.cells=100", "scheme.lagrangian=fourier", "scheme.stages=2"}, 0.03, 0.06);
  check_resumes("sine-gordon", {"grid.x.cells=64", "scheme.lagrangian=splitting"}, 0.5, 1.0);
  check_resumes("sine-gordon", {"grid.x.cells=64", "scheme.lagrangian=leapfrog"}, 0.5, 1.0);
  check_resumes("sine-gordon", {"grid.x.cells=101", "scheme.lagrangian=euler-box", "scheme.levels=fixed"}, 1.3, 3.0,
                true);
  check_resumes("sine-gordon-kinks", {}, 17.5, 30.0);
  check_resumes_at_start("sine-gordon", {});
  check_resumes_at_start("bbm", {});
  check_resumes_at_start("sine-gordon", {"scheme.lagrangian=euler-box", "scheme.levels=fixed"});
  // The twin: another step is distinguished.
  const Folder folder;
  run_problem("sine-gordon", folder / "a.h5", {"grid.x.cells=51", "scheme.until=1"});
  run_problem("sine-gordon", folder / "b.h5", {"grid.x.cells=51", "scheme.until=1", "scheme.step=0.05000000000000001"});
  CHECK_FALSE(different_datasets(folder / "a.h5", folder / "b.h5") == Names{});
}

TEST_CASE("records hold the same whatever their compression, and less of it takes more room", "[run][lattice]") {
  const Folder folder;
  const std::vector<std::string> settings = {"grid.x.cells=101", "scheme.until=3"};
  std::vector<std::uintmax_t> sizes;
  for (const char* level : {"0", "4", "9"}) {
    std::vector<std::string> all = settings;
    all.push_back(std::string("output.compression=") + level);
    const std::string file = folder / (std::string(level) + ".h5");
    run_problem("sine-gordon", file, all);
    CHECK(check(file).status == ExitStatus::done);
    sizes.push_back(std::filesystem::file_size(file));
  }
  CHECK(different_datasets(folder / "0.h5", folder / "4.h5") == Names{});
  CHECK(different_datasets(folder / "9.h5", folder / "4.h5") == Names{});
  CHECK(sizes[0] > 2 * sizes[1]);
  CHECK(sizes[1] >= sizes[2]);
  // Resumed, with what the record's own problem says.
  static_cast<void>(resume(folder / "0.h5", 4.0, {.threads = 1}));
  CHECK(check(folder / "0.h5").status == ExitStatus::done);
  CHECK_THROWS_WITH(read_problem("sine-gordon", std::vector<std::string>{"output.compression=10"}),
                    Catch::Contains("it goes from 0, none, to 9"));
}

TEST_CASE("steps in the plane may be short", "[run][lattice]") {
  // 4/h² of the equation for u beside 1, by 4e14 and 4e18.
  const std::string scheme = GENERATE("box", "fourier"), step = GENERATE("1e-7", "1e-9");
  INFO(scheme << ", " << step);
  const Folder folder;
  const std::vector<std::string> settings = {"grid.x.cells=31",     "grid.y.cells=31",
                                             "scheme.levels=fixed", "scheme.lagrangian=" + scheme,
                                             "scheme.step=" + step, "scheme.until=10" + step.substr(1)};
  const Outcome outcome = run(read_problem("sine-gordon-2d", settings), {.output = folder / "short.h5", .threads = 1});
  CHECK(outcome.status == ExitStatus::done);
  CHECK(outcome.statistics.steps == 10);
  CHECK(check(folder / "short.h5").status == ExitStatus::done);
}

TEST_CASE("records do not depend on the number of threads", "[run][lattice]") {
  // More blocks of cells than one thread takes alone (8): a line of 256 cells at most each.
  const std::vector<std::pair<std::string, std::vector<std::string>>> cases = {
      {"sine-gordon", {"grid.x.cells=3001", "scheme.until=0.1"}},
      {"sine-gordon-2d", {"grid.x.cells=31", "grid.y.cells=31", "scheme.until=0.1"}},
      {"sine-gordon-2d", {"grid.x.cells=30", "grid.y.cells=30", "scheme.until=0.1", "scheme.lagrangian=fourier"}},
      {"sine-gordon-2d",
       {"grid.x.cells=50", "grid.y.cells=48", "scheme.until=0.1", "scheme.lagrangian=fourier", "scheme.stages=3"}},
      {"sine-gordon-2d", {"grid.x.cells=50", "grid.y.cells=48", "scheme.until=0.1", "scheme.lagrangian=splitting"}},
      {"maxwell", {"grid.x.cells=7", "grid.y.cells=7", "grid.z.cells=7", "scheme.until=0.1"}},
  };
  const Folder folder;
  for (const auto& [name, settings] : cases) {
    INFO(name);
    const Problem problem = read_problem(name, settings);
    const Outcome one = run(problem, {.output = folder / "one.h5", .overwrite = true, .threads = 1});
    const Outcome two = run(problem, {.output = folder / "two.h5", .overwrite = true, .threads = 2});
    REQUIRE(one.status == ExitStatus::done);
    CHECK(differences(one, two) == Names{});
    CHECK(different_datasets(folder / "one.h5", folder / "two.h5") == Names{});
  }
}

TEST_CASE("a lattice problem that cannot be is refused with status 2, and nothing is written", "[run][lattice]") {
  const auto with = [](const std::string& from, const std::string& to) {
    return complaint(replaced(short_breather, from, to));
  };
  REQUIRE(with("cells = 401", "cells = 41").empty());
  CHECK_THAT(with("cells = 401", "cells = 400"), Catch::Contains("odd") && Catch::Contains("401"));
  CHECK_THAT(with("cells = 401", "cells = 9999999999999"), Catch::Contains("memory") || Catch::Contains("GB"));
  CHECK_THAT(with("u = \"0\"", "u = \"log(x)\""),
             Catch::Contains("the initial u is nan at x = -20") || Catch::Contains("the initial u is -nan at x = -20"));
  CHECK_THAT(with("u = \"0\"", "u = \"0\"\nw = \"sech(x)\""),
             Catch::Contains("the initial w contradicts its constraint (the row of w"));
  CHECK_THAT(with("\"v\", \"w\"]", "\"v\", \"w\", \"z1\"]"), Catch::Contains("the field z1 is not determined"));
  CHECK_THAT(complaint(short_breather + "[symmetries]\nswap = [[\"u\", \"v\", 1], [\"v\", \"u\", 1]]\n"),
             Catch::Contains("swap is not a symmetry"));
  CHECK_THAT(complaint(replaced(plane_wave, "step = 0.05", "lagrangian = \"fourier\"\nstep = 0.05")),
             Catch::Equals(""));
}

TEST_CASE("a field whose level value the energy would need and nothing gives is refused", "[run][lattice]") {
  // s = u² by its own row. With s left at 0 in levels the node energy would be 3.28 here, and not 3.87.
  const auto with = [](const std::string& fields, const std::string& term) {
    return complaint(replaced(replaced(short_breather, "\"v\", \"w\"]", "\"v\", \"w\"" + fields + "]"), "- cos(u)",
                              "- cos(u) + " + term));
  };
  CHECK_THAT(with(", \"s\"", "s*u^2 - s^2/2"), Catch::Contains("S is not linear in s"));
  CHECK(with("", "u^4/2").empty());
}

TEST_CASE("data that contradict a constraint are found in every direction", "[run][lattice]") {
  const auto with_b = [](const std::string& b) {
    return complaint(replaced(plane_wave, "u = \"sin(x + y)\"", "u = \"sin(x + y)\"\nb = \"" + b + "\""));
  };
  // u_y: the box's differences along y are coarser than those along x, and the data are right all the same.
  REQUIRE(with_b("cos(x + y)").empty());
  REQUIRE(with_b("dy(u)").empty());
  // Off by 2% of its size, which along y alone is a wave: the truncation error is (Δx² + Δy²)/12, below that.
  CHECK_THAT(with_b("cos(x + y) + 0.2*cos(y/3)"), Catch::Contains("the initial b contradicts its constraint"));
  CHECK_THAT(with_b("1.3*cos(x + y)"), Catch::Contains("the initial b contradicts its constraint"));
  const std::string euler_box = "lagrangian = \"euler-box\"\nlevels = \"fixed\"\nstep = 0.05";
  const auto explicitly = [&](const std::string& b) {
    return complaint(replaced(replaced(plane_wave, "u = \"sin(x + y)\"", "u = \"sin(x + y)\"\nb = \"" + b + "\""),
                              "step = 0.05", euler_box));
  };
  CHECK(explicitly("cos(x + y)").empty());
  CHECK_THAT(explicitly("2*cos(x + y)"), Catch::Contains("the initial b contradicts its constraint"));
}
