#include <rubato/variation/step_forecast.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/base/limits.hpp>
#include <rubato/variation/power_of.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

using namespace tuning;

/// Newton's iteration from `guess`, to a small part of what c leaves uncertain; infinite where it ends nowhere near.
double StepForecast::by_law(double c, double guess, double remaining, const StepPotential& potential, int order) const {
  double length = guess;
  // After a change the next is about p/2 of its square.
  const double uncertain = law_scale_ * coefficients_.error() / (0.5 * potential.exponent * guess);
  const double last_change = std::max(forecast_accuracy, std::min(small_uncertainty * uncertain, coarse_forecast));
  for (int iteration = 0; iteration < most_forecast_iterations; ++iteration) {
    const double power = power_of(length, order - 1);
    const double energy = potential.energy(length);
    const double slope = order * power * c + potential.exponent * energy / length;
    const double change = (remaining - power * length * c - energy) / slope;
    if (!(slope * potential.strength > 0.0) || !(std::abs(change) < (largest_foresight - 1.0) * guess)) {
      break;
    }
    length += change;
    if (change * change < last_change * guess * guess) {
      return length < guess * largest_foresight && length > guess / largest_foresight ? length : infinity;
    }
  }
  return infinity;
}

double StepForecast::length(double last, double remaining, const StepPotential& potential, int order) {
  const double size = std::abs(last);
  const double by_length = std::clamp(lengths_.at(last_), size / largest_foresight, size * largest_foresight);
  const double c = coefficients_.at(last_);
  if (!(law_scale_ * coefficients_.error() <= lengths_.error())) {
    return by_length;
  }
  const double length = by_law(c, by_length, remaining, potential, order);
  return std::isfinite(length) ? length : by_length;
}

void StepForecast::add(double h, double remaining, double slope, double potential, int order) {
  const double length = std::abs(h);
  const double power = power_of(length, order);
  lengths_.add(last_, length);
  coefficients_.add(last_, (remaining - potential) / power);
  law_scale_ = power / std::abs(slope);
  last_ = length;
}

void StepForecast::save(StateWriter& state) const {
  lengths_.save(state);
  coefficients_.save(state);
  state.write(last_);
  state.write(law_scale_);
}

void StepForecast::restore(StateReader& state) {
  lengths_.restore(state);
  coefficients_.restore(state);
  state.read(last_);
  state.read(law_scale_);
}

}  // namespace rubato
