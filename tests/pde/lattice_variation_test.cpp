#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_action.hpp>
#include <rubato/pde/euler_box_map.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/local_laws.hpp>
#include <rubato/pde/variational_laws.hpp>
#include <rubato/variation/lattice_variation.hpp>
#include <rubato/variation/total_variation.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::FieldSet;
using Side = LatticeVariation::Side;

namespace {

FieldSet random_fields(int fields, std::size_t size, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> value(-1.0, 1.0);
  FieldSet result(fields, size);
  for (double& v : result.all()) {
    v = value(random);
  }
  return result;
}

double largest(const FieldSet& fields) {
  return grids::max_abs(fields.all());
}

FieldSet sum(const FieldSet& a, const FieldSet& b) {
  FieldSet result(a);
  for (std::size_t i = 0; i < result.all().size(); ++i) {
    result.all()[i] += b.all()[i];
  }
  return result;
}

MultisymplecticSystem wave_equation_3d() {
  return make_system({"u", "v", "a", "b", "c"}, {{"u", "v", -1}}, {{{"u", "a", 1}}, {{"u", "b", 1}}, {{"u", "c", 1}}},
                     "(v^2 - a^2 - b^2 - c^2)/2 + 1 - cos(u)");
}

struct Case {
  MultisymplecticSystem system;
  grids::Grid grid;
};

std::vector<Case> cases() {
  const grids::Grid line({{"x", 0, 2, 7}});
  const grids::Grid plane({{"x", 0, 2, 5}, {"y", -1, 1, 7}});
  const grids::Grid block({{"x", 0, 2, 3}, {"y", -1, 1, 5}, {"z", 0, 1, 3}});
  return {{sine_gordon(), line},
          {wave_equation("0"), line},
          {schroedinger(2), line},
          {korteweg_de_vries(6, 1), line},
          {good_boussinesq(), line},
          {dirac(1, 1), line},
          {wave_equation_2d("1 - cos(u)"), plane},
          {wave_equation_3d(), block}};
}

bool lives_at_midpoints(const MultisymplecticSystem& system) {
  bool some = false;
  for (int f = 0; f < system.field_count(); ++f) {
    some = some || system.structure().at_midpoints(f);
  }
  return some;
}

using Statement = LatticeAction (*)(const MultisymplecticSystem&);
constexpr Statement statements[] = {box_action, fourier_action, euler_box_action};

/// Corner data of the cell (k, i) in FormulaAction's order, from three levels of a line.
std::vector<double> corners(const std::array<FieldSet, 3>& levels, const std::array<double, 3>& t,
                            const grids::Grid& grid, std::size_t k, std::size_t i) {
  std::vector<double> result;
  for (std::size_t c = 0; c < 4; ++c) {
    const std::size_t level = k + c / 2;
    result.push_back(t[level]);
    result.push_back(static_cast<double>(i + c % 2) * grid.spacing(0));
    for (int f = 0; f < levels[level].fields(); ++f) {
      result.push_back(levels[level].field(f)[(i + c % 2) % grid.size()]);
    }
  }
  return result;
}

}  // namespace

// Step sizes 0.1 to 0.3, spacings 0.2 to 0.7, values of order 1: variations are sums of some dozen terms of order 1.
constexpr double rounding = 1e-13;

