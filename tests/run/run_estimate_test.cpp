// The memory that a run is estimated to take, beside what it takes.

#include <catch2/catch.hpp>

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <malloc.h>
#include <sys/wait.h>
#include <unistd.h>

#include <rubato/base/memory.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/run/check.hpp>
#include <rubato/run/run_estimate.hpp>
#include <rubato/run/threads.hpp>

#include "run/records.hpp"

using namespace rubato;
using namespace rubato::run_tests;

namespace {

Problem cubic_wave(std::string_view scheme, const std::string& cells) {
  const std::string axis = " = { from = 0, to = \"2*pi\", cells = " + cells + " }\n";
  return parse_problem(
      "title = \"T\"\n[multisymplectic]\nfields = [\"u\", \"v\", \"a\", \"b\", \"c\"]\n"
      "M = [[\"u\", \"v\", -1]]\nK.x = [[\"u\", \"a\", 1]]\nK.y = [[\"u\", \"b\", 1]]\n"
      "K.z = [[\"u\", \"c\", 1]]\nS = \"(v^2 - a^2 - b^2 - c^2)/2 + u^2/2 + u^4/4\"\n[grid]\nx" +
          axis + "y" + axis + "z" + axis +
          "[initial]\nu = \"sin(x)*cos(y)*sin(z)/2\"\nv = \"cos(x + y)/5\"\n[scheme]\nlagrangian = \"" +
          std::string(scheme) + "\"\nlevels = \"fixed\"\nstep = 0.02\nuntil = 0.06\n",
      "cubic-wave.toml");
}

/// How much a process grows that does this; negative if it fails.
double measured_growth(const std::function<bool()>& work) {
  ::malloc_trim(0);  // memory that was freed before counts again
  std::array<int, 2> ends{};
  REQUIRE(::pipe(ends.data()) == 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const ThreadCount one(1);  // a child has no other threads
    const double before = peak_memory();
    double grown = -1.0;
    try {
      if (work()) {
        grown = peak_memory() - before;
      }
    } catch (const std::exception&) {
    }
    ::_exit(::write(ends[1], &grown, sizeof grown) == sizeof grown ? 0 : 1);
  }
  double grown = -1.0;
  const bool is_read = ::read(ends[0], &grown, sizeof grown) == sizeof grown;
  ::close(ends[0]);
  ::close(ends[1]);
  ::waitpid(child, nullptr, 0);
  return is_read ? grown : -1.0;
}

double measured_memory(const Problem& problem, const std::string& file) {
  return measured_growth(
      [&] { return run(problem, {.output = file, .overwrite = true, .threads = 1}).status == ExitStatus::done; });
}

/// Of the check of a record without laws and states, or with: what one node more takes.
double bytes_of_check(bool with_all, const Folder& folder) {
  const std::string file = folder / "record.h5";
  const auto peak = [&](const char* cells) {
    Problem problem = cubic_wave("leapfrog", cells);
    if (!with_all) {
      problem = parse_problem(problem.text + "[laws]\nevery = false\n[output]\nstates = false\n", "cubic-wave.toml");
    }
    REQUIRE(run(problem, {.output = file, .overwrite = true, .threads = 1}).status == ExitStatus::done);
    const double grown = measured_growth([&] { return check(file).status == ExitStatus::done; });
    REQUIRE(grown > 0.0);
    return grown;
  };
  return (peak("72") - peak("48")) / (72.0 * 72 * 72 - 48.0 * 48 * 48);
}

}  // namespace

TEST_CASE("the memory of a lattice's run is estimated for every scheme") {
  const Folder folder;
  for (const LatticeMethodEntry& method : lattice_methods()) {
    INFO(method.name);
    const Problem problem = cubic_wave(method.name, "41");
    const auto estimate = estimate_run(problem).memory;
    const double measured = measured_memory(problem, folder / "record.h5");
    REQUIRE(estimate);
    REQUIRE(measured > 50e6);
    INFO(*estimate * 1e-6 << " MB estimated, " << measured * 1e-6 << " MB measured");
    // What a user needs: rather a little too much than too little.
    CHECK(*estimate > 0.9 * measured);
    CHECK(*estimate < 1.4 * measured);
    // The twin: that of a lattice with half as many cells along each axis is not it.
    CHECK(*estimate_run(cubic_wave(method.name, "21")).memory < 0.9 * measured);
  }
}

TEST_CASE("the check of a record without laws and states takes two levels") {
  if (std::getenv("RUBATO_SANITIZED") != nullptr) {
    return;  // its own memory would count
  }
  const Folder folder;
  // The problem's and the stored one, each of five fields, and a row that is read; a tenth for pages, and four values
  // for what is made of no whole array.
  constexpr double allowed = 1.1 * sizeof(double) * 11 + 32.0;
  CHECK(bytes_of_check(false, folder) < allowed);
  CHECK(bytes_of_check(true, folder) > allowed);  // the twin
}

