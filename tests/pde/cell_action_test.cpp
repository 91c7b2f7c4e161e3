#include <array>
#include <random>

#include <catch2/catch.hpp>

#include <rubato/variation/total_variation.hpp>

#include "cell_action.hpp"
#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;
using Eigen::VectorXd;

namespace {

/// Random values on the 3 × 3 nodes around an interior node, at levels and nodes that are not equidistant in time.
struct Patch {
  explicit Patch(const MultisymplecticSystem& system, unsigned seed) : d(system.field_count()) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> value(-1.0, 1.0);
    for (auto& row : z) {
      for (auto& node : row) {
        node = VectorXd::NullaryExpr(d, [&] { return value(random); });
      }
    }
  }

  [[nodiscard]] std::vector<double> corners(int k, int i) const {
    std::vector<double> result;
    for (int c = 0; c < 4; ++c) {
      const int level = k + c / 2;
      const int node = i + c % 2;
      result.push_back(t[static_cast<std::size_t>(level)]);
      result.push_back(x[static_cast<std::size_t>(node)]);
      const VectorXd& values = z[static_cast<std::size_t>(level)][static_cast<std::size_t>(node)];
      result.insert(result.end(), values.begin(), values.end());
    }
    return result;
  }

  Eigen::Index d;
  std::array<double, 3> t{0.3, 0.42, 0.61};
  std::array<double, 3> x{1.0, 1.25, 1.5};
  std::array<std::array<VectorXd, 3>, 3> z;
};

/// What the theory says of one cell, straight from its formulas.
struct Cell {
  Cell(const MultisymplecticSystem& system, const Patch& patch, int k, int i) {
    const auto at = [&](int level, int node) -> const VectorXd& {
      return patch.z[static_cast<std::size_t>(k + level)][static_cast<std::size_t>(i + node)];
    };
    h = patch.t[static_cast<std::size_t>(k) + 1] - patch.t[static_cast<std::size_t>(k)];
    dx = patch.x[static_cast<std::size_t>(i) + 1] - patch.x[static_cast<std::size_t>(i)];
    const VectorXd mean = (at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1)) / 4;
    const VectorXd z_t = (at(1, 0) - at(0, 0) + at(1, 1) - at(0, 1)) / (2 * h);
    const VectorXd z_x = (at(0, 1) - at(0, 0) + at(1, 1) - at(1, 0)) / (2 * dx);
    formula::ScalarEvaluator evaluate(system.gradient_code());
    std::vector<double> outputs(static_cast<std::size_t>(patch.d) + 1);
    evaluate({mean.data(), static_cast<std::size_t>(patch.d)}, outputs);
    const double S = outputs[0];
    R = system.M() * z_t + system.K(0) * z_x - Eigen::Map<const VectorXd>(outputs.data() + 1, patch.d);
    e = S - 0.5 * mean.dot(system.K(0) * z_x);
    f = 0.5 * mean.dot(system.K(0) * z_t);
    m = 0.5 * mean.dot(system.M() * z_x);
    g = S - 0.5 * mean.dot(system.M() * z_t);
  }
  VectorXd R;
  double h, dx, e, f, m, g;
};

void check_variations(const MultisymplecticSystem& system, const MultisymplecticSystem& claimed, bool holds) {
  FormulaAction action = box_cell_action(system);
  const Patch patch(system, 7);
  std::vector<std::vector<double>> corners;
  std::vector<Incidence> elements;
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < 2; ++i) {
      corners.push_back(patch.corners(k, i));
    }
  }
  std::vector<Cell> cells;
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < 2; ++i) {
      cells.emplace_back(claimed, patch, k, i);
      elements.push_back({corners[cells.size() - 1], static_cast<std::size_t>(3 - 2 * k - i)});
    }
  }
  VectorXd node = VectorXd::Zero(patch.d);
  for (const Cell& cell : cells) {
    node += cell.h * cell.dx / 4 * cell.R;
  }
  const double dx = cells[0].dx;
  // cells: 0 and 1 before the node's level, left and right of it; 2 and 3 after.
  const double energy =
      ((cells[2].e + cells[3].e) - (cells[0].e + cells[1].e)) / 2 * dx +
      ((cells[1].h * cells[1].f + cells[3].h * cells[3].f) - (cells[0].h * cells[0].f + cells[2].h * cells[2].f)) / 2;
  const double momentum =
      ((cells[2].m + cells[3].m) - (cells[0].m + cells[1].m)) / 2 * dx +
      ((cells[1].h * cells[1].g + cells[3].h * cells[3].g) - (cells[0].h * cells[0].g + cells[2].h * cells[2].g)) / 2;
  // Rounding of a few dozen terms of order 1.
  constexpr double tolerance = 1e-13;
  const bool values_agree = (value_variation(action, elements) - node).norm() < tolerance;
  const bool times_agree = std::abs(coordinate_variation(action, elements, 0) - energy) < tolerance;
  const bool places_agree = std::abs(coordinate_variation(action, elements, 1) - momentum) < tolerance;
  CHECK(values_agree == holds);
  CHECK(times_agree == holds);
  CHECK(places_agree == holds);
}

}  // namespace

TEST_CASE("varying values, times and places of a node gives the box scheme, the energy law and the momentum law") {
  for (const auto& system : {sine_gordon(), schroedinger(2), korteweg_de_vries(6, 1), good_boussinesq(), dirac(1, 1)}) {
    check_variations(system, system, true);
  }
}

TEST_CASE("the variations of one equation are not those of another") {
  check_variations(sine_gordon(),
                   make_system({"u", "v", "w"}, {{"u", "v", -1.1}}, {{{"u", "w", 0.9}}}, "(v^2 - w^2)/2 + 1 - cos(u)"),
                   false);
}
