// The damping of levels by a sponge: what it makes of fields with an equation of motion, of those without one, and of
// what walls hold.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/sponge.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

grids::Axis along_x(std::size_t cells, grids::End left = grids::End::periodic,
                    grids::End right = grids::End::periodic) {
  return {.name = "x", .from = 0, .to = 2, .cells = cells, .left = left, .right = right};
}

/// u, v of a wave that is smooth on the ring and between walls.
InitialFields wave_on(const grids::Grid& grid, int fields) {
  InitialFields given(static_cast<std::size_t>(fields));
  for (int f = 0; f < 2; ++f) {
    std::vector<double>& values = given[static_cast<std::size_t>(f)].emplace(grid.size());
    for (std::size_t node = 0; node < grid.size(); ++node) {
      const double x = grid.axis(0).node(grid.place(node)[0]);
      values[node] = (1.0 + f) * std::sin(std::acos(-1.0) * x) * std::cos(f + std::acos(-1.0) * x);
    }
  }
  return given;
}

}  // namespace

TEST_CASE("the fields without an equation of motion follow from the others as at the start") {
  const MultisymplecticSystem system = sine_gordon();
  const grids::Grid ring({along_x(31)}), between({along_x(32, grids::End::fixed, grids::End::fixed)});
  for (const LatticeMethodEntry& entry : lattice_methods()) {
    for (const char* space : {"fourier", "differences"}) {
      if (std::string(space) != "fourier" && !entry.has_space) {
        continue;
      }
      for (const grids::Grid* grid : {&ring, &between}) {
        const LatticeMethodChoice choice{.name = std::string(entry.name), .space = space};
        if (grid->has_walls() && !make_lattice_method(choice)->in_mirror()) {
          continue;
        }
        INFO(entry.name << ", " << space << (grid->has_walls() ? ", between walls" : ""));
        const auto method = make_lattice_method(choice, *grid);
        const LatticeLevel first = method->first_level(system, *grid, wave_on(*grid, 3)).level;
        LatticeLevel level = first;
        for (double& value : level.fields.field(2)) {
          value = 0.3 - value;
        }
        const auto w = std::as_const(first).fields.field(2);
        const double largest = grids::max_abs(w);
        REQUIRE(largest > 1.0);
        CHECK(grids::max_abs_difference(w, std::as_const(level).fields.field(2)) > largest);  // the twin
        CHECK(method->constrained_fields(system, *grid)->find(level) == Status::success);
        // Differences of u, of some rounding errors each: u over the spacing.
        const double u = grids::max_abs(std::as_const(first).fields.field(0));
        CHECK(grids::max_abs_difference(w, std::as_const(level).fields.field(2)) <
              64.0 * std::numeric_limits<double>::epsilon() * (u / grid->spacing(0) + largest));
        for (int f = 0; f < 2; ++f) {
          CHECK(std::ranges::equal(std::as_const(first).fields.field(f), std::as_const(level).fields.field(f)));
        }
      }
    }
  }
}

TEST_CASE("a layer stands beside the walls that have one, and leaves what walls hold as it is") {
  const grids::Grid line({along_x(41, grids::End::fixed, grids::End::fixed)});
  Sponge::Layer layer{.axis = 0, .from = 0, .to = 2, .width = 0.5, .strength = 3};
  const auto rate_at = [&](double x) {
    const std::vector<double> rates = Sponge({layer}).rates(line);
    return rates[static_cast<std::size_t>(std::lround(x / line.spacing(0)))];
  };
  CHECK(rate_at(0) == 3.0);
  CHECK(rate_at(2) == 3.0);
  CHECK(rate_at(0.25) == Approx(1.5));  // the middle of the profile
  CHECK(rate_at(1) == 0.0);
  layer.at_left = false;
  CHECK(rate_at(0) == 0.0);
  CHECK(rate_at(0.25) == 0.0);
  CHECK(rate_at(1.75) == Approx(1.5));

  // The wall holds u at 1, and lets v be 0; a free wall holds neither.
  for (const grids::End right : {grids::End::fixed, grids::End::free}) {
    INFO((right == grids::End::fixed ? "fixed" : "free"));
    const MultisymplecticSystem system = wave_equation("0");
    const grids::Grid grid({along_x(41, grids::End::fixed, right)});
    const auto method = make_lattice_method({.name = "leapfrog"}, grid);
    InitialFields given(3);
    given[0].emplace(grid.size(), 1.0);
    given[1].emplace(grid.size(), 0.0);
    const LatticeLevel level = method->first_level(system, grid, given).level;
    LatticeLevel damped;
    SpongeDamping damping(*method, system, grid, Sponge({layer}));
    damping(level, 0.1, damped);
    const auto u = std::as_const(damped).fields.field(0);
    CHECK(u[40] == Approx(right == grids::End::fixed ? 1.0 : std::exp(-0.3)));
    CHECK(u[35] == Approx(std::exp(-0.15)));
    CHECK(u[10] == 1.0);
    damping(damped, -0.1, damped);
    CHECK(u[35] == Approx(1.0));
  }
}
