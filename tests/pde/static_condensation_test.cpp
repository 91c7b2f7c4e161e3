#include <cmath>
#include <random>
#include <utility>

#include <catch2/catch.hpp>

#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/static_condensation.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

TEST_CASE("fields that their own row gives node by node are found") {
  CHECK(StaticCondensation(sine_gordon()).free() == std::vector<int>{0, 2});
  CHECK(StaticCondensation(wave_equation_2d("1 - cos(u)")).free() == std::vector<int>{0, 2, 3});
  CHECK(StaticCondensation(schroedinger(2)).free() ==
        std::vector<int>{0, 1, 2, 3});  // all in K, or not alone in their row
  CHECK(StaticCondensation(dirac(1, 0.5)).free() == std::vector<int>{0, 1, 2, 3});
  // v enters S with u, or not quadratically.
  const auto wave = [](const char* S) { return make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, S); };
  CHECK(StaticCondensation(wave("(v^2 - w^2)/2 + u*v")).free().size() == 3);
  CHECK(StaticCondensation(wave("(v^2 - w^2)/2 + v^4")).free().size() == 3);
  CHECK(StaticCondensation(sine_gordon(), nullptr).free().size() == 3);
}

TEST_CASE("condensed fields satisfy their row in every cell, and leave a Schur complement to the others") {
  const auto system =
      make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "3*v^2/2 + v/4 - w^2/2 + 1 - cos(u)");
  const StaticCondensation condensed(system);
  REQUIRE(condensed.free() == std::vector<int>{0, 2});
  const grids::Grid grid({{"x", -3, 3, 41}});
  const double h = 0.1;
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> value(-1, 1);
  grids::FieldSet high(3, grid.size());
  grids::FieldSet delta(high);
  const grids::FieldSet low(3, grid.size());
  for (std::size_t i = 0; i < high.all().size(); ++i) {
    high.all()[i] = value(random);
    delta.all()[i] = h * value(random);
  }
  const auto residual_of_v = [&] {
    grids::FieldSet middle(high);
    for (std::size_t i = 0; i < middle.all().size(); ++i) {
      middle.all()[i] += 0.5 * delta.all()[i];
    }
    grids::FieldSet residual(3, grid.size());
    CellSweep sweep(system, grid);
    REQUIRE(sweep(std::as_const(middle).pointers(), {}, std::as_const(delta).pointers(), 1 / h, residual.pointers(), {})
                .finite);
    double worst = 0.0;
    for (const double r : std::as_const(residual).field(1)) {
      worst = std::max(worst, std::abs(r));
    }
    return worst;
  };
  CHECK(residual_of_v() > 0.1);
  condensed.follow(h, high, low, delta);
  CHECK(residual_of_v() < 1e-14);  // terms of order 1

  // Eliminating v by hand: the rows of the free fields applied to (c_u, c_v, c_w) with c_v of correct().
  grids::FieldSet correction(3, 1);
  for (double& c : correction.all()) {
    c = value(random);
  }
  condensed.correct(h, correction);
  const Eigen::Vector3d c(correction.all()[0], correction.all()[1], correction.all()[2]);
  const Eigen::Vector3d full = ((2 / h) * system.M() - system.constant_hessian()) * c;
  Eigen::MatrixXd mean;
  condensed.reduced_mean(h, mean);
  const Eigen::Vector2d reduced = mean * Eigen::Vector2d(c[0], c[2]);
  CHECK(std::abs(full[1]) < 1e-13);  // 2/h times rounding
  CHECK((reduced - Eigen::Vector2d(full[0], full[2])).norm() < 1e-12);
}
