#include <algorithm>
#include <cmath>
#include <numbers>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

// Colliding kinks: Γ of the lattice (theory, section 5) changes sign while they overlap.

using namespace rubato;
using namespace rubato::tests;

namespace {

struct Collisions {
  Status status = Status::success;
  std::size_t off_law = 0;
  int collisions = 0;             ///< times at which the kink and the antikink met
  double energy_deviation = 0.0;  ///< max |E_k - E| / max(|E|, max |H|) over the steps on the law
};

/// A kink at -L/4 and an antikink at L/4 that move towards each other with speed c on a ring of length L, followed
/// through five collisions: the first at L/(4c), and one every L/(2c).
Collisions collide(double c, double step, const LatticeOptions& base = {}) {
  constexpr double L = 40.0;
  const double g = 1.0 / std::sqrt(1.0 - c * c);
  const grids::Grid grid({{"x", -L / 2, L / 2, 201}});
  const auto kink = [=](double y) { return 4 * std::atan(std::exp(g * y)); };
  LatticeOptions options = base;
  options.step = step;
  options.until = 2.5 * L / c;
  options.on_singular = base.on_singular.value_or(OnSingular::plain);
  LatticeIntegrator lattice(
      sine_gordon(), grid,
      {sampled(grid, [=](double x) { return kink(x + L / 4) - kink(x - L / 4); }),
       sampled(grid, [=](double x) { return -2 * c * g * (sech(g * (x + L / 4)) + sech(g * (x - L / 4))); }),
       std::nullopt},
      options);
  Collisions result;
  bool together = false;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    if (report.status != Status::success) {
      result.status = report.status;
      return result;
    }
    result.off_law += report.off_law ? 1 : 0;
    if (!report.off_law) {
      result.energy_deviation = std::max(result.energy_deviation, std::abs(report.energy - lattice.levels().energy()) /
                                                                      lattice.levels().energy_scale());
    }
    double area = 0.0;  // ∫ 1 - cos u, 4/g of each kink: it dips where they overlap
    for (const double u : lattice.field(0)) {
      area += (1.0 - std::cos(u)) * grid.spacing(0);
    }
    const bool overlap = area < (together ? 0.6 : 0.3) * 8.0 / g;
    result.collisions += overlap && !together ? 1 : 0;
    together = overlap;
  }
  return result;
}

}  // namespace

TEST_CASE("kinks and antikinks of several speeds go through five collisions, the discrete energy exact on the law",
          "[long]") {
  for (const double c : {0.2, 0.35, 0.5, 0.65, 0.8}) {
    for (const double step : {0.1, 0.05}) {
      INFO("speed " << c << ", step " << step);
      const Collisions run = collide(c, step);
      REQUIRE(run.status == Status::success);
      CHECK(run.collisions >= 5);
      CHECK(run.energy_deviation <= 1e-12);  // the level equation is solved to a tenth of its tolerance, 1e-13
      // Slow ones are long enough nearly at rest for Γ to change sign; fast ones pass through each other before.
      CHECK((c < 0.6 ? run.off_law >= 5 : run.off_law == 0));
    }
  }
}

TEST_CASE(
    "a collision is passed with the discrete energy exact on the law, which coarser tolerances and fixed levels miss") {
  const Collisions run = collide(0.5, 0.1);
  REQUIRE(run.status == Status::success);
  CHECK(run.off_law >= 5);
  CHECK(run.energy_deviation <= 1e-12);
  CHECK(collide(0.5, 0.1, {.tolerance = 1e-9}).energy_deviation > 1e-12);
  CHECK(collide(0.5, 0.1, {.levels = Levels::fixed}).energy_deviation > 1e-5);
  CHECK(collide(0.5, 0.1, {.on_singular = OnSingular::stop}).status == Status::singular);
}
