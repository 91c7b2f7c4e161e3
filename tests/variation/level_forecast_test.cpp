// Forecasts of levels in long strides: each is what it is step by step as nearly as steps are solved for.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <rubato/variation/level_forecast.hpp>
#include <rubato/variation/power_of.hpp>

using namespace rubato;

namespace {

const double pi = std::acos(-1.0);

/// A stretch with steps of their own lengths, in which η swings about `mean`.
LookAhead stretch(int order, double mean, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> part(0.5, 1.5);
  LookAhead look{.order = order, .step = 0.1, .energy_size = 1.0};
  for (int k = 0; k < 150; ++k) {
    const double length = 0.1 * part(random);
    look.time.push_back(look.duration + 0.5 * length);
    look.eta.push_back(1e-3 * (mean + std::sin(0.7 * look.time.back()) + 0.1 * part(random)));
    look.duration += length;
  }
  return look;
}

double eta_at(const LookAhead& look, const EtaDoubt& doubt, double time) {
  const auto& t = look.time;
  const auto& eta = look.eta;
  double seen = time <= t.front() ? eta.front() : eta.back();
  if (time > t.front() && time < t.back()) {
    const auto i = static_cast<std::size_t>(std::ranges::lower_bound(t, time) - t.begin()) - 1;
    const auto secant = [&](std::size_t k) { return (eta[k + 1] - eta[k]) / (t[k + 1] - t[k]); };
    const auto slope = [&](std::size_t k) {
      if (k == 0 || k + 1 == t.size()) {
        return secant(k == 0 ? 0 : k - 1);
      }
      const double before = t[k] - t[k - 1], after = t[k + 1] - t[k];
      return (secant(k - 1) * after + secant(k) * before) / (before + after);
    };
    const double length = t[i + 1] - t[i], part = (time - t[i]) / length, rise = eta[i + 1] - eta[i];
    const double bend = slope(i) * length - rise, twist = rise - slope(i + 1) * length;
    seen = eta[i] + part * (rise + (1.0 - part) * ((1.0 - part) * bend + part * twist));
  }
  return doubt.factor * (doubt.turn > 0.0 ? std::cos(2.0 * pi * time / doubt.turn) : 1.0) * seen;
}

struct Job {
  StepPotential potential;
  EtaDoubt doubt = {};
};

/// The same step by step.
LevelForecast plain_forecast(const LookAhead& look, const Job& job,
                             double limit = std::numeric_limits<double>::infinity()) {
  const StepPotential& potential = job.potential;
  const int s = look.order;
  double h = look.step, time = 0.0, here = eta_at(look, job.doubt, 0.0);
  double defect = (s + 1.0) * power_of(h, s) * here + potential.energy(h);
  const double first = defect, side = std::copysign(1.0, potential.strength);
  LevelForecast forecast{.complete = true, .shortest = h, .longest = h, .potential = std::abs(potential.energy(h))};
  while (time < look.duration) {
    const double last = h;
    bool solved = false;
    for (int iteration = 0; iteration < 20 && !solved; ++iteration) {
      const double power = power_of(h, s - 1);
      const double miss = (s + 1.0) * power * h * here + potential.energy(h) - defect;
      const double slope = s * (s + 1.0) * power * here + potential.strength * potential.exponent / potential.length *
                                                              power_of(h / potential.length, potential.exponent - 1.0);
      if (!(slope * side * h > look.resolved_slope())) {
        break;
      }
      const double next = std::clamp(h - miss / slope, 0.5 * h, 2.0 * h);
      solved = std::abs(next - h) < 1e-9 * h;
      h = next;
    }
    if (!solved || std::abs(std::log(h / last)) > 0.2 || forecast.steps > 20.0 * look.duration / look.step ||
        forecast.potential > limit) {
      forecast.complete = false;
      return forecast;
    }
    time += h;
    const double there = eta_at(look, job.doubt, time);
    defect += power_of(h, s) * (there - here);
    here = there;
    forecast.steps += 1.0;
    forecast.potential = std::max(forecast.potential, std::abs(potential.energy(h)));
    forecast.energy = std::max(forecast.energy, std::abs(defect - first));
    forecast.shortest = std::min(forecast.shortest, h);
    forecast.longest = std::max(forecast.longest, h);
  }
  forecast.steps -= (time - look.duration) / h;
  return forecast;
}

/// Of two forecasts: no number of one is off the other's by a larger part than this.
bool near(const LevelForecast& a, const LevelForecast& b, double part) {
  const auto is_near = [part](double x, double y) {
    return std::abs(x - y) <= part * std::max(std::abs(x), std::abs(y)) || x == y;
  };
  return a.complete == b.complete && is_near(a.steps, b.steps) && is_near(a.shortest, b.shortest) &&
         is_near(a.longest, b.longest) && is_near(a.energy, b.energy) && is_near(a.potential, b.potential);
}

/// From those that are hardly felt to those that hardly let steps change, of both signs, with doubts.
std::vector<Job> many_jobs(const LookAhead& look, bool broken) {
  std::vector<Job> jobs;
  const double s = look.order;
  for (const double exponent : {s + 1.0, 2.0 * s + 2.0, 4.0 * s}) {
    for (double kappa = 8.0; kappa > 0.2; kappa /= 1.7) {
      for (const double sign : {1.0, -1.0}) {
        const StepPotential potential{.strength = sign * 4e-3 * std::pow(look.step, s),
                                      .length = kappa * look.step,
                                      .exponent = exponent + (broken && kappa < 1.0 ? 0.3 : 0.0)};
        jobs.push_back({.potential = potential});
        jobs.push_back({.potential = potential, .doubt = {.factor = 1.5, .turn = 0.0}});
        jobs.push_back({.potential = potential, .doubt = {.factor = 1.5, .turn = look.duration / 6.0}});
      }
    }
  }
  return jobs;
}

}  // namespace

