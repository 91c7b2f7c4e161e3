// Step potentials of steps that are nearly equal (theory, section 9), and when they are taken: where there is nothing
// to follow, or a run is too short for a look-ahead.

#include <catch2/catch.hpp>

#include <cmath>
#include <functional>
#include <numbers>

#include <rubato/base/limits.hpp>
#include <rubato/variation/equal_steps.hpp>
#include <rubato/variation/level_forecast.hpp>

using namespace rubato;

namespace {

constexpr double h = 0.1;
const double two_pi = 2.0 * std::numbers::pi;

/// The first of a run's steps, of order 4, with which the node energy is off by this part of the terms of K.
LookAhead first_step(double off) {
  return {.order = 4,
          .step = h,
          .time = {0.5 * h},
          .eta = {off / (5.0 * std::pow(h, 4))},
          .duration = h,
          .energy_size = 1.0,
          .first_size = 1.0};
}

/// Steps of which each is off by what `off` says of its number.
LookAhead seen(int order, int steps, const std::function<double(int)>& off) {
  LookAhead look{
      .order = order, .step = h, .duration = steps * h, .energy_size = 1.0, .first_size = 1.0, .tolerance = 1e-13};
  for (int k = 0; k < steps; ++k) {
    look.time.push_back((k + 0.5) * h);
    look.eta.push_back(off(k) / ((order + 1.0) * std::pow(h, order)));
  }
  return look;
}

/// What comes of it where η swings between `factor` times that of the first step and minus that, in 10 steps.
LookAhead swinging(const LookAhead& first, double factor) {
  LookAhead look = first;
  for (int k = 1; k < 400; ++k) {
    look.time.push_back((k + 0.5) * h);
    look.eta.push_back(factor * first.eta.front() * std::sin(two_pi * k / 10.0));
  }
  look.duration = 400.0 * h;
  return look;
}

/// As at the pericentre of an eccentric orbit, once in 400 steps.
double peak(int k) {
  return 1e-5 / std::pow(1.0 + std::pow((k - 400 * ((k + 200) / 400)) / 16.0, 2), 3);
}

}  // namespace

TEST_CASE("A run is short at order 4 and more, and where a look-ahead of 400 steps would be a quarter of it") {
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
    const LookAhead first = first_step(off);
    const StepPotential potential = nearly_equal_steps(first).value();
    CHECK(potential.strength * off > 0.0);
    CHECK(std::abs(potential.energy(h)) >= 0.95 * std::max(1e-3, 100.0 * std::abs(off)));  // to six bits
    CHECK(std::abs(potential.energy(h)) <= 1.05 * std::max(1e-3, 100.0 * std::abs(off)));
    CHECK(LevelForecaster(swinging(first, 100.0))(potential).complete);
    // p f' dh/h = (s+1) h^s dη: four hundredths of f' move h by 1/16 of that.
    const LevelForecast calm = LevelForecaster(swinging(first, 2.0))(potential);
    CHECK(calm.complete);
    CHECK(calm.longest / calm.shortest < 1.01);
    // The twin: a potential that the swings of η outdo.
    StepPotential weak = potential;
    weak.strength = off;
    CHECK_FALSE(LevelForecaster(swinging(first, 100.0))(weak).complete);
  }
}

TEST_CASE("Where more than a step was seen levels exist for forty times the largest η of it, nearly equal") {
  for (const double off : {-1e-3, 1e-4, 1e-6, -1e-9}) {
    INFO("the node energy is off by " << off);
    const LookAhead all = swinging(first_step(0.01 * off), 100.0);
    const StepPotential potential = nearly_equal_steps(all).value();
    CHECK(std::abs(potential.energy(h)) >= 0.95 * std::max(1e-4, 9.5 * std::abs(off)));  // sin is 0.951 at most there
    CHECK(std::abs(potential.energy(h)) <= 1.05 * std::max(1e-4, 10.0 * std::abs(off)));
    const LevelForecast forecast = LevelForecaster(all)(potential);
    CHECK(forecast.complete);
    // p f' Δh/h = (s+1) h^s Δη, of 2 · f'/10 from end to end, and p = 16: 1/80.
    CHECK(forecast.longest / forecast.shortest < 1.0 + 1.05 / 80.0);
    for (const double factor : {20.0, -20.0}) {
      CHECK(LevelForecaster(all)(potential, {.factor = factor}).complete);
    }
    StepPotential weak = potential;
    weak.strength = 0.01 * off;
    CHECK_FALSE(LevelForecaster(all)(weak).complete);
  }
}

TEST_CASE("Nearly equal steps take no more of the energy than a twentieth, unless nothing else is known") {
  const auto swing = [](double off) { return seen(4, 40, [off](int k) { return off * std::cos(two_pi * k / 10.0); }); };
  CHECK(nearly_equal_steps(swing(4e-3)).value().energy(h) == Approx(0.04).epsilon(1.0 / 64));
  CHECK(nearly_equal_steps(swing(0.01)).value().energy(h) == Approx(0.05).epsilon(1.0 / 64));
  CHECK(nearly_equal_steps(swing(0.0249)).value().energy(h) == Approx(0.05).epsilon(1.0 / 64));
  CHECK_FALSE(nearly_equal_steps(swing(0.0251)));  // less than two times what was seen
  CHECK_FALSE(equal_steps_do(swing(0.0251)));
  CHECK(nearly_equal_steps(first_step(0.0251)));
  // Beside terms that were much smaller at first they would be all of K.
  LookAhead grown = swing(1e-6);
  grown.energy_size = 1e6;
  CHECK_FALSE(nearly_equal_steps(grown));
}