TEST_CASE("a run that does not fit into memory is refused with the bytes that it takes") {
  const std::string reason = [] {
    try {
      require_memory_for(cubic_wave("leapfrog", "20001"), {});
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  }();
  // So does a dry run, with the same words.
  const std::string dry = [] {
    try {
      static_cast<void>(dry_run(cubic_wave("leapfrog", "20001")));
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  }();
  for (const std::string& text : {reason, dry}) {
    CHECK_THAT(text, Catch::Contains("8.0012e+12 nodes (20001 x 20001 x 20001)") &&
                         Catch::Contains("its record would take") && Catch::Contains("3 steps would take about"));
  }
  CHECK_THAT(reason, Catch::Contains("cubic-wave.toml:") && Catch::Contains("bytes a node") &&
                         Catch::Contains(" GB is available (") && Catch::Contains("take fewer cells"));
  CHECK_NOTHROW(require_memory_for(cubic_wave("leapfrog", "21"), {}));
  // The part of each of ten million ranks does fit.
  CHECK_NOTHROW(require_memory_for(cubic_wave("leapfrog", "2001"), {}, 1e-7));
}

TEST_CASE("the size of a record is estimated, and the time as that of its steps") {
  const Folder folder;
  // Equal steps: how many steps of variable levels are timed depends on the machine, and so does their mean.
  const auto [name, settings, other] = GENERATE(table<std::string, std::vector<std::string>, std::string>(
      {{"kepler", {"scheme.until=100", "scheme.levels=fixed"}, "scheme.until=40"},
       {"kepler",
        {"scheme.until=400", "output.every=50", "output.interval=0.1", "scheme.levels=fixed"},
        "output.every=1"},
       {"sine-gordon", {"scheme.levels=fixed"}, "output.every=4"},
       {"sine-gordon", {"output.every=20", "laws.fields=true", "scheme.levels=fixed"}, "output.every=100"},
       {"sine-gordon-2d",
        {"output.states=false", "grid.x.cells=151", "grid.y.cells=151", "scheme.until=1", "scheme.lagrangian=euler-box",
         "scheme.levels=fixed"},
        "output.states=true"}}));
  INFO(name << ' ' << (settings.empty() ? "" : settings.front()));
  const auto file_size = [&](const Problem& of) {
    static_cast<void>(run(of, {.output = folder / "a.h5", .overwrite = true}));
    return static_cast<double>(std::filesystem::file_size(folder / "a.h5"));
  };
  const Problem problem = read_problem(name, settings);
  const RunEstimate estimate = estimate_run(problem);
  const double size = file_size(problem);
  REQUIRE(estimate.record);
  INFO(*estimate.record << " bytes estimated, " << size << " found");
  CHECK(*estimate.record > 0.7 * size);
  CHECK(*estimate.record < 1.4 * size);
  // The twin: it is not that of a record with more in it, or less.
  std::vector<std::string> changed = settings;
  changed.push_back(other);
  const double twin = file_size(read_problem(name, changed));
  INFO(twin);
  CHECK_FALSE((*estimate.record > 0.7 * twin && *estimate.record < 1.4 * twin));
  REQUIRE(estimate.seconds);
  CHECK(*estimate.a_step > 0.0);
  CHECK(*estimate.seconds == *estimate.start + *estimate.steps * *estimate.a_step);
  CHECK(estimate.coordinates == (name == "kepler" ? 2 : 0));
  CHECK(estimate.fields == (name == "kepler" ? 0 : problem.multisymplectic()->fields.size()));
  CHECK_THAT(to_json(estimate), Catch::Contains(R"("dry_run": true)") && Catch::Contains(R"("seconds": {"total": )"));
  CHECK_THAT(to_table(estimate), Catch::Contains("nothing was run"));
}

TEST_CASE("what an ensemble takes is estimated from some of its members") {
  const Folder folder;
  const Problem problem = read_problem(
      "pendulum", std::vector<std::string>{"scheme.until=10", "scheme.levels=fixed", "output.interval=0.05",
                                           "output.quantities.v=p", R"(ensemble.grid.initial.p="0.1:1.5:40")"});
  const RunEstimate estimate = estimate_run(problem, {.threads = 1});
  CHECK(estimate.members == 40);
  CHECK(*estimate.steps == 100);
  CHECK(std::abs(*estimate.seconds - 40 * (*estimate.start + 100 * *estimate.a_step)) <= 1e-9 * *estimate.seconds);
  static_cast<void>(run_ensemble(problem, {.output = folder / "a.h5", .threads = 1}));
  const auto size = static_cast<double>(std::filesystem::file_size(folder / "a.h5"));
  INFO(*estimate.record << " bytes estimated, " << size << " found");
  CHECK(*estimate.record > 0.5 * size);
  CHECK(*estimate.record < 1.4 * size);
  CHECK_THAT(to_table(estimate), Catch::Contains("members") && Catch::Contains("100 each"));
}
