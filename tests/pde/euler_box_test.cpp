#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

/// The error of the breather at t = 4, the velocity started half a step back so that the scheme is leapfrog.
double error(std::size_t cells, double step) {
  const double g = std::sqrt(0.75);
  const grids::Grid grid({{"x", -20, 20, cells}});
  const auto u = [g](double x, double t) { return 4 * std::atan(2 * g * std::sin(t / 2) * sech(g * x)); };
  LatticeIntegrator lattice(sine_gordon(), grid,
                            {sampled(grid, [&](double x) { return u(x, 0); }),
                             sampled(grid, [&](double x) { return (u(x, 0) - u(x, -step)) / step; }), std::nullopt},
                            {.lagrangian = "euler-box", .step = step, .until = 4, .levels = Levels::fixed});
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
  }
  return largest_difference(lattice.field(0), sampled(grid, [&](double x) { return u(x, lattice.t()); }));
}

}  // namespace

TEST_CASE("euler-box solves the wave equation as leapfrog does, to second order in u") {
  const double coarse = error(200, 0.1);
  const double fine = error(400, 0.05);
  INFO("errors " << coarse << ", " << fine);
  CHECK(std::log2(coarse / fine) == Approx(2.0).margin(0.15));
}

TEST_CASE("euler-box satisfies its two-step equation") {
  const grids::Grid grid({{"x", -10, 10, 80}});
  const double h = 0.1;
  LatticeIntegrator lattice(schroedinger(2), grid,
                            {sampled(grid, [](double x) { return sech(x); }),
                             sampled(grid, [](double x) { return 0.3 * sech(x - 1); }), std::nullopt, std::nullopt},
                            {.lagrangian = "euler-box", .step = 0.02 * h, .until = 1, .levels = Levels::fixed});
  REQUIRE(lattice.step().status == Status::success);
  const grids::FieldSet z_0 = lattice.previous().fields;
  const grids::FieldSet z_1 = lattice.level().fields;
  REQUIRE(lattice.step().status == Status::success);
  const grids::FieldSet& z_2 = lattice.level().fields;
  // Row p, M₊[p,q] = 1, K₊[p,v] = -1: q_2 - q_1 = h [2|ψ|²p + δ⁺v] at level 1; row q: -(p_1 - p_0) = h [2|ψ|²q + δ⁺w].
  double worst = 0.0;
  double wrong = 0.0;
  const double step = 0.02 * h;
  for (std::size_t i = 0; i + 1 < grid.size(); ++i) {
    const double p = z_1.field(0)[i];
    const double q = z_1.field(1)[i];
    const double square = p * p + q * q;
    const double v_x = (z_1.field(2)[i + 1] - z_1.field(2)[i]) / grid.spacing(0);
    const double w_x = (z_1.field(3)[i + 1] - z_1.field(3)[i]) / grid.spacing(0);
    worst = std::max(worst, std::abs((z_2.field(1)[i] - q) / step - (2 * square * p + v_x)));
    worst = std::max(worst, std::abs(-(p - z_0.field(0)[i]) / step - (2 * square * q + w_x)));
    wrong = std::max(wrong, std::abs((z_2.field(1)[i] - q) / step - (2 * square * q + v_x)));
  }
  CHECK(worst < 1e-11);  // rounding of 1 over h = 2e-3
  CHECK(wrong > 1e-3);
}

TEST_CASE("euler-box refuses what it cannot do, with the reason") {
  using Catch::Matchers::Contains;
  const grids::Grid grid({{"x", -10, 10, 80}});
  const auto zero = sampled(grid, [](double) { return 0.0; });
  CHECK_THROWS_WITH(LatticeIntegrator(sine_gordon(), grid, {zero, zero, std::nullopt},
                                      {.lagrangian = "euler-box", .step = 0.1, .until = 1}),
                    Contains("fixed levels only"));
  CHECK_THROWS_WITH(initial_level(korteweg_de_vries(6, 1), grid, {zero, zero, zero, zero}, Collocation::corners),
                    Contains("no equation gives phi"));
}