TEST_CASE("What there is to follow is told by the step law with the weakest potential") {
  // The law's own steps, where none is needed: (s+1) h^s η = D, one after the other, and so small that a sum is an
  // integral.
  constexpr int s = 4;
  const auto off = [](double t) { return 1e-5 * std::pow(1.0 + 100.0 * std::pow(std::sin(0.5 * t), 2), -3.0); };
  LookAhead look = seen(s, 4000, [&](int k) { return off((k + 0.5) * 1e-3 * two_pi); });
  double D = 1e-11, least = D, most = D, steps = 0.0;
  const double turn = 4000.0 * h;
  const auto eta = [&](double t) { return off(4.0 * two_pi * t / turn) / ((s + 1.0) * std::pow(h, s)); };
  for (double t = 0.0; t < turn; ++steps) {
    const double step = std::pow(D / ((s + 1.0) * eta(t)), 1.0 / s);
    D += std::pow(step, s) * (eta(t + step) - eta(t));
    t += step;
    least = std::min(least, D);
    most = std::max(most, D);
  }
  const double following = steps * std::pow(most - least, 1.0 / s);
  const double equal = 4000.0 * std::pow(1e-5 * (1.0 - std::pow(101.0, -3.0)) / (s + 1.0), 1.0 / s);
  CHECK(gain_of_following(look) == Approx(equal / following).epsilon(0.02));
  CHECK(gain_of_following(look) > 3.0);
  // Of a swing to both sides nothing is to be had, nor of what stays as it is.
  CHECK(gain_of_following(seen(4, 40, [](int k) { return std::cos(two_pi * k / 10.0); })) == Approx(1.0).margin(0.1));
  CHECK(gain_of_following(seen(4, 40, [](int) { return -1e-5; })) == 1.0);
  CHECK(gain_of_following(first_step(1e-5)) == 1.0);
  // Nor is the side of it of any matter.
  const LookAhead turned = seen(4, 1600, [](int k) { return -peak(k); });
  CHECK(gain_of_following(turned) == gain_of_following(seen(4, 1600, peak)));
}

TEST_CASE("An orbit repeats itself if η turns again and again, and is not much larger later on") {
  const auto wave = [](double growth) {
    return seen(6, 64, [growth](int k) { return 1e-6 * std::exp(growth * k) * std::cos(two_pi * k / 16.0); });
  };
  CHECK(turns_of_eta(wave(0.0)) == 7);
  CHECK(repeats(wave(0.0)));
  CHECK(repeats(wave(0.01)));         // 1.4 times as large
  CHECK_FALSE(repeats(wave(0.015)));  // 1.6 times
  CHECK(repeats(wave(-0.06)));
  CHECK_FALSE(repeats(seen(6, 64, [](int k) { return 1e-6 * std::cos(two_pi * k / 48.0); })));  // turned twice
  // A ripple, and what K does not report on, are no turns.
  CHECK(turns_of_eta(seen(6, 64, [](int k) { return 1e-6 * (1.0 + 0.04 * std::cos(two_pi * k / 8.0)); })) == 0);
  CHECK(turns_of_eta(seen(6, 64, [](int k) { return 1e-14 * std::cos(two_pi * k / 8.0); })) == 0);
  CHECK(turns_of_eta(first_step(1e-5)) == 0);
}

TEST_CASE("Steps are chosen to be equal where that does as well, and to follow where it does not") {
  const LookAhead swing = seen(4, 400, [](int k) { return 1e-5 * std::cos(two_pi * k / 10.0); });
  const LookAhead passing = seen(4, 1600, peak);
  CHECK(equal_steps_do(swing));
  CHECK_FALSE(equal_steps_do(passing));
  CHECK(gain_of_following(passing) > 1.5);
  const StepPotential calm = choose_step_potential(swing, std::nullopt);
  CHECK(calm.exponent == 16.0);
  CHECK(calm.energy(h) == nearly_equal_steps(swing).value().energy(h));
  const LevelForecast followed = LevelForecaster(passing)(choose_step_potential(passing, std::nullopt));
  CHECK(followed.complete);
  CHECK(followed.longest > 2.0 * followed.shortest);
  // What K shows nothing of, it cannot be followed by.
  CHECK(equal_steps_do(seen(4, 400, [](int k) { return 1e-10 * peak(k); })));
  // And at order 2 steps follow what has one sign, whatever is gained.
  const LookAhead second = seen(2, 400, [](int k) { return 1e-5 * (1.0 + 0.5 * std::cos(two_pi * k / 100.0)); });
  const LevelForecast of_second = LevelForecaster(second)(choose_step_potential(second, std::nullopt));
  CHECK(of_second.longest > 1.1 * of_second.shortest);
}

TEST_CASE("Nearly equal steps tell what they cost beside the law's own") {
  // η is a millionth for nine tenths of the time, where the law's steps are 1e6^(1/5) = 16 times as long; it falls
  // there at once, faster than any steps could follow.
  const LookAhead look = seen(4, 400, [](int k) { return k < 40 ? 1e-5 : 1e-11; });
  const double cost = choose_costed_potential(look, std::nullopt).cost_in_steps;
  const LevelForecast forecast = LevelForecaster(look)(choose_step_potential(look, std::nullopt));
  CHECK(cost == Approx(forecast.steps / (1.0 + 40.0 + 360.0 / std::pow(1e6, 0.2))).epsilon(0.01));
}
