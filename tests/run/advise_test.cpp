// Which scheme, which step? Trials at equal error, by the means of converge().

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/record/reader.hpp>
#include <rubato/run/advise.hpp>
#include <rubato/run/converge.hpp>

#include "folder.hpp"
#include "problem/problem_texts.hpp"

using namespace rubato;
using namespace rubato::run_tests;
using Catch::Contains;
using rubato::tests::Folder;

namespace {

std::vector<std::string> settings_of(const AdvisedScheme& scheme) {
  std::vector<std::string> settings = {fmt::format("scheme.step={}", scheme.step)};
  for (const auto& [key, value] : scheme.entries) {
    settings.push_back(fmt::format("scheme.{}={}", key, value));
  }
  for (const auto& [axis, cells] : scheme.cells) {
    settings.push_back(fmt::format("grid.{}.cells={}", axis, cells));
  }
  return settings;
}

/// q and p of the pendulum at t = 10, by dense output.
std::vector<double> at_end(std::vector<std::string> settings) {
  const Folder folder;
  settings.emplace_back("output.times=[10]");
  RunOptions options;
  options.output = folder / "run.h5";
  REQUIRE(run(parse_problem(pendulum, "t.toml", settings), options).status == ExitStatus::done);
  const record::Reader reader(*options.output);
  return {reader.read("/output/q", 0, 1).front(), reader.read("/output/p", 0, 1).front()};
}

std::set<std::string> families_of(const Advice& advice) {
  std::set<std::string> families;
  for (const AdvisedScheme& scheme : advice.schemes) {
    families.insert(unquoted(scheme.entries.front().second));
  }
  return families;
}

std::string refusal(const std::string& text, const std::vector<std::string>& settings) {
  try {
    static_cast<void>(advise(parse_problem(text, "t.toml", settings), 1e-3));
  } catch (const ProblemError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("advised steps have the target error, which longer steps exceed, and the cheapest is first") {
  constexpr double target = 1e-4;
  const Problem problem = parse_problem(pendulum, "t.toml", {});
  const Advice advice = advise(problem, target);
  REQUIRE(advice.status == ExitStatus::done);
  CHECK(advice.whole_run);
  CHECK(families_of(advice) == std::set<std::string>{"midpoint", "generating", "gauss", "splitting"});
  REQUIRE(advice.schemes.size() == 8);
  const std::vector<double> exact =
      at_end({"scheme.lagrangian=gauss", "scheme.stages=6", "scheme.levels=fixed", "scheme.step=0.05"});
  double cost = 0.0;
  for (const AdvisedScheme& scheme : advice.schemes) {
    INFO(fmt::format("{} step = {}", scheme.entries.front().second, scheme.step));
    REQUIRE(scheme.cost);
    CHECK(*scheme.cost >= cost);
    cost = *scheme.cost;
    REQUIRE(scheme.step_error);
    CHECK(*scheme.step_error <= target);
    CHECK_FALSE(scheme.grid_error);
    const auto error_with = [&](AdvisedScheme one, double factor) {
      one.step *= factor;
      const std::vector<double> end = at_end(settings_of(one));
      return std::max(std::abs(end[0] - exact[0]) / std::abs(exact[0]),
                      std::abs(end[1] - exact[1]) / std::abs(exact[1]));
    };
    // With step = "auto" a step potential is chosen anew for every step: half as much again.
    const double error = error_with(scheme, 1.0);
    CHECK(error <= 1.5 * target);
    // Richardson's estimate is off by the next order, a few powers of steps below 1.
    CHECK(error == Approx(*scheme.step_error).epsilon(0.5).margin(1e-10));
    // The twin: of order 2 or more, an error above a tenth of the target is above it with four times the step.
    if (*scheme.step_error > 0.1 * target) {
      CHECK(error_with(scheme, 4.0) > target);
    }
  }
}

TEST_CASE("no scheme is dominated by one below it, and a family has the order that costs least") {
  const auto dominated = [](std::vector<AdvisedScheme> schemes) {
    std::size_t count = 0;
    for (std::size_t below = 1; below < schemes.size(); ++below) {
      for (std::size_t above = 0; above < below; ++above) {
        const AdvisedScheme &one = schemes[above], &other = schemes[below];
        count += one.cost && other.cost && *other.seconds < *one.seconds &&
                         std::max(*other.step_error, *other.grid_error) < std::max(*one.step_error, *one.grid_error)
                     ? 1
                     : 0;
      }
    }
    return count;
  };
  const Advice advice =
      advise(read_problem("nls", std::vector<std::string>{"scheme.until=2", "grid.x.cells=129"}), 1e-3);
  REQUIRE(advice.status == ExitStatus::done);
  CHECK(dominated(advice.schemes) == 0);
  // The twin: in the other order some are.
  CHECK(dominated({advice.schemes.rbegin(), advice.schemes.rend()}) > 0);
  const auto splitting = std::ranges::find_if(advice.schemes, [](const AdvisedScheme& scheme) {
    return std::ranges::count(scheme.entries, std::pair<std::string, std::string>("space", "\"fourier\"")) > 0;
  });
  REQUIRE(splitting != advice.schemes.end());
  CHECK_THAT(fmt::format("{}", fmt::join(settings_of(*splitting), " ")), Contains("composition=\"blanes-moan-4\""));
}

TEST_CASE("what is advised does not depend on the machine, but for times") {
  const Problem problem = parse_problem(pendulum, "t.toml", {});
  const auto shown = [&] {
    std::set<std::string> shown;
    for (const AdvisedScheme& scheme : advise(problem, 1e-3).schemes) {
      shown.insert(fmt::format("{} {} {}", fmt::join(settings_of(scheme), " "), *scheme.step_error, scheme.measured));
    }
    return shown;
  };
  const std::set<std::string> first = shown();
  CHECK(first.size() == 8);
  CHECK(shown() == first);
}

TEST_CASE("schemes that do not take a problem are named with the reason") {
  const std::string text = replaced(pendulum, "p^2/2 - cos(q)", "p^2*(1 + q^2)/2 - cos(q)");
  const Advice advice = advise(parse_problem(text, "t.toml", {}), 1e-3);
  REQUIRE(advice.status == ExitStatus::done);
  CHECK(families_of(advice) == std::set<std::string>{"midpoint", "generating", "gauss"});
  REQUIRE(advice.refused.size() == 1);
  CHECK(advice.refused[0].first == "\"splitting\"");
  CHECK_THAT(to_table(advice), Contains("not splitting: ") && Contains("1, in [scheme]:"));
  // The scheme of the problem as it stands does not matter, nor keys that are of that scheme alone.
  const std::vector<std::string> generating = {"scheme.lagrangian=generating", "scheme.order=4",
                                               "scheme.darboux=euler-a"};
  CHECK(families_of(advise(parse_problem(text, "t.toml", generating), 1e-3)) == families_of(advice));
}

TEST_CASE("a problem stated by L has the quadratures of its action") {
  std::string text = replaced(pendulum, "[hamiltonian]\nq = [\"q\"]\np = [\"p\"]\nH = \"p^2/2 - cos(q)\"",
                              "[lagrangian]\nq = [\"q\"]\nL = \"q_dot^2/2 + cos(q)\"");
  text = replaced(text, "p = 1.9", "q_dot = 1.9");
  const Advice advice = advise(parse_problem(text, "t.toml", {}), 1e-3);
  REQUIRE(advice.status == ExitStatus::done);
  CHECK(families_of(advice) == std::set<std::string>{"midpoint", "gauss", "trapezoid", "lobatto"});
}

TEST_CASE("on a lattice the number of cells follows from the grid's error, and is one that the scheme takes") {
  const std::string text = replaced(replaced(breather, "until = 20", "until = 1"),
                                    "[symmetries]\nturn = [[\"u\", \"v\", 1], [\"v\", \"u\", -1]]\n", "");
  const Problem problem = parse_problem(
      text, "t.toml", std::vector<std::string>{"grid.x.cells=90", "scheme.step=0.1", "scheme.lagrangian=fourier"});
  const Advice advice = advise(problem, 3e-3);
  REQUIRE(advice.status == ExitStatus::done);
  CHECK(families_of(advice).size() >= 3);
  CHECK(families_of(advice).contains("box"));
  bool has_finer = false;
  for (const AdvisedScheme& scheme : advice.schemes) {
    const std::string method = unquoted(scheme.entries.front().second);
    INFO(method);
    REQUIRE(scheme.cells.size() == 1);
    const std::int64_t cells = scheme.cells[0].second;
    if (method == "box") {
      CHECK(cells % 2 == 1);
    }
    if (method == "fourier") {
      CHECK(cells == 90);  // they resolve the breather
    }
    has_finer = has_finer || cells > 91;
    if (scheme.cost) {
      CHECK(*scheme.step_error <= 3e-3);
      CHECK(*scheme.grid_error <= 3e-3);
    }
    // The problem takes what is advised.
    CHECK_NOTHROW(parse_problem(text, "t.toml", settings_of(scheme)));
  }
  CHECK(has_finer);
  CHECK_THAT(to_json(advice), Contains("\"grid_error\"") && !Contains("nan") && !Contains("inf"));
}

TEST_CASE("a problem whose step cannot be changed is refused") {
  CHECK_THAT(refusal(pendulum, {"scheme.step=auto", "scheme.energy_tolerance=1e-3"}),
             Contains("advise changes the step"));
  CHECK_THAT(refusal(pendulum + "[ensemble]\ngrid = { initial.p = [1, 2] }\n", {}), Contains("leave [ensemble] out"));
  CHECK(refusal(pendulum, {}).empty());
}
