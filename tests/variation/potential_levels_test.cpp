// What levels with a step potential do where a step cannot be solved, on a scheme of which η and the longest step that
// has a solution are given functions of time.

#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include <rubato/variation/time_levels.hpp>

using namespace rubato;

namespace {

constexpr double h = 0.01;

/// A scheme that is nowhere but in time, of which steps have an energy.
class SchemeOfTime : public LevelScheme {
public:
  [[nodiscard]] NodeEnergy node() override { return {}; }
  [[nodiscard]] int iterations() const override { return 1; }
  void accept() override { time += h_; }
  void save(StateWriter& state) const override { state.write(time); }
  void restore(StateReader& state) override { time = state.read(); }

  double time = 0.0;

protected:
  double h_ = 0.0;  ///< of the last trial
};

/// K_h = s(h²/24) Γ with η = -Γ/24 and s = 2, which falls from 1 to 1/20 until t = 20 h; from t = 60 h on no step
/// longer than `longest` is defined.
class ShortOfBreath final : public SchemeOfTime {
public:
  explicit ShortOfBreath(double longest) : longest_(longest) {}

  [[nodiscard]] Status advance(double step, double) override {
    h_ = step;
    return time >= 60.0 * h && std::abs(step) > longest_ ? Status::undefined : Status::success;
  }
  [[nodiscard]] double discrete_energy() const override { return 3.0 * h_ * h_ * eta(); }
  [[nodiscard]] formula::SumSize energy_size() override { return {.terms = 3.0 * h * h}; }
  [[nodiscard]] double discrete_energy_slope() const override { return 6.0 * h_ * eta(); }

private:
  [[nodiscard]] double eta() const { return time < 20.0 * h ? 1.0 - 0.95 * time / (20.0 * h) : 0.05; }

  double longest_;
};

LevelOptions options_with_potential() {
  LevelOptions options;
  options.on_singular = OnSingular::plain;
  options.potential = {.kind = StepPotentialChoice::Kind::given, .kappa = 6.0, .exponent = 4.0};
  return options;
}

}  // namespace

TEST_CASE(
    "Where the last length is too long for the step's own equation, plain steps are shorter, as far as the first") {
  ShortOfBreath scheme(1.5 * h);
  TimeLevels levels(scheme, options_with_potential(), 0.0, h);
  double longest = 0.0;
  int flagged = 0;
  for (int k = 0; k < 200; ++k) {
    const StepReport step = levels.step();
    REQUIRE(step.status == Status::success);
    if (step.off_law) {
      ++flagged;
      CHECK(step.h >= h);
      CHECK(step.h <= 1.5 * h);
    } else {
      longest = std::max(longest, step.h);
      CHECK(std::abs(step.energy - step.target) <= 1e-12 * 3.0 * h * h);
    }
  }
  CHECK(longest > 3.0 * h);  // so that the length of the last step that met the law is not one to go on with
  CHECK(flagged > 100);
}

TEST_CASE("Where the first step has no solution either, the run ends and says so") {
  ShortOfBreath scheme(0.9 * h);
  TimeLevels levels(scheme, options_with_potential(), 0.0, h);
  Status status = Status::success;
  for (int k = 0; k < 200 && status == Status::success; ++k) {
    status = levels.step().status;
  }
  CHECK(status == Status::undefined);
  CHECK(scheme.time >= 60.0 * h);
}

