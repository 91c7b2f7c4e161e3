#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/corner_energy.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/variation/coordinate_variation.hpp>
#include <rubato/variation/lattice_variation.hpp>
#include <rubato/variation/node_variation.hpp>

#include "cell_action.hpp"
#include "mesh_cases.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::FieldSet;

namespace {

using Level = NodeVariation::Level;

/// One line is longer than a piece of NodeCode, its last piece no whole vector.
std::vector<MeshCase> cases() {
  std::vector<MeshCase> all = mesh_cases();
  all.push_back({sine_gordon(), grids::Grid({{"x", 0, 100, 517}})});
  return all;
}

bool has_neighbours_alone(const LatticeAction& action) {
  return std::ranges::all_of(action.operators, [](const StencilOperator& op) { return op.space.spectral_axis < 0; });
}

PotentialSlopes some_slopes(const MultisymplecticSystem& system, const grids::Grid& grid) {
  PotentialSlopes slopes;
  slopes.of_field.resize(static_cast<std::size_t>(system.field_count()));
  for (std::size_t line = 0; line < grid.size() / grid.cells(0); ++line) {
    slopes.of_field.front().push_back(0.3 - 0.1 * static_cast<double>(line));
  }
  return slopes;
}

}  // namespace

// Dozens of terms of order 1, in two orders; spacings down to 0.19.
constexpr double rounding = 1e-13;

TEST_CASE("the variation at a node by formulas is that of the lattice") {
  const double h = 0.13;
  int actions = 0;
  for (const auto& [system, grid] : cases()) {
    const int d = system.field_count();
    const FieldSet before = random_fields(d, grid.size(), 1), after = random_fields(d, grid.size(), 2);
    const PotentialSlopes slopes = some_slopes(system, grid);
    for (const LatticeAction& action : actions_of(system)) {
      if (!has_neighbours_alone(action)) {
        continue;
      }
      ++actions;
      LatticeVariation lattice(action, grid);
      lattice.take(before, after, h, slopes);
      LatticeVariation::Parts parts(d, grid.size());
      lattice.values(parts);
      NodeVariation node(action, grid);
      std::vector<formula::Expression> formulas;
      for (int f = 0; f < d; ++f) {
        formulas.push_back(node.values(Level::before, f));
        formulas.push_back(node.values(Level::after, f));
      }
      formulas.push_back(node.energy());
      NodeCode code = node.code(formulas);
      FieldSet found(static_cast<int>(formulas.size()), grid.size());
      node.read(code, before, after, h, slopes);
      code(found.pointers());
      for (int f = 0; f < d; ++f) {
        INFO("field " << f);
        for (double& value : found.field(2 * f)) {
          value *= grid.cell_volume();
        }
        for (double& value : found.field(2 * f + 1)) {
          value *= grid.cell_volume();
        }
        CHECK(largest_difference(found.field(2 * f), parts.before.field(f)) <= rounding);
        CHECK(largest_difference(found.field(2 * f + 1), parts.after.field(f)) <= rounding);
      }
      const double energy = grid.cell_volume() * grids::sum(std::as_const(found).field(2 * d));
      CHECK(energy == Approx(lattice.energy()).epsilon(rounding).margin(rounding * static_cast<double>(grid.size())));

      // Parts of the nodes one after the other have the same bits.
      FieldSet again(found.fields(), grid.size());
      std::vector<double*> outputs(again.pointers().begin(), again.pointers().end());
      const std::size_t third = grid.size() / 3;
      code(third, grid.size(), outputs);
      code(0, third, outputs);
      CHECK(largest_difference(again.field(2 * d), found.field(2 * d)) == 0.0);

      // Another step, and other slopes, have other variations.
      node.read(code, before, after, 1.01 * h, slopes);
      code(again.pointers());
      double change = 0.0;
      for (int f = 0; f < d; ++f) {
        change = std::max(change, largest_difference(again.field(2 * f), parts.before.field(f)));
      }
      CHECK(change > 1e-5);
    }
  }
  CHECK(actions >= 14);
}

TEST_CASE("of a slab at rest the variation is momentum and h force") {
  const MultisymplecticSystem system = wave_equation_2d("1 - cos(u)");
  const grids::Grid grid({{"x", 0, 2, 5}, {"y", -1, 1, 7}});
  const FieldSet level = random_fields(system.field_count(), grid.size(), 3);
  const auto action = make_lattice_method({.name = "leapfrog"})->action(system);
  REQUIRE(action);
  NodeVariation node(*action, grid);
  const auto [momentum, force] = node.at_rest(0);
  REQUIRE(momentum.is_constant());
  NodeCode code = node.code(std::array{force, node.values(Level::before, 0)});
  for (const double h : {0.1, 0.7}) {
    FieldSet found(2, grid.size());
    node.read(code, level, level, h, {});
    code(found.pointers());
    std::vector<double> expected;
    for (const double value : found.field(0)) {
      expected.push_back(momentum.constant_value() + h * value);
    }
    CHECK(largest_difference(found.field(1), expected) <= rounding);
    CHECK(grids::max_abs(std::as_const(found).field(0)) > 0.1);
  }
}

TEST_CASE("a variation at a node cannot have a derivative that reads all nodes") {
  const grids::Grid grid({{"x", 0, 2, 8}});
  CHECK_THROWS_WITH(NodeVariation(fourier_action(sine_gordon()), grid), Catch::Contains("reads all nodes"));
}