TEST_CASE("the variations on the mesh are those of the cell's action as a function of its corners") {
  for (const auto& system : {sine_gordon(), schroedinger(2), dirac(1, 1)}) {
    const grids::Grid grid({{"x", 0, 2, 7}});
    const int d = system.field_count();
    const std::array levels{random_fields(d, 7, 1), random_fields(d, 7, 2), random_fields(d, 7, 3)};
    const std::array<double, 3> t{0.3, 0.42, 0.61};
    LatticeVariation mesh(box_action(system), grid);
    FieldSet values_before(d, 7), values_after(d, 7), places_before(2, 7), places_after(2, 7);
    mesh.take(levels[0], levels[1], t[1] - t[0]);
    mesh.values(Side::after, values_after);
    mesh.coordinates(Side::after, places_after);
    mesh.take(levels[1], levels[2], t[2] - t[1]);
    mesh.values(Side::before, values_before);
    mesh.coordinates(Side::before, places_before);
    const FieldSet values = sum(values_before, values_after);
    const FieldSet places = sum(places_before, places_after);

    FormulaAction cell = box_cell_action(system);
    double worst = 0.0;
    double twin = 0.0;  // the neighbour's variation is another
    for (std::size_t i = 1; i < 7; ++i) {
      std::vector<std::vector<double>> data;
      for (std::size_t k = 0; k < 2; ++k) {
        for (std::size_t left = 0; left < 2; ++left) {
          data.push_back(corners(levels, t, grid, k, i - 1 + left));
        }
      }
      const Incidence elements[] = {{data[0], 3}, {data[1], 2}, {data[2], 1}, {data[3], 0}};
      const Eigen::VectorXd expected = value_variation(cell, elements);
      for (int f = 0; f < d; ++f) {
        worst = std::max(worst, std::abs(values.field(f)[i] - expected[f]));
        twin = std::max(twin, std::abs(values.field(f)[i - 1] - expected[f]));
      }
      for (int nu = 0; nu < 2; ++nu) {
        const double place = coordinate_variation(cell, elements, static_cast<std::size_t>(nu));
        worst = std::max(worst, std::abs(places.field(nu)[i] - place));
      }
    }
    CHECK(worst < rounding);
    CHECK(twin > 1e6 * rounding);
  }
}

TEST_CASE("variations of values and of the step are the derivatives of the action") {
  // Central differences of width 2e-5 of an action of order 1: truncation 1e-10, rounding 1e-11.
  constexpr double width = 1e-5;
  constexpr double tolerance = 1e-8;
  for (const auto& [system, grid] : cases()) {
    for (const Statement state : statements) {
      LatticeVariation mesh(state(system), grid);
      const int d = system.field_count();
      FieldSet before = random_fields(d, grid.size(), 4);
      FieldSet after = random_fields(d, grid.size(), 5);
      const double h = 0.2;
      FieldSet lower(d, grid.size()), upper(d, grid.size());
      mesh.take(before, after, h);
      mesh.values(Side::before, lower);
      mesh.values(Side::after, upper);
      const double energy = mesh.energy();
      for (int f = 0; f < d; ++f) {
        for (const std::size_t node : {std::size_t{0}, grid.size() / 2, grid.size() - 1}) {
          for (FieldSet* level : {&before, &after}) {
            double& value = level->field(f)[node];
            const double old = value;
            double action[2];
            for (int side = 0; side < 2; ++side) {
              value = old + (side == 0 ? -width : width);
              mesh.take(before, after, h);
              action[side] = mesh.action_value();
            }
            value = old;
            const FieldSet& variation = level == &before ? lower : upper;
            CHECK(std::abs((action[1] - action[0]) / (2 * width) - variation.field(f)[node]) < tolerance);
          }
        }
      }
      mesh.take(before, after, h + width);
      const double longer = mesh.action_value();
      mesh.take(before, after, h - width);
      const double slope = (longer - mesh.action_value()) / (2 * width);
      CHECK(std::abs(slope + energy) < 10 * tolerance);
      CHECK(std::abs(slope - energy) > 1e3 * tolerance);  // the twin: the other sign
    }
  }
}

TEST_CASE("the times of all nodes of a level vary the action by its discrete energy") {
  for (const auto& [system, grid] : cases()) {
    for (const Statement state : statements) {
      LatticeVariation mesh(state(system), grid);
      const int d = system.field_count();
      mesh.take(random_fields(d, grid.size(), 6), random_fields(d, grid.size(), 7), 0.2);
      FieldSet places(1 + grid.dimensions(), grid.size());
      mesh.coordinates(Side::before, places);
      CHECK(std::abs(grids::sum(std::as_const(places).field(0)) - mesh.energy()) < 10 * rounding);
      mesh.coordinates(Side::after, places);
      CHECK(std::abs(grids::sum(std::as_const(places).field(0)) + mesh.energy()) < 10 * rounding);
    }
  }
}

