// Forecasts of levels side by side: each is, bit by bit, what it is taken by itself, and what it is step by step as
// nearly as steps are solved for.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <rubato/variation/level_forecasts.hpp>
#include <rubato/variation/power_of.hpp>

using namespace rubato;

namespace {

const double pi = std::acos(-1.0);

/// A stretch with steps of their own lengths, in which η swings about `mean`.
Scouting stretch(int order, double mean, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> part(0.5, 1.5);
  Scouting scouting{.order = order, .step = 0.1, .energy_size = 1.0};
  for (int k = 0; k < 150; ++k) {
    const double length = 0.1 * part(random);
    scouting.time.push_back(scouting.duration + 0.5 * length);
    scouting.eta.push_back(1e-3 * (mean + std::sin(0.7 * scouting.time.back()) + 0.1 * part(random)));
    scouting.duration += length;
  }
  return scouting;
}

double eta_at(const Scouting& scouting, const EtaDoubt& doubt, double time) {
  const auto& t = scouting.time;
  const auto& eta = scouting.eta;
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

/// What is meant, one number after the other. \param asked after so many steps whether to give up; 0 for never
LevelForecast plain_forecast(const Scouting& scouting, const ForecastJob& job, double limit, std::size_t asked,
                             double most_steps) {
  const StepPotential& potential = job.potential;
  const int s = scouting.order;
  double h = scouting.step, time = 0.0, here = eta_at(scouting, job.doubt, 0.0);
  double defect = (s + 1.0) * power_of(h, s) * here + potential.energy(h);
  const double first = defect, side = std::copysign(1.0, potential.strength);
  LevelForecast forecast{.complete = true, .shortest = h, .longest = h, .potential = std::abs(potential.energy(h))};
  while (time < scouting.duration) {
    const double last = h;
    bool solved = false;
    for (int iteration = 0; iteration < 20 && !solved; ++iteration) {
      const double power = power_of(h, s - 1);
      const double miss = (s + 1.0) * power * h * here + potential.energy(h) - defect;
      const double slope = s * (s + 1.0) * power * here + potential.strength * potential.exponent / potential.length *
                                                              power_of(h / potential.length, potential.exponent - 1.0);
      if (!(slope * side * h > scouting.resolved_slope())) {
        break;
      }
      const double next = std::clamp(h - miss / slope, 0.5 * h, 2.0 * h);
      solved = std::abs(next - h) < 1e-9 * h;
      h = next;
    }
    const bool given_up =
        forecast.potential > limit ||
        (asked > 0 && static_cast<std::size_t>(forecast.steps) % asked == asked - 1 && forecast.steps > most_steps);
    if (!solved || std::abs(std::log(h / last)) > 0.2 || forecast.steps > 20.0 * scouting.duration / scouting.step ||
        given_up) {
      forecast.complete = false;
      return forecast;
    }
    time += h;
    const double there = eta_at(scouting, job.doubt, time);
    defect += power_of(h, s) * (there - here);
    here = there;
    forecast.steps += 1.0;
    forecast.potential = std::max(forecast.potential, std::abs(potential.energy(h)));
    forecast.energy = std::max(forecast.energy, std::abs(defect - first));
    forecast.shortest = std::min(forecast.shortest, h);
    forecast.longest = std::max(forecast.longest, h);
  }
  forecast.steps -= (time - scouting.duration) / h;
  return forecast;
}

bool same(const LevelForecast& a, const LevelForecast& b) {
  return a.complete == b.complete && a.steps == b.steps && a.shortest == b.shortest && a.longest == b.longest &&
         a.energy == b.energy && a.potential == b.potential;
}

/// Of two forecasts: no number of one is off the other's by a larger part than this.
bool near(const LevelForecast& a, const LevelForecast& b, double part) {
  const auto is_near = [part](double x, double y) {
    return std::abs(x - y) <= part * std::max(std::abs(x), std::abs(y)) || x == y;
  };
  return a.complete == b.complete && is_near(a.steps, b.steps) && is_near(a.shortest, b.shortest) &&
         is_near(a.longest, b.longest) && is_near(a.energy, b.energy) && is_near(a.potential, b.potential);
}

/// Every other job comes when another one has finished; they are given up after `most` steps.
class Queue final : public ForecastQueue {
public:
  Queue(std::span<const ForecastJob> jobs, double most) : results(jobs.size()), jobs_(jobs), most_(most) {}

  std::optional<Next> next() override {
    if (begun_ >= jobs_.size() || begun_ > 2 * ended_ + 20) {
      return std::nullopt;
    }
    const std::size_t number = begun_++;
    return Next{number, jobs_[number]};
  }
  void finished(std::size_t number, const LevelForecast& forecast) override {
    results[number] = forecast;
    ++ended_;
  }
  bool too_much(std::size_t /*number*/, const LevelForecast& so_far) override { return so_far.steps > most_; }
  [[nodiscard]] std::size_t period() const override { return 16; }

  std::vector<LevelForecast> results;

private:
  std::span<const ForecastJob> jobs_;
  double most_;
  std::size_t begun_ = 0, ended_ = 0;
};

/// From those that are hardly felt to those that hardly let steps change, of both signs, with doubts.
std::vector<ForecastJob> many_jobs(const Scouting& scouting, bool broken) {
  std::vector<ForecastJob> jobs;
  const double s = scouting.order;
  for (const double exponent : {s + 1.0, 2.0 * s + 2.0, 4.0 * s}) {
    for (double kappa = 8.0; kappa > 0.2; kappa /= 1.7) {
      for (const double sign : {1.0, -1.0}) {
        const StepPotential potential{.strength = sign * 4e-3 * std::pow(scouting.step, s),
                                      .length = kappa * scouting.step,
                                      .exponent = exponent + (broken && kappa < 1.0 ? 0.3 : 0.0)};
        jobs.push_back({.potential = potential});
        jobs.push_back({.potential = potential, .doubt = {.factor = 1.5, .turn = 0.0}});
        jobs.push_back({.potential = potential, .doubt = {.factor = 1.5, .turn = scouting.duration / 6.0}});
      }
    }
  }
  return jobs;
}

}  // namespace

TEST_CASE("levels forecast side by side are those forecast alone, bit by bit", "[variation]") {
  // A step is solved for when Newton's method moves it by 1e-5 of itself: what is left is the square of that, times up
  // to p/2 = 16 and what a slope that is nearly zero makes of it; and the last digits of steps add up to no more.
  constexpr double solved = 1e-7;
  int complete = 0, incomplete = 0, changed = 0, moved = 0;
  for (const int order : {2, 4, 8}) {
    for (const double mean : {2.0, 0.3}) {
      for (const bool broken : {false, true}) {
        const Scouting scouting = stretch(order, mean, 7);
        const EtaPieces pieces(scouting);
        const std::vector<ForecastJob> jobs = many_jobs(scouting, broken);
        const std::vector<LevelForecast> found = forecast_side_by_side(scouting, pieces, jobs);
        const double limit = 3e-3 * std::pow(scouting.step, order), most = 40.0;
        std::vector<ForecastJob> limited = jobs;
        for (ForecastJob& job : limited) {
          job.limit = limit;
        }
        Queue queue(limited, most);
        forecast_side_by_side(scouting, pieces, queue);
        const std::vector<LevelForecast>& fewer = queue.results;
        constexpr double unlimited = std::numeric_limits<double>::infinity();
        for (std::size_t i = 0; i < jobs.size(); ++i) {
          INFO("order " << order << ", mean " << mean << ", job " << i);
          const LevelForecast expected = plain_forecast(scouting, jobs[i], unlimited, 0, 0.0);
          CHECK(near(found[i], expected, solved));
          CHECK(near(fewer[i], plain_forecast(scouting, jobs[i], limit, 16, most), solved));
          CHECK(same(forecast_levels(scouting, jobs[i].potential, jobs[i].doubt), found[i]));
          (expected.complete ? complete : incomplete) += 1;
          // The twins: of a strength that is another in its last digit, or by a millionth.
          ForecastJob other = jobs[i];
          other.potential.strength = std::nextafter(other.potential.strength, 1.0);
          changed += same(forecast_levels(scouting, other.potential, other.doubt), found[i]) ? 0 : 1;
          other.potential.strength *= 1.0 + 1e-6;
          moved += near(plain_forecast(scouting, other, unlimited, 0, 0.0), expected, solved) ? 0 : 1;
        }
      }
    }
  }
  CHECK(complete > 100);
  CHECK(incomplete > 100);
  CHECK(changed > 100);
  CHECK(moved > 100);
  const Scouting scouting = stretch(2, 2.0, 7);
  CHECK(forecast_side_by_side(scouting, EtaPieces(scouting), std::span<const ForecastJob>()).empty());
}

TEST_CASE("Where a scout took long strides a forecast does, too, and comes to what it is step by step", "[variation]") {
  int complete = 0, incomplete = 0;
  for (const int order : {2, 4}) {
    for (const double mean : {2.0, 0.3}) {
      // Strides of 64 first steps, in which η changes by 4 hundredths of its swing.
      Scouting scouting{.order = order, .step = 0.1, .energy_size = 1.0};
      for (int k = 0; k < 300; ++k) {
        scouting.time.push_back(6.4 * (k + 0.5));
        scouting.eta.push_back(1e-3 * (mean + std::sin(0.006 * scouting.time.back())));
      }
      scouting.duration = 6.4 * 300;
      for (const ForecastJob& job : many_jobs(scouting, false)) {
        const LevelForecast found = forecast_levels(scouting, job.potential, job.doubt);
        const LevelForecast expected = plain_forecast(scouting, job, std::numeric_limits<double>::infinity(), 0, 0.0);
        INFO("order " << order << ", mean " << mean << ", f' = " << job.potential.strength << " (h/"
                      << job.potential.length << ")^" << job.potential.exponent << ", turn " << job.doubt.turn);
        // A level that is about to end does so within a stride, an eighth of one of the scout's, or of a 128th of a
        // turn
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
