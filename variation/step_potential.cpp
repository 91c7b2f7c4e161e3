#include <rubato/variation/step_potential.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <span>
#include <vector>

#include <rubato/base/limits.hpp>
#include <rubato/variation/equal_steps.hpp>
#include <rubato/variation/level_forecast.hpp>
#include <rubato/variation/power_of.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning;

StepPotential with_kappa(const LookAhead& look, double eta, double kappa, double exponent) {
  const double least = std::max(least_strength, least_strength_by_tolerance * look.tolerance) * look.energy_size;
  return {.strength = std::copysign(std::max(look.off(eta, look.step), least), eta),
          .length = kappa * look.step,
          .exponent = exponent};
}

/// Whether what the second half of the stretch of a look-ahead showed is what the first half did.
bool shows_all(const LookAhead& look) {
  const std::span<const double> eta = look.eta;
  const auto half =
      static_cast<std::size_t>(std::ranges::lower_bound(look.time, 0.5 * look.duration) - look.time.begin());
  if (half == 0 || half == eta.size()) {
    return false;
  }
  const auto [low, high] = std::ranges::minmax(eta.first(half));
  const auto [later_low, later_high] = std::ranges::minmax(eta.subspan(half));
  const double margin = nothing_new * std::max(std::abs(low), std::abs(high));
  return later_low >= low - margin && later_high <= high + margin;
}

}  // namespace

double StepPotential::energy(double h) const {
  return strength == 0.0 ? 0.0 : strength * power_of(std::abs(h) / length, exponent);
}

/// Of |h|/length, raised to p; of p - 1 products, or of pow(), good to two units in the last place; and of the product.
double StepPotential::rounding_of(double energy) const {
  return 0.5 * epsilon * (exponent + std::max(exponent - 1.0, 2.0) + 1.0) * std::abs(energy);
}

StepPotential::Part StepPotential::at(double h) const {
  const double there = energy(h);
  return {.energy = there, .slope = there == 0.0 ? 0.0 : exponent * there / h};
}

void StepPotential::save(StateWriter& state) const {
  for (const double value : {strength, length, exponent}) {
    state.write(value);
  }
}

void StepPotential::restore(StateReader& state) {
  state.read(strength);
  state.read(length);
  state.read(exponent);
}

StepPotentialChoice with_usual(const StepPotentialChoice& choice, bool usual_is_automatic) {
  using Kind = StepPotentialChoice::Kind;
  return choice.kind != Kind::usual ? choice
                                    : StepPotentialChoice{.kind = usual_is_automatic ? Kind::automatic : Kind::none};
}

double LookAhead::resolved_slope() const {
  return std::max(least_slope, least_slope_by_tolerance * tolerance) * energy_size;
}

double LookAhead::off(double value, double length) const {
  return (order + 1.0) * std::abs(value) * power_of(length, order);
}

double LookAhead::time_of(std::size_t i) const {
  const double before = i == 0 ? 0.0 : 0.5 * (time[i - 1] + time[i]);
  return (i + 1 < eta.size() ? 0.5 * (time[i] + time[i + 1]) : duration) - before;
}

double LookAhead::least_resolved() const {
  return resolved_slope() / (order * (order + 1.0) * power_of(step, order));
}

bool LookAhead::depends_on_step() const {
  return off(largest_eta(), step) > std::max(unfelt_by_levels * tolerance * energy_size, 2.0 * rounding);
}

bool LookAhead::knows_step() const {
  return largest_eta() >= least_resolved();
}

double LookAhead::largest_eta() const {
  double largest = 0.0;
  for (const double value : eta) {
    largest = std::max(largest, std::abs(value));
  }
  return largest;
}

double rounded_strength(double strength) {
  constexpr int bits = 6;
  int exponent = 0;
  const double mantissa = std::frexp(strength, &exponent);
  return std::ldexp(std::nearbyint(std::ldexp(mantissa, bits)), exponent - bits);
}

namespace {

/// Of so many steps over the stretch.
double cost_of(const LookAhead& look, double steps) {
  const auto steps_in_time = [&](std::size_t i) {
    return std::pow(std::abs(look.eta[i] / look.eta.front()), 1.0 / (look.order + 1.0)) / look.step;
  };
  double of_law = 1.0;
  for (std::size_t i = 0; i < look.eta.size(); ++i) {
    of_law += steps_in_time(i) * look.time_of(i);
    of_law += i > 0 && look.eta[i] * look.eta[i - 1] < 0.0 ? 1.0 : 0.0;
  }
  return steps / of_law;
}

CostedPotential with_cost_of_equal_steps(const LookAhead& look, const StepPotential& potential) {
  return {potential, look.knows_step() ? cost_of(look, look.duration / look.step) : 1.0};
}

}  // namespace

double cost_in_steps(const LookAhead& look, const StepPotential& potential) {
  if (!look.knows_step()) {
    return 1.0;  // any steps would do
  }
  const LevelForecast forecast = LevelForecaster(look)(potential);
  return cost_of(look, forecast.complete ? forecast.steps : look.duration / look.step);
}

StepPotential make_step_potential(const LookAhead& look, double kappa, double exponent) {
  return with_kappa(look, look.eta.front(), kappa, exponent);
}

namespace {

/// A potential with which all levels of the stretch of a look-ahead are forecast to exist.
struct Candidate {
  StepPotential potential;
  double steps = 0.0;
  double work = 0.0;
  double part = 0.0;  ///< max |f'|
};

/// The choice of a step potential: what choose_step_potential() says, one rule after the other.
class Choice {
public:
  Choice(const LookAhead& look, std::optional<double> largest_step)
      : look_(look), forecast_(look), s_(look.order), largest_(look.largest_eta()) {
    strayed_ = std::abs(made(largest_, 1.0, s_).strength);
    if (look.first_size > 0.0) {
      most_ = most_of_terms * look.first_size;
    }
    if (largest_step) {
      kappa_limit_ = std::clamp(*largest_step / look.step, least_kappa, largest_kappa);
    }
  }

