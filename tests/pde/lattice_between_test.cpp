// A level between two levels of a lattice: of the order in time of its scheme, by slope, and joined to the levels.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/lattice_between.hpp>

#include "equations.hpp"

using namespace rubato;

namespace {

const std::vector<double> times = {0.2137, 0.6351, 0.9713};

/// u at `times`: of the run with fixed levels, between them by the scheme's own step, or on straight lines.
std::vector<double> run(const LatticeMethodChoice& choice, double step, bool straight = false) {
  const MultisymplecticSystem system = tests::sine_gordon();
  const grids::Grid grid({{"x", 0.0, 10.0, 31}});
  std::vector<double> u, v;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const double angle = 2.0 * std::acos(-1.0) * grid.axis(0).node(i) / 10.0;
    u.push_back(std::sin(angle));
    v.push_back(1.5 * std::cos(angle));
  }
  const LatticeOptions options{.lagrangian = choice.name,
                               .stages = choice.stages,
                               .composition = choice.composition,
                               .step = step,
                               .until = 1.0,
                               .levels = Levels::fixed};
  LatticeIntegrator lattice(system, grid, {u, v, std::nullopt}, options);
  LatticeBetween between(lattice.method(), system, grid, lattice.level(), step);
  std::vector<double> result;
  std::size_t next = 0;
  while (!lattice.finished()) {
    const double before = lattice.t();
    REQUIRE(lattice.step().status == Status::success);
    for (; next < times.size() && times[next] <= lattice.t(); ++next) {
      const double fraction = (times[next] - before) / step;
      REQUIRE(between.take(lattice.previous(), lattice.level(), 0.0, step, fraction) == Status::success);
      for (std::size_t i = 0; i < grid.size(); ++i) {
        const double from = lattice.previous().fields.field(0)[i], to = lattice.level().fields.field(0)[i];
        result.push_back(straight ? from + fraction * (to - from) : between.level().fields.field(0)[i]);
      }
      // Joined to both levels.
      constexpr double near = 1e-9;
      REQUIRE(between.take(lattice.previous(), lattice.level(), 0.0, step, 1.0 - near) == Status::success);
      for (std::size_t i = 0; i < grid.size(); ++i) {
        CHECK(std::abs(between.level().fields.field(0)[i] - lattice.level().fields.field(0)[i]) < 4.0 * near * step);
      }
    }
  }
  return result;
}

double slope(const LatticeMethodChoice& choice, const LatticeMethodChoice& reference, double step, double fine,
             bool straight = false) {
  const std::vector<double> exact = run(reference, fine);
  std::vector<double> errors;
  for (const double h : {step, step / 4.0}) {
    const std::vector<double> u = run(choice, h, straight);
    double largest = 0.0;
    for (std::size_t i = 0; i < u.size(); ++i) {
      largest = std::max(largest, std::abs(u[i] - exact[i]));
    }
    errors.push_back(largest);
  }
  return 0.5 * std::log2(errors.front() / errors.back());
}

}  // namespace

TEST_CASE("levels between levels are of the order of the scheme in time", "[pde]") {
  const LatticeMethodChoice best{.name = "fourier", .stages = 8};
  // Times fall on other shares of a step at each h, and where the reference is the scheme's own it is off by h/16.
  constexpr double slack = 0.35;
  CHECK(slope({.name = "fourier"}, best, 0.1, 0.1) > 2.0 - slack);
  CHECK(slope({.name = "fourier", .stages = 2}, best, 0.2, 0.1) > 4.0 - slack);
  CHECK(slope({.name = "fourier", .stages = 3}, best, 0.5, 0.1) > 6.0 - slack);
  CHECK(slope({.name = "splitting"}, best, 0.1, 0.1) > 2.0 - slack);
  CHECK(slope({.name = "splitting", .composition = "blanes-moan-4"}, best, 0.2, 0.1) > 4.0 - slack);
  CHECK(slope({.name = "box"}, {.name = "box"}, 0.1, 0.1 / 64) > 2.0 - slack);
  CHECK(slope({.name = "leapfrog"}, {.name = "leapfrog"}, 0.02, 0.02 / 64) > 2.0 - slack);
  CHECK(slope({.name = "euler-box"}, {.name = "euler-box"}, 0.1, 0.1 / 64) > 1.0 - slack);
}

TEST_CASE("straight lines between levels of a lattice are not of its order", "[pde]") {
  const LatticeMethodChoice best{.name = "fourier", .stages = 8};
  CHECK(slope({.name = "fourier", .stages = 3}, best, 0.5, 0.1, true) < 2.6);
}