namespace {

/// η for each step, so that the law's steps grow by 1.3 from one to the next, four times, and are then 0.6 times the
/// last.
class Turning final : public LevelScheme {
public:
  [[nodiscard]] Status advance(double step, double) override {
    h_ = step;
    return Status::success;
  }
  [[nodiscard]] double discrete_energy() const override { return 3.0 * h_ * h_ * eta(); }
  [[nodiscard]] formula::SumSize energy_size() override { return {.terms = 3.0 * h * h}; }
  [[nodiscard]] double discrete_energy_slope() const override { return 6.0 * h_ * eta(); }
  [[nodiscard]] NodeEnergy node() override { return {}; }
  [[nodiscard]] int iterations() const override { return 1; }
  void accept() override { ++steps_; }
  void save(StateWriter& state) const override { state.write(static_cast<double>(steps_)); }
  void restore(StateReader& state) override { steps_ = static_cast<int>(state.read()); }

private:
  [[nodiscard]] double eta() const {
    const int growing = std::clamp(steps_ - 19, 0, 4);
    return std::pow(steps_ >= 24 ? 0.6 * std::pow(1.3, growing) : std::pow(1.3, growing), -2.0);
  }

  int steps_ = 0;
  double h_ = 0.0;
};

}  // namespace

TEST_CASE("Where steps that were growing turn unforeseen, a level is looked for beside the last one, too") {
  Turning scheme;
  TimeLevels levels(scheme, options_with_potential(), 0.0, h);
  double last = 0.0, least_ratio = 1.0;
  for (int k = 0; k < 40; ++k) {
    const StepReport step = levels.step();
    REQUIRE(step.status == Status::success);
    CHECK_FALSE(step.off_law);
    least_ratio = last > 0.0 ? std::min(least_ratio, step.h / last) : 1.0;
    last = step.h;
  }
  CHECK(least_ratio == Approx(0.6).epsilon(0.05));
}

namespace {

/// K_h = 3 h² η, η = 1 + 1e-6 sin(3t/h), of which dK/dh is known but for a factor.
class RoughSlope final : public SchemeOfTime {
public:
  explicit RoughSlope(double factor) : factor_(factor) {}

  [[nodiscard]] Status advance(double step, double) override {
    ++trials;
    h_ = step;
    return Status::success;
  }
  [[nodiscard]] double discrete_energy() const override { return 3.0 * h_ * h_ * eta(); }
  [[nodiscard]] formula::SumSize energy_size() override { return {.terms = 3.0 * h * h}; }
  [[nodiscard]] double discrete_energy_slope() const override { return factor_ * 6.0 * h_ * eta(); }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }

  int trials = 0;

private:
  [[nodiscard]] double eta() const { return 1.0 + 1e-6 * std::sin(3.0 * time / h); }

  double factor_;
};

struct Solved {
  int off_law = 0;
  double trials = 0.0;                                         ///< a step
  double condition = std::numeric_limits<double>::infinity();  ///< the least
};

Solved solved_with(double factor) {
  constexpr int steps = 50;
  RoughSlope scheme(factor);
  TimeLevels levels(scheme, options_with_potential(), 0.0, h);
  Solved result;
  for (int k = 0; k < steps; ++k) {
    const StepReport step = levels.step();
    REQUIRE(step.status == Status::success);
    result.off_law += step.off_law ? 1 : 0;
    result.condition = k > 0 ? std::min(result.condition, step.condition) : result.condition;
  }
  result.trials = static_cast<double>(scheme.trials) / steps;
  return result;
}

}  // namespace

TEST_CASE("Where the slope of a scheme is far off, trials show it: the law is met, and h as well known as it says") {
  const Solved right = solved_with(1.0), steep = solved_with(7.0), flat = solved_with(1.0 / 7.0);
  INFO(right.condition << " " << steep.condition << " " << flat.condition << " " << steep.trials << " " << flat.trials);
  CHECK(right.off_law == 0);
  CHECK(steep.off_law == 0);
  CHECK(flat.off_law == 0);
  // Newton's moves with the slope as stated would leave a miss of 1 - 1/7 of the last: twenty of them.
  CHECK(steep.trials < 3.0 * right.trials);
  // The same E_k of the same rounding errors.
  CHECK(steep.condition == Approx(right.condition).epsilon(0.25));
  CHECK(flat.condition == Approx(right.condition).epsilon(0.25));
}
