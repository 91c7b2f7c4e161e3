#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

TEST_CASE("Fourier holds the charge of a Schrödinger soliton over 10,000 levels, without drift", "[long]") {
  const double k = 4 * M_PI / 40;
  const grids::Grid grid({{"x", -20, 20, 129}});
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(4, 4);
  B(0, 1) = B(2, 3) = -1;
  B(1, 0) = B(3, 2) = 1;
  constexpr int levels = 10000;
  LatticeIntegrator lattice(
      schroedinger(2), grid,
      {sampled(grid, [=](double x) { return sech(x) * std::cos(k * x / 2); }),
       sampled(grid, [=](double x) { return sech(x) * std::sin(k * x / 2); }), std::nullopt, std::nullopt},
      {.lagrangian = "fourier",
       .step = 0.01,
       .until = 0.01 * levels,
       .levels = Levels::fixed,
       .symmetries = {{"charge", B}}});
  const std::vector<double> before = lattice.totals();
  double deviation = 0.0;
  double energy = 0.0;
  int steps = 0;
  std::array<double, 2> halves{};  // the mean deviation of the first and of the last half
  while (!lattice.finished()) {
    REQUIRE(lattice.step().status == Status::success);
    const std::vector<double> now = lattice.totals();
    const double relative = (now[2] - before[2]) / before[2];
    deviation = std::max(deviation, std::abs(relative));
    energy = std::max(energy, std::abs(now[0] - before[0]));
    halves[steps < levels / 2 ? 0 : 1] += 2.0 * relative / levels;
    ++steps;
  }
  INFO("largest deviation " << deviation << ", means " << halves[0] << " and " << halves[1]);
  CHECK(steps == levels);
  CHECK(deviation < 1e-12);
  // A drift of one rounding (1e-16) a level would have moved the halves' means apart by 5e-13; a walk of roundings does
  // by 1e-14.
  CHECK(std::abs(halves[1] - halves[0]) < 1e-13);
  CHECK(energy > 1e-10);  // the twin: the nodal energy is not conserved
}

TEST_CASE("the ring soliton of sine-Gordon in the plane keeps its discrete energy on 255 by 255 cells", "[long]") {
  const grids::Grid grid({{"x", -14, 14, 255}, {"y", -14, 14, 255}});
  std::vector<double> u;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const auto place = grid.place(i);
    u.push_back(4 * std::atan(std::exp(3 - std::hypot(grid.axis(0).node(place[0]), grid.axis(1).node(place[1])))));
  }
  LatticeIntegrator lattice(wave_equation_2d("1 - cos(u)"), grid,
                            {u, std::vector<double>(grid.size(), 0.0), std::nullopt, std::nullopt},
                            {.step = 0.05, .until = 4});
  double low = 0.0;
  double high = 0.0;
  double node_low = lattice.node().energy;
  double node_high = node_low;
  int steps = 0;
  int off_law = 0;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    ++steps;
    off_law += report.off_law ? 1 : 0;
    if (!report.off_law) {
      low = low == 0.0 ? report.energy : std::min(low, report.energy);
      high = std::max(high, report.energy);
    }
    node_low = std::min(node_low, lattice.node().energy);
    node_high = std::max(node_high, lattice.node().energy);
  }
  INFO(steps << " steps, " << off_law << " of them off the law; spread " << (high - low) / high << " of " << high
             << ", of the node energy " << (node_high - node_low) / high);
  CHECK((high - low) / high < 1e-11);
  CHECK((node_high - node_low) / high > 1e-6);  // the twin: the node energy does spread
}
