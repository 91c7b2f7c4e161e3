// S has no preferred zero: a constant added to it changes no step of a lattice.

#include <catch2/catch.hpp>

#include <cmath>
#include <string>
#include <vector>

#include <rubato/pde/first_step.hpp>
#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

struct Run {
  std::vector<double> h, energy, condition, off_law, last;
  double scale = 0.0;
  double rounding = 0.0;
};

/// A kink and an antikink on a ring, from where they are about to collide: Γ changes sign, and steps are off the law.
Run collide(const MultisymplecticSystem& system, LatticeOptions options, std::size_t cells = 101, double ring = 20.0) {
  const double c = 0.5, g = 1.0 / std::sqrt(1.0 - c * c);
  const grids::Grid grid({{"x", -ring / 2, ring / 2, cells}});
  const auto kink = [=](double y) { return 4 * std::atan(std::exp(g * y)); };
  LatticeIntegrator lattice(
      system, grid,
      {sampled(grid, [=](double x) { return kink(x + 5) - kink(x - 5); }),
       sampled(grid, [=](double x) { return -2 * c * g * (sech(g * (x + 5)) + sech(g * (x - 5))); }), std::nullopt},
      options);
  Run run;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    run.h.push_back(report.h);
    run.energy.push_back(report.energy);
    run.condition.push_back(report.condition);
    run.off_law.push_back(report.off_law ? 1.0 : 0.0);
    if (!report.off_law && options.levels == Levels::variable) {
      REQUIRE(std::abs(report.energy - report.target) <= 1e-13 * std::abs(report.target));
    }
  }
  run.last.assign(lattice.field(0).begin(), lattice.field(0).end());
  run.scale = lattice.levels().energy_scale();
  run.rounding = lattice.levels().energy_rounding();
  return run;
}

}  // namespace

TEST_CASE("a constant added to S changes no step of a lattice") {
  for (const char* const lagrangian : {"box", "fourier"}) {
    const LatticeOptions options{
        .lagrangian = lagrangian, .step = 0.1, .until = 12.0, .on_singular = OnSingular::plain};
    const Run run = collide(sine_gordon(), options);
    CHECK(std::ranges::count(run.off_law, 1.0) > 0);
    // Half of what is there, and a thousand times the energy (16) on 20 of length.
    for (const double constant : {0.5, 801.0}) {
      const Run raised = collide(wave_equation(std::to_string(constant) + " - cos(u)"), options);
      CHECK(raised.h == run.h);
      CHECK(raised.last == run.last);
      CHECK(raised.condition == run.condition);
      CHECK(raised.off_law == run.off_law);
      const double shift = (constant - 1.0) * 20.0;
      for (std::size_t k = 0; k < run.energy.size(); ++k) {
        REQUIRE(std::abs(raised.energy[k] - run.energy[k] - shift) <= 4e-16 * (std::abs(shift) + 20.0));
      }
    }
  }
}

TEST_CASE("the twin: a constant that S hides in its terms is felt, as the rounding it makes") {
  const LatticeOptions options{.step = 0.1, .until = 3.0};
  const Run run = collide(sine_gordon(), options);
  const Run felt = collide(wave_equation("1000*(sin(u)^2 + cos(u)^2) - cos(u)"), options);
  CHECK(felt.h != run.h);
  CHECK(felt.rounding > 100.0 * run.rounding);
}

TEST_CASE("what the tolerance of a lattice is relative to does not grow with the vacuum around what moves") {
  const LatticeOptions options{.step = 0.1, .until = 1.0};
  const Run small = collide(sine_gordon(), options, 101, 20.0);
  const Run large = collide(sine_gordon(), options, 505, 100.0);
  CHECK(large.scale < 1.5 * small.scale);
  CHECK(large.scale > 0.7 * small.scale);
  // It is about the energy of the kinks, 2·8/√(1 - c²), each term of which is counted once.
  CHECK(small.scale > 10.0);
  CHECK(small.scale < 60.0);
}