TEST_CASE("levels are forecast as step by step, and no further than the limit of the potential", "[variation]") {
  // A step is solved for when Newton's method moves it by 1e-5 of itself: what is left is the square of that, times up
  // to p/2 = 16 and what a slope that is nearly zero makes of it; and the last digits of steps add up to no more.
  constexpr double solved = 1e-7;
  int complete = 0, incomplete = 0, moved = 0;
  for (const int order : {2, 4, 8}) {
    for (const double mean : {2.0, 0.3}) {
      for (const bool broken : {false, true}) {
        const LookAhead look = stretch(order, mean, 7);
        const LevelForecaster forecast(look);
        const double limit = 3e-3 * std::pow(look.step, order);
        for (const Job& job : many_jobs(look, broken)) {
          INFO("order " << order << ", mean " << mean << ", f' = " << job.potential.strength << " (h/"
                        << job.potential.length << ")^" << job.potential.exponent << ", turn " << job.doubt.turn);
          const LevelForecast expected = plain_forecast(look, job);
          CHECK(near(forecast(job.potential, job.doubt), expected, solved));
          CHECK(near(forecast(job.potential, job.doubt, limit), plain_forecast(look, job, limit), solved));
          (expected.complete ? complete : incomplete) += 1;
          // The twin: a strength that is off by a millionth.
          Job other = job;
          other.potential.strength *= 1.0 + 1e-6;
          moved += near(plain_forecast(look, other), expected, solved) ? 0 : 1;
        }
      }
    }
  }
  CHECK(complete > 100);
  CHECK(incomplete > 100);
  CHECK(moved > 100);
}

TEST_CASE("Where a look-ahead took long strides a forecast does, too, and comes to what it is step by step",
          "[variation]") {
  int complete = 0, incomplete = 0;
  for (const int order : {2, 4}) {
    for (const double mean : {2.0, 0.3}) {
      // Strides of 64 first steps, in which η changes by 4 hundredths of its swing.
      LookAhead look{.order = order, .step = 0.1, .energy_size = 1.0};
      for (int k = 0; k < 300; ++k) {
        look.time.push_back(6.4 * (k + 0.5));
        look.eta.push_back(1e-3 * (mean + std::sin(0.006 * look.time.back())));
      }
      look.duration = 6.4 * 300;
      const LevelForecaster forecast(look);
      for (const Job& job : many_jobs(look, false)) {
        const LevelForecast found = forecast(job.potential, job.doubt);
        const LevelForecast expected = plain_forecast(look, job);
        INFO("order " << order << ", mean " << mean << ", f' = " << job.potential.strength << " (h/"
                      << job.potential.length << ")^" << job.potential.exponent << ", turn " << job.doubt.turn);
        // A level that is about to end does so within a stride, an eighth of one of the look-ahead's, or of a 128th of
        // a turn
        CHECK(found.complete == expected.complete);
        CHECK(found.steps == Approx(expected.steps).epsilon(0.02));
        if (expected.complete) {
          CHECK(near(found, expected, 0.02));
        }
        (expected.complete ? complete : incomplete) += 1;
      }
    }
  }
  CHECK(complete > 50);
  CHECK(incomplete > 50);
}
