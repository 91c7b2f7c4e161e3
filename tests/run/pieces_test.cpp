// H and S in pieces, such as |u|: second derivatives that are 0 on either side make neither of them quadratic.

#include <catch2/catch.hpp>

#include <string>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/run/run.hpp>

#include "problem_texts.hpp"
#include "run/shared_lattices.hpp"

using namespace rubato;
using namespace rubato::run_tests;

namespace {

/// The largest error of the first field or coordinate against [exact] at the end.
double error_of(const std::string& text, const Settings& settings) {
  const Folder folder;
  const Outcome outcome = run(parse_problem(text, "pieces.toml", settings), {.output = folder / "a.h5"});
  REQUIRE(outcome.complete);  // whatever the verdict: that on a force which is switched on is open
  return outcome.statistics.errors.front().value.largest();
}

}  // namespace

TEST_CASE("schemes of lattices take a slope that jumps at u = 0") {
  // The same u at all nodes falls freely, as long as it is positive.
  const std::string text = R"toml(
[field]
L = "u_t^2/2 - u_x^2/2 - g*PIECE"
fields = ["u"]
[parameters]
g = 1
[grid]
x = { from = 0, to = 1, cells = 15 }
[initial]
u = 1
u_t = 0
[exact]
u = "1 - t^2/2"
[scheme]
levels = "fixed"
step = 0.05
until = 1
)toml";
  for (const char* piece : {"abs(u)", "max(0, u)", "u*sign(u)", "where(u > 0, u, 0)"}) {
    const std::string one = with(text, "PIECE", piece);
    for (const Settings& scheme : std::vector<Settings>{{"scheme.lagrangian=splitting", "scheme.order=4"},
                                                        {"scheme.lagrangian=splitting", "scheme.space=differences"},
                                                        {"scheme.lagrangian=fourier"},
                                                        {"scheme.lagrangian=fourier", "scheme.stages=2"},
                                                        {"scheme.lagrangian=leapfrog"}}) {
      INFO(piece << ", " << fmt::format("{}", fmt::join(scheme, ", ")));
      CHECK(error_of(one, scheme) < 1e-12);  // steps of second order and more are exact in free fall
      Settings without = scheme;             // the twin
      without.push_back("parameters.g=0");
      CHECK(error_of(one, without) > 0.4);
    }
  }
}

TEST_CASE("schemes of lattices take a force that is switched on") {
  // From t = 1 on, a level, the same u at all nodes falls freely.
  const std::string text = R"toml(
[field]
L = "u_t^2/2 - u_x^2/2 - where(t > 0.999999, g, 0)*u"
fields = ["u"]
[parameters]
g = 1
[grid]
x = { from = 0, to = 1, cells = 15 }
[initial]
u = 1
u_t = 0
[exact]
u = "1 - max(0, t - 1)^2/2"
[scheme]
levels = "fixed"
step = 0.01
until = 2
)toml";
  for (const Settings& scheme : std::vector<Settings>{{"scheme.lagrangian=splitting", "scheme.order=4"},
                                                      {"scheme.lagrangian=fourier", "scheme.stages=2"},
                                                      {"scheme.lagrangian=euler-box"}}) {
    INFO(fmt::format("{}", fmt::join(scheme, ", ")));
    CHECK(error_of(text, scheme) < 0.02);  // a force that begins within a step of 0.01 is off by one of them at most
    Settings without = scheme;             // the twin
    without.push_back("parameters.g=0");
    CHECK(error_of(text, without) > 0.4);
  }
}

TEST_CASE("schemes of orbits take a velocity that jumps at p = 0") {
  // While p > 0 that is an oscillator of p + 0.2.
  const std::string text = R"toml(
[hamiltonian]
q = ["q"]
p = ["p"]
H = "p^2/2 + g*abs(p) + q^2/2"
[parameters]
g = 0.2
[initial]
q = 0
p = 1
[exact]
q = "1.2*sin(t)"
p = "1.2*cos(t) - 0.2"
[scheme]
levels = "fixed"
step = 0.05
until = 1
)toml";
  for (const Settings& scheme : std::vector<Settings>{{"scheme.lagrangian=gauss", "scheme.stages=3"},
                                                      {"scheme.lagrangian=gauss", "scheme.stages=4"},
                                                      {"scheme.lagrangian=splitting", "scheme.order=8"}}) {
    INFO(fmt::format("{}", fmt::join(scheme, ", ")));
    CHECK(error_of(text, scheme) < 1e-9);  // of order 6 or more: 0.05^6 times derivatives of 1/100 and less
    Settings without = scheme;             // the twin
    without.push_back("parameters.g=0");
    CHECK(error_of(text, without) > 0.1);
  }
}
