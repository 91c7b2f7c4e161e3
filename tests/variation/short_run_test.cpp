// Step potentials of runs that are too short for a scout (theory, section 9): steps are nearly equal, whatever η does.

#include <catch2/catch.hpp>

#include <cmath>
#include <numbers>

#include <rubato/base/limits.hpp>
#include <rubato/variation/step_potential.hpp>

using namespace rubato;

namespace {

constexpr double h = 0.1;

/// The first of a run's steps, of order 4, with which the node energy is off by this part of the terms of K.
Scouting first_step(double off) {
  return {.order = 4,
          .step = h,
          .time = {0.5 * h},
          .eta = {off / (5.0 * std::pow(h, 4))},
          .duration = h,
          .energy_size = 1.0,
          .first_size = 1.0};
}

/// What comes of it where η swings between `factor` times that of the first step and minus that, in 10 steps.
Scouting swinging(const Scouting& first, double factor) {
  Scouting scouting = first;
  for (int k = 1; k < 400; ++k) {
    scouting.time.push_back((k + 0.5) * h);
    scouting.eta.push_back(factor * first.eta.front() * std::sin(2.0 * std::numbers::pi * k / 10.0));
  }
  scouting.duration = 400.0 * h;
  return scouting;
}

}  // namespace

TEST_CASE("A run is short at order 4 and more, and where a scout of 400 steps would be a quarter of it") {
  CHECK(is_short_run(4, h, 1599.0 * h));
  CHECK(is_short_run(6, -h, 10.0 * h));
  CHECK_FALSE(is_short_run(4, h, 1601.0 * h));
  CHECK_FALSE(is_short_run(2, h, 10.0 * h));  // an η of one sign lets steps follow it
  CHECK_FALSE(is_short_run(4, h, infinity));  // nobody knows how long it is to be
}

TEST_CASE("With nearly equal steps levels exist for an η of hundreds of times the first, of either sign") {
  // (s+1) h^s |η| < 4 f' for all: f' is at least a hundred times what it is in the first step.
  for (const double off : {-1e-3, 1e-4, 1e-6, -1e-9}) {
    INFO("the node energy is off by " << off);
    const Scouting first = first_step(off);
    const StepPotential potential = nearly_equal_steps(first, std::nullopt);
    CHECK(potential.strength * off > 0.0);
    CHECK(std::abs(potential.energy(h)) >= 0.95 * std::max(1e-3, 100.0 * std::abs(off)));  // to two digits
    CHECK(std::abs(potential.energy(h)) <= 1.05 * std::max(1e-3, 100.0 * std::abs(off)));
    CHECK(forecast_levels(swinging(first, 100.0), potential).complete);
    // p f' dh/h = (s+1) h^s dη: four hundredths of f' move h by 1/16 of that.
    const LevelForecast calm = forecast_levels(swinging(first, 2.0), potential);
    CHECK(calm.complete);
    CHECK(calm.longest / calm.shortest < 1.01);
    // The twin: a potential that the swings of η outdo.
    StepPotential weak = potential;
    weak.strength = off;
    CHECK_FALSE(forecast_levels(swinging(first, 100.0), weak).complete);
  }
}

TEST_CASE("Nearly equal steps keep to the largest that is asked for") {
  CHECK(nearly_equal_steps(first_step(1e-6), 2.0 * h).length == h);
  CHECK(nearly_equal_steps(first_step(1e-6), 0.5 * h).length == Approx(0.5 * h));
}