  CostedPotential operator()() {
    const double side = std::copysign(1.0, look_.eta.front());
    if (!look_.knows_step()) {
      return with_cost(within_most(made(0.0, 1.0, s_ + 1.0)));  // K hardly knows h: steps are as long as the first
    }
    const std::optional<StepPotential> equal =
        s_ >= order_with_zeros ? nearly_equal_steps(look_) : std::optional<StepPotential>();
    const bool definite = std::ranges::all_of(look_.eta, [&](double eta) { return eta * side >= 0.0; });
    const double usual = std::min(largest_part * strayed_, most_);
    for (const double limit : {usual, most_}) {
      // An η that was seen with one sign only may grow beyond what was seen: a potential of the other sign would not
      // last.
      try_all(side, limit);
      if (!definite || candidates_.empty()) {
        try_all(-side, limit);
      }
      if (!candidates_.empty()) {
        const Candidate chosen = limit == usual ? best() : weakest();
        if (equal && work(forecast_(*equal)) <= (1.0 + as_good) * chosen.work) {
          return with_cost_of_equal_steps(look_, *equal);
        }
        return {chosen.potential, cost_of(look_, chosen.steps)};
      }
    }
    if (equal) {
      return with_cost_of_equal_steps(look_, *equal);
    }
    // Nothing is forecast to last: steps that are nearly equal.
    return with_cost(within_most(made(std::copysign(largest_, side), last_resort, s_ + 1.0)));
  }

private:
  [[nodiscard]] CostedPotential with_cost(const StepPotential& potential) const {
    return {potential, cost_in_steps(look_, potential)};
  }
  [[nodiscard]] StepPotential made(double eta, double kappa, double exponent) const {
    StepPotential potential = with_kappa(look_, eta, kappa, exponent);
    potential.strength = rounded_strength(potential.strength);
    return potential;
  }

  [[nodiscard]] StepPotential within_most(StepPotential potential) const {
    potential.strength /= std::max(1.0, std::abs(potential.energy(look_.step)) / most_);
    return potential;
  }

  /// Tries potentials of one sign whose part of the energy is at most `limit`: each is forecast, and then, if its
  /// levels exist, for a larger η.
  void try_all(double sign, double limit) {
    for (const double exponent : {s_ + 2.0, 4.0 * s_}) {
      for (double kappa = kappa_limit_; kappa >= least_kappa; kappa /= kappa_ratio) {
        const StepPotential potential = made(std::copysign(largest_, sign), kappa, exponent);
        if (std::abs(potential.energy(look_.step)) > limit) {
          break;  // and those that are shorter all the more
        }
        const LevelForecast forecast = forecast_(potential, {}, limit);
        if (forecast.complete && forecast_(potential, {.factor = eta_margin}).complete) {
          candidates_.push_back(
              {.potential = potential, .steps = forecast.steps, .work = work(forecast), .part = forecast.potential});
        }
      }
    }
  }

  /// What the steps take for an error, which falls with their power s.
  [[nodiscard]] double work(const LevelForecast& forecast) const {
    return forecast.steps * std::pow(std::max(forecast.energy, negligible * strayed_), 1.0 / s_);
  }
  [[nodiscard]] Candidate weakest() const { return *std::ranges::min_element(candidates_, {}, &Candidate::part); }
  [[nodiscard]] Candidate best() {
    keep_best(cost_of_the_law);
    // At high orders η changes its sign on almost every orbit: a stretch where it does not shows little of the rest.
    if (s_ >= order_with_zeros || !shows_all(look_)) {
      const EtaDoubt unseen{.factor = eta_margin, .turn = look_.duration / unseen_turns};
      keep([&](const Candidate& one) { return forecast_(one.potential, unseen).complete; });
    }
    // Of those that are hardly felt the one that begins soonest beyond what was seen.
    if (keep([&](const Candidate& one) { return one.part <= unfelt * strayed_; })) {
      return *std::ranges::min_element(candidates_, {}, [](const Candidate& one) { return one.potential.length; });
    }
    keep_best(as_good);
    return weakest();
  }
  /// Those whose work is at most this part more than the least.
  void keep_best(double part) {
    const double least_work = std::ranges::min_element(candidates_, {}, &Candidate::work)->work;
    keep([&](const Candidate& one) { return one.work <= (1.0 + part) * least_work; });
  }
  /// Leaves those that meet the condition, unless none does.
  template <class Condition>
  bool keep(const Condition& condition) {
    std::vector<Candidate> kept;
    std::ranges::copy_if(candidates_, std::back_inserter(kept), condition);
    if (kept.empty()) {
      return false;
    }
    candidates_ = std::move(kept);
    return true;
  }

  const LookAhead& look_;
  LevelForecaster forecast_;
  double s_;
  double largest_;
  double strayed_ = 0.0;                                   ///< about what the node energy is off with equal steps
  double most_ = std::numeric_limits<double>::infinity();  ///< beside a larger f' the terms of K are lost
  double kappa_limit_ = largest_kappa;
  std::vector<Candidate> candidates_;
};

}  // namespace

CostedPotential choose_costed_potential(const LookAhead& look, std::optional<double> largest_step) {
  if (look.order >= order_with_zeros && equal_steps_do(look)) {
    return with_cost_of_equal_steps(look, nearly_equal_steps(look).value());
  }
  return Choice(look, largest_step)();
}

StepPotential choose_step_potential(const LookAhead& look, std::optional<double> largest_step) {
  return choose_costed_potential(look, largest_step).potential;
}

}  // namespace rubato
