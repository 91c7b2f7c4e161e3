// The memory that a run is estimated to take, beside what it takes.

#include <catch2/catch.hpp>

#include <array>
#include <string>
#include <vector>

#include <sys/wait.h>
#include <unistd.h>

#include <rubato/base/memory.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/run/memory_estimate.hpp>

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

/// How much a process grows that carries out the run; negative if it fails.
double measured_memory(const Problem& problem, const std::string& file) {
  std::array<int, 2> ends{};
  REQUIRE(::pipe(ends.data()) == 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const double before = peak_memory();
    double grown = -1.0;
    try {
      if (run(problem, {.output = file, .overwrite = true, .threads = 1}).status == ExitStatus::done) {
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

}  // namespace

TEST_CASE("the memory of a lattice's run is estimated for every scheme") {
  const Folder folder;
  for (const LatticeMethodEntry& method : lattice_methods()) {
    INFO(method.name);
    const Problem problem = cubic_wave(method.name, "41");
    const auto estimate = estimated_memory(problem, false);
    const double measured = measured_memory(problem, folder / "record.h5");
    REQUIRE(estimate);
    REQUIRE(measured > 50e6);
    INFO(*estimate * 1e-6 << " MB estimated, " << measured * 1e-6 << " MB measured");
    // What a user needs: rather a little too much than too little.
    CHECK(*estimate > 0.9 * measured);
    CHECK(*estimate < 1.4 * measured);
    // The twin: that of a lattice with half as many cells along each axis is not it.
    CHECK(*estimated_memory(cubic_wave(method.name, "21"), false) < 0.9 * measured);
  }
  CHECK_FALSE(estimated_memory(read_problem("pendulum"), false));
}

TEST_CASE("a run that does not fit into memory is refused with the bytes that it takes") {
  const std::string reason = [] {
    try {
      require_memory_for(cubic_wave("leapfrog", "20001"), false);
    } catch (const ProblemError& error) {
      return std::string(error.what());
    }
    return std::string();
  }();
  CHECK_THAT(reason, Catch::Contains("cubic-wave.toml:") && Catch::Contains("bytes a node") &&
                         Catch::Contains(" GB is available (") && Catch::Contains("take fewer cells"));
  CHECK_NOTHROW(require_memory_for(cubic_wave("leapfrog", "21"), false));
  // The part of each of ten million ranks does fit.
  CHECK_NOTHROW(require_memory_for(cubic_wave("leapfrog", "2001"), false, 1e-7));
}
