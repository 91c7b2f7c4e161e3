// Options of a lattice left out or without sense are refused with their name, value and remedy.

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;
using Catch::Contains;

namespace {

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

/// What is said of a lattice with spoilt data or options; empty if it is made.
std::string refusal(const std::function<void(InitialFields&, LatticeOptions&)>& spoil) {
  const grids::Grid grid({{"x", -10, 10, 21}});
  InitialFields initial{sampled(grid, sech), sampled(grid, [](double) { return 0.0; }), std::nullopt};
  LatticeOptions options{.step = 0.1, .until = 1.0};
  spoil(initial, options);
  try {
    const LatticeIntegrator lattice(sine_gordon(), grid, initial, options);
    return {};
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

std::string refused_grid(std::vector<grids::Axis> axes) {
  try {
    const grids::Grid grid(std::move(axes));
    return {};
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
}

}  // namespace

TEST_CASE("a lattice refuses options that are left out or make no sense, by name") {
  CHECK(refusal([](auto&, auto&) {}).empty());
  CHECK_THAT(refusal([](auto&, auto& o) { o = {.step = 0.1}; }), Contains("until = 0 is the start time"));
  CHECK_THAT(refusal([](auto&, auto& o) { o = {.until = 1.0}; }), Contains("step = 0 leads nowhere"));
  CHECK_THAT(refusal([](auto&, auto& o) { o.until = undefined; }), Contains("until = nan"));
  CHECK_THAT(refusal([](auto&, auto& o) { o.step = undefined; }), Contains("step = nan"));
  CHECK_THAT(refusal([](auto&, auto& o) { o.start = undefined; }), Contains("start time has to be finite"));
  CHECK_THAT(refusal([](auto&, auto& o) { o.start = 2.0; }), Contains("does not lead from t = 2 to until = 1"));
  CHECK_THAT(refusal([](auto&, auto& o) { o.tolerance = -1.0; }), Contains("tolerance = -1"));
  CHECK_THAT(refusal([](auto&, auto& o) { o.tolerance = undefined; }), Contains("tolerance = nan"));
  CHECK_THAT(refusal([](auto& f, auto&) { f = {}; }), Contains("initial data for 0 fields; the system has 3"));
  CHECK_THAT(refusal([](auto& f, auto&) { f[0]->pop_back(); }), Contains("the initial u has 20 values"));
  CHECK_THAT(refusal([](auto& f, auto&) { (*f[1])[3] = undefined; }), Contains("the initial v is nan at node 3"));
  CHECK_THAT(refusal([](auto& f, auto&) { f[1] = std::nullopt; }), Contains("no initial data for v"));
}

TEST_CASE("a grid refuses axes that are none, by name") {
  for (const std::size_t cells : {0U, 1U, 2U}) {
    CHECK_THAT(refused_grid({{"x", 0, 1, cells}}), Contains("axis x: at least 3 cells"));
  }
  CHECK_THAT(refused_grid({{"x", 1, 1, 9}}), Contains("axis x"));
  CHECK_THAT(refused_grid({{"x", 1, 0, 9}}), Contains("axis x"));
  CHECK_THAT(refused_grid({{"x", 0, undefined, 9}}), Contains("axis x"));
  CHECK_THAT(refused_grid({{"x", 0, 1, 9}, {"x", 0, 1, 9}}), Contains("two axes are named x"));
  CHECK_FALSE(refused_grid({}).empty());
  CHECK(refused_grid({{"x", 0, 1, 9}}).empty());
}