TEST_CASE("the energy at corners by one formula is that of a sweep") {
  for (const auto& [system, grid] : cases()) {
    FieldSet level = random_fields(system.field_count(), grid.size(), 4);
    for (int f = 0; f < system.field_count(); ++f) {
      if (system.structure().at_midpoints(f)) {
        std::ranges::fill(level.field(f), 0.0);  // levels do not have it
      }
    }
    const PotentialSlopes slopes = some_slopes(system, grid);
    CellSweep sweep(system, grid, Collocation::corners);
    CornerEnergy energy(system, grid);
    const double scale = rounding * static_cast<double>(grid.size());
    const double expected = sweep(std::as_const(level).pointers(), slopes, {}, 0.0, {}, {}).energy;
    CHECK(energy(level, slopes) == Approx(expected).margin(scale));
    for (int f = 0; f < system.field_count(); ++f) {
      level.field(f)[2] += system.structure().at_midpoints(f) ? 0.0 : 1e-2 * (1.0 + f);
    }
    CHECK(std::abs(energy(level, slopes) - expected) > scale);
  }
}

TEST_CASE("leapfrog finds the energy of a level in the step that leads to it, and from the level alone") {
  const double h = 0.01;
  int schemes = 0;
  for (const auto& [system, grid] : cases()) {
    const auto method = make_lattice_method({.name = "leapfrog"});
    LatticeLevel level{random_fields(system.field_count(), grid.size(), 4), some_slopes(system, grid)};
    std::unique_ptr<LatticeScheme> scheme;
    try {
      scheme = method->scheme(system, grid, level, h);
    } catch (const std::invalid_argument&) {
      continue;  // not of wave type
    }
    // That of the system at the nodes, whose fields are those of a level.
    CornerEnergy of_system(system, grid);
    const auto energy = [&] { return of_system(scheme->level().fields, scheme->level().slopes); };
    const double scale = rounding * static_cast<double>(grid.size());
    for (int k = 0; k < 3; ++k) {
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      const double before = scheme->node().energy;
      CHECK((k == 0 || std::abs(before - energy()) <= scale * (1.0 + std::abs(before))));
      REQUIRE(scheme->advance(1.5 * h, 0.0) == Status::success);
      if (k > 0) {
        REQUIRE(scheme->advance(h, 0.0) == Status::success);
      }
      scheme->accept();
      const double here = scheme->node().energy;
      CHECK(std::abs(here - energy()) <= scale * (1.0 + std::abs(here)));
      CHECK(std::abs(here - before) > 1e3 * scale * (1.0 + std::abs(here)));  // the twin
      // From the level alone it is the same to the last bit.
      const LatticeLevel copy = scheme->level();
      const auto other = method->scheme(system, grid, copy, h);
      CHECK(other->node().energy == here);
      scheme->stand(copy, copy, h);
      CHECK(scheme->node().energy == here);
    }
    ++schemes;
  }
  CHECK(schemes >= 3);
}

TEST_CASE("the variation in the place of a node by formulas is that of the lattice") {
  const double h = 0.13, next_h = 0.09;
  int actions = 0, places = 0;
  for (const auto& [system, grid] : cases()) {
    const int d = system.field_count(), rows = 1 + grid.dimensions();
    const FieldSet first = random_fields(d, grid.size(), 1), second = random_fields(d, grid.size(), 2),
                   third = random_fields(d, grid.size(), 3);
    const PotentialSlopes slopes = some_slopes(system, grid);
    for (const LatticeAction& action : actions_of(system)) {
      if (!has_neighbours_alone(action)) {
        continue;
      }
      ++actions;
      places += action.places.empty() ? 0 : 1;
      LatticeVariation variation(action, grid);
      LatticeVariation::Parts earlier(rows, grid.size()), later(earlier);
      variation.take(first, second, h, slopes);
      variation.coordinates(earlier);
      variation.take(second, third, next_h, slopes);
      variation.coordinates(later);
      CoordinateVariation formulas(action, grid);
      formulas.take(first, second, h, slopes, false);
      formulas.take(second, third, next_h, slopes, true);
      FieldSet between(rows, grid.size()), other(between);
      formulas.between(between);
      // What is kept of the level between is what is found anew.
      CoordinateVariation anew(action, grid);
      anew.take(first, second, h, slopes, false);
      anew.take(second, third, next_h, slopes, false);
      anew.between(other);
      CHECK(std::ranges::equal(other.all(), between.all()));
      // The twin: a slab of another length.
      formulas.take(second, third, 1.01 * next_h, slopes, false);
      formulas.between(other);
      for (int nu = 0; nu < rows; ++nu) {
        double worst = 0.0, size = 0.0, change = 0.0;
        for (std::size_t i = 0; i < grid.size(); ++i) {
          const double expected = earlier.after.field(nu)[i] + later.before.field(nu)[i];
          worst = std::max(worst, std::abs(between.field(nu)[i] - expected));
          size = std::max(size, std::abs(earlier.after.field(nu)[i]) + std::abs(later.before.field(nu)[i]));
          change = std::max(change, std::abs(other.field(nu)[i] - expected));
        }
        CHECK(worst <= rounding * std::max(size, 1.0));
        CHECK(change > 1e-4);
      }
    }
  }
  CHECK(actions >= 12);
  CHECK(places >= 3);
  // Only neighbours: a spectral derivative is refused.
  const grids::Grid line({{"x", 0, 2, 8}});
  CHECK_THROWS_AS(CoordinateVariation(make_lattice_method({.name = "fourier"})->action(sine_gordon()).value(), line),
                  std::invalid_argument);
}
