// Splittings on differences of neighbours: space = "differences".

#include <cmath>
#include <numbers>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/moving_frame.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr double pi = std::numbers::pi;

LatticeOptions options_on(const char* space, double step, double until) {
  return {.lagrangian = "splitting",
          .composition = "blanes-moan-4",
          .space = space,
          .step = step,
          .until = until,
          .levels = Levels::fixed};
}

double hump(double x) {
  return std::exp(2 * std::cos(pi * (x - 1) / 8) - 2);
}

/// The largest residuals of a short run, by law, and its last level.
struct Ran {
  std::vector<double> residuals;
  std::vector<double> u;
};

Ran run(const MultisymplecticSystem& system, LatticeOptions options, std::size_t cells,
        const std::vector<LinearSymmetry>& symmetries = {}) {
  options.symmetries = symmetries;
  const grids::Grid grid({{"x", -8, 8, cells}});
  InitialFields initial(system.fields().size());
  initial[0] = sampled(grid, hump);
  initial[1] = sampled(grid, [](double x) { return 0.5 * hump(x + 2); });
  LatticeIntegrator lattice(system, grid, initial, options);
  Ran ran;
  ran.residuals.assign(lattice.laws().names().size(), 0.0);
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    const auto sizes = lattice.residuals();
    for (std::size_t law = 0; law < sizes.size(); ++law) {
      ran.residuals[law] = std::max(ran.residuals[law], sizes[law].largest());
    }
  }
  const auto u = lattice.field(0);
  ran.u.assign(u.begin(), u.end());
  return ran;
}

}  // namespace

TEST_CASE("a wave on differences has their frequency") {
  // u_tt = δ⁺δ⁻u - u: ω² = 1 + (2/Δx sin(kΔx/2))², the flow of the waves exact.
  for (const std::size_t cells : {24, 25}) {
    const grids::Grid grid({{"x", 0, 2 * pi, cells}});
    LatticeIntegrator lattice(wave_equation("u^2/2"), grid,
                              {sampled(grid, [](double x) { return std::cos(3 * x); }),
                               sampled(grid, [](double) { return 0.0; }), std::nullopt},
                              options_on("differences", 0.5, 5));
    while (!lattice.finished()) {
      REQUIRE(lattice.step().status == Status::success);
    }
    const double difference = 2 / grid.spacing(0) * std::sin(1.5 * grid.spacing(0));
    const double omega = std::sqrt(1 + difference * difference);
    for (std::size_t i = 0; i < cells; ++i) {
      const double x = grid.axis(0).node(i);
      CHECK(lattice.field(0)[i] == Approx(std::cos(omega * 5) * std::cos(3 * x)).margin(1e-13));
      // w = δ⁻u
      CHECK(lattice.field(2)[i] ==
            Approx(std::cos(omega * 5) * (std::cos(3 * x) - std::cos(3 * (x - grid.spacing(0)))) / grid.spacing(0))
                .margin(1e-12));
    }
    CHECK(std::abs(omega - std::sqrt(10.0)) > 0.01);  // the twin: not that of the derivative
  }
}

TEST_CASE("on differences the local laws of energy and charge hold at every node, however coarse the grid is") {
  // Exact while time is continuous; over a step to the order of Gauss's quadrature on its stages: h = 0.02 to the
  // fourth. On 25 cells the derivative in space is off by some percent.
  const Ran wave = run(sine_gordon(), options_on("differences", 0.02, 0.4), 25);
  CHECK(wave.residuals[0] < 1e-6);
  CHECK(wave.residuals[1] > 1e-3);  // momentum is a law in the limit only, of first order in Δx
  const double finer = run(sine_gordon(), options_on("differences", 0.01, 0.4), 25).residuals[0];
  CHECK(std::log2(wave.residuals[0] / finer) == Approx(4).margin(0.3));

  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(4, 4);
  B(0, 1) = B(2, 3) = -1;
  B(1, 0) = B(3, 2) = 1;
  const Ran charged = run(schroedinger(2), options_on("differences", 0.01, 0.2), 25, {{"charge", B}});
  REQUIRE(charged.residuals.size() == 3);
  CHECK(charged.residuals[0] < 1e-5);
  CHECK(charged.residuals[2] < 1e-5);
  CHECK(charged.residuals[1] > 1e-3);
}

TEST_CASE("differences are of second order in space, and their momentum law of first") {
  const auto error = [](std::size_t cells) {
    const Ran coarse = run(sine_gordon(), options_on("differences", 0.02, 1), cells);
    const Ran exact = run(sine_gordon(), options_on("fourier", 0.02, 1), cells);
    return std::pair{largest_difference(coarse.u, exact.u), coarse.residuals[1]};
  };
  const auto [coarse, momentum] = error(100);
  const auto [fine, momentum_fine] = error(200);
  const auto [finest, momentum_finest] = error(400);
  CHECK(std::log2(coarse / fine) == Approx(2).margin(0.1));
  CHECK(std::log2(fine / finest) == Approx(2).margin(0.05));
  CHECK(std::log2(momentum_fine / momentum_finest) == Approx(1).margin(0.1));
}

TEST_CASE("differences of fields that M joins are central, so that frames keep the second order") {
  // δ⁺ for both, as fields half a cell apart have them, would be of first order.
  const MovingFrame frame{.velocity = {2.0}};
  for (const MultisymplecticSystem& laboratory : {schroedinger(2), sine_gordon()}) {
    const MultisymplecticSystem system = frame.seen(laboratory);
    const int f = laboratory.fields()[0] == "p" ? system.field("p") : system.field("u"),
              g = laboratory.fields()[0] == "p" ? system.field("q") : system.field("v");
    CHECK(system.structure().K_plus[0](f, g) == 0.5 * system.K(0)(f, g));
    CHECK(system.structure().K_plus[0](g, f) == -0.5 * system.K(0)(f, g));
    const auto error = [&](std::size_t cells) {
      return largest_difference(run(system, options_on("differences", 0.02, 1), cells).u,
                                run(system, options_on("fourier", 0.02, 1), cells).u);
    };
    const double fine = error(200);
    CHECK(std::log2(fine / error(400)) == Approx(2).margin(0.1));
    // The law of energy holds to the order of the step, however coarse the grid is.
    const auto residual = [&](double h) { return run(system, options_on("differences", h, 0.4), 25).residuals[0]; };
    CHECK(std::log2(residual(0.02) / residual(0.01)) == Approx(4).margin(0.3));
  }
}

TEST_CASE("derivatives in space are a choice of the splitting alone") {
  CHECK_THROWS_WITH(make_lattice_method({.name = "box", .space = "differences"}),
                    Catch::Matchers::Contains("box has no choice of derivatives in space"));
  CHECK_THROWS_WITH(make_lattice_method({.name = "splitting", .space = "difference"}),
                    Catch::Matchers::Contains("\"fourier\" and \"differences\""));
}