TEST_CASE("the variational laws of a record are the variations of places") {
  for (const auto& [system, grid] : cases()) {
    for (const bool corners : {false, true}) {
      const int d = system.field_count();
      if (corners && lives_at_midpoints(system)) {
        continue;  // euler-box has no such fields
      }
      LocalLaws laws(system, grid, {}, corners ? Placement::corners : Placement::cells);
      VariationalLaws variational(laws, grid);
      LatticeVariation mesh((corners ? euler_box_action : box_action)(system), grid);
      std::vector<LatticeLevel> levels;
      for (unsigned k = 0; k < 3; ++k) {
        levels.push_back({random_fields(d, grid.size(), 10 + k), {}});
      }
      FieldSet upper(1 + grid.dimensions(), grid.size()), lower(upper);
      static_cast<void>(variational.take(levels[0], levels[1], 0.12));
      mesh.take(levels[0].fields, levels[1].fields, 0.12);
      mesh.coordinates(Side::after, upper);
      REQUIRE(variational.take(levels[1], levels[2], 0.19));
      mesh.take(levels[1].fields, levels[2].fields, 0.19);
      mesh.coordinates(Side::before, lower);
      const FieldSet places = sum(lower, upper);
      for (int nu = 0; nu <= grid.dimensions(); ++nu) {
        double worst = 0.0;
        for (std::size_t i = 0; i < grid.size(); ++i) {
          worst =
              std::max(worst, std::abs(places.field(nu)[i] - variational.residual(static_cast<std::size_t>(nu))[i]));
        }
        INFO(system.fields()[0] << system.fields()[1] << d << ", corners " << corners << ", nu " << nu);
        CHECK(worst < rounding);
      }
    }
  }
}

TEST_CASE("the two-form of any two variations sums to zero over both levels of a slab") {
  for (const auto& [system, grid] : cases()) {
    for (const Statement state : statements) {
      LatticeVariation mesh(state(system), grid);
      const int d = system.field_count();
      const auto field = [&](unsigned seed) { return random_fields(d, grid.size(), seed); };
      mesh.take(field(20), field(21), 0.2);
      const FieldSet u_0 = field(22), u_1 = field(23), v_0 = field(24), v_1 = field(25);
      std::vector<double> lower(grid.size()), upper(grid.size());
      mesh.two_form(Side::before, u_0, u_1, v_0, v_1, lower);
      mesh.two_form(Side::after, u_0, u_1, v_0, v_1, upper);
      CHECK(std::abs(grids::sum(lower) + grids::sum(upper)) < 10 * rounding);
      mesh.two_form(Side::after, u_0, u_1, v_0, field(26), upper);  // the twin: another V
      CHECK(std::abs(grids::sum(lower) + grids::sum(upper)) > 1e6 * rounding);
    }
  }
}

TEST_CASE("varying the values of the euler-box action gives its map") {
  for (const auto& [system, grid] :
       {Case{sine_gordon(), grids::Grid({{"x", 0, 2, 8}})}, Case{schroedinger(2), grids::Grid({{"x", 0, 2, 8}})}}) {
    const int d = system.field_count();
    EulerBoxMap map(system, grid);
    FieldSet first = random_fields(d, grid.size(), 30);
    REQUIRE(map.start(first) == Status::success);
    FieldSet second(first), third(first);
    const double h = 0.03;
    REQUIRE(map.advance(h, first, second) == Status::success);
    REQUIRE(map.advance(h, second, third) == Status::success);
    LatticeVariation mesh(euler_box_action(system), grid);
    FieldSet upper(d, grid.size()), lower(upper);
    mesh.take(first, second, h);
    mesh.values(Side::after, upper);
    mesh.take(second, third, h);
    mesh.values(Side::before, lower);
    CHECK(largest(sum(lower, upper)) < rounding);
    for (int f = 0; f < d; ++f) {
      third.field(f)[3] += 1e-6;  // the twin
    }
    mesh.take(second, third, h);
    mesh.values(Side::before, lower);
    CHECK(largest(sum(lower, upper)) > 1e-9);
  }
}
