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
  [[nodiscard]] NodeEnergy trial_node() override { return {}; }
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
  options.on_singular = OnSingular::fixed;
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
    if (step.bridged) {
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
  [[nodiscard]] NodeEnergy trial_node() override { return {}; }
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
    CHECK_FALSE(step.bridged);
    least_ratio = last > 0.0 ? std::min(least_ratio, step.h / last) : 1.0;
    last = step.h;
  }
  CHECK(least_ratio == Approx(0.6).epsilon(0.05));
}

namespace {

/// Steps that follow η = 1 + 0.3 sin(2πt/8h), which eight steps a period foresee badly, and whose E_k is not quadratic
/// in h either. Energies side by side are as one likes them.
class Turns final : public SchemeOfTime {
public:
  enum class Abreast { none, right, wrong, without_root, undefined };
  explicit Turns(Abreast kind) : kind_(kind) {}

  [[nodiscard]] bool solves_fully() const override { return true; }
  [[nodiscard]] Status advance(double step, double) override {
    h_ = step;
    ++trials;
    return Status::success;
  }
  [[nodiscard]] double discrete_energy() const override { return energy(h_); }
  /// Ten roundings of half a last place of E_k, which is up to 2; as many again of a polynomial through such values.
  [[nodiscard]] formula::SumSize energy_size() override { return {.terms = 1.0, .rounding = 4e-15}; }
  [[nodiscard]] double discrete_energy_slope() const override { return 2.0 * h_ / (h * h) * eta(); }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] double prepare_abreast() override {
    return kind_ == Abreast::none ? std::numeric_limits<double>::infinity() : 1.0;
  }
  void energies_abreast(std::span<const double, abreast> lengths, std::span<double, abreast> energies) override {
    ++batches;
    for (std::size_t i = 0; i < abreast; ++i) {
      const double right = energy(lengths[i]);
      energies[i] = kind_ == Abreast::right          ? right
                    : kind_ == Abreast::wrong        ? right * (1.0 + 1e-4)
                    : kind_ == Abreast::without_root ? right + 1.0
                                                     : std::numeric_limits<double>::quiet_NaN();
    }
  }

  int trials = 0, batches = 0;

private:
  [[nodiscard]] double eta() const { return 1.0 + 0.3 * std::sin(2.0 * 3.14159265358979 * time / (8.0 * h)); }
  [[nodiscard]] double energy(double step) const {
    const double x = step / h;
    return x * x * eta() * (1.0 + 0.1 * std::sin(x));
  }

  Abreast kind_;
};

/// The levels of 200 steps, and what the last 150 took.
struct Taken {
  std::vector<double> levels;
  int trials = 0, batches = 0;
};
Taken steps_of(Turns::Abreast abreast) {
  Turns scheme(abreast);
  TimeLevels levels(scheme, options_with_potential(), 0.0, h);
  Taken taken;
  for (int k = 0; k < 200; ++k) {
    if (k == 50) {
      scheme.trials = scheme.batches = 0;
    }
    const StepReport step = levels.step();
    REQUIRE(step.status == Status::success);
    REQUIRE_FALSE(step.bridged);
    taken.levels.push_back(levels.time());
  }
  taken.trials = scheme.trials;
  taken.batches = scheme.batches;
  return taken;
}

double farthest(const Taken& a, const Taken& b) {
  double difference = 0.0;
  for (std::size_t k = 0; k < a.levels.size(); ++k) {
    difference = std::max(difference, std::abs(a.levels[k] - b.levels[k]));
  }
  return difference;
}

}  // namespace

TEST_CASE("Lengths side by side lead to the levels that one after the other do, with one step each") {
  const Taken alone = steps_of(Turns::Abreast::none), abreast = steps_of(Turns::Abreast::right);
  CHECK(alone.trials > 450);
  CHECK(alone.batches == 0);
  CHECK(abreast.batches >= 150);
  CHECK(abreast.batches < 200);
  CHECK(abreast.trials < 165);
  // Each step meets E to 1e-14 at most, and is off by half as much of its length; what that makes of η is an error of
  // the phase, so that the errors of all steps do no more than add up.
  CHECK(farthest(alone, abreast) < 200.0 * 2e-14 * h);
}

TEST_CASE("Where energies side by side lead astray, or nowhere, one after the other lead to the levels all the same") {
  const Taken alone = steps_of(Turns::Abreast::none);
  for (const Turns::Abreast abreast :
       {Turns::Abreast::wrong, Turns::Abreast::without_root, Turns::Abreast::undefined}) {
    const Taken astray = steps_of(abreast);
    CHECK(astray.batches >= 150);
    CHECK(astray.trials > 290);
    CHECK(farthest(alone, astray) < 200.0 * 2e-14 * h);
  }
}

TEST_CASE("Levels by lengths side by side go on from what was saved with the same digits") {
  Turns scheme(Turns::Abreast::right), other(Turns::Abreast::right);
  TimeLevels levels(scheme, options_with_potential(), 0.0, h), resumed(other, options_with_potential(), 0.0, h);
  for (int k = 0; k < 61; ++k) {
    REQUIRE(levels.step().status == Status::success);
  }
  StateWriter saved, state;
  levels.save(saved);
  scheme.save(state);
  StateReader reader(saved), state_reader(state);
  resumed.restore(reader);
  other.restore(state_reader);
  CHECK(reader.done());
  for (int k = 0; k < 100; ++k) {
    REQUIRE(levels.step().h == resumed.step().h);
  }
  // The twin: from another past the lengths foreseen are others, and with them the last digits.
  TimeLevels fresh(other, options_with_potential(), 0.0, h);
  CHECK(fresh.step().h != levels.step().h);
}
