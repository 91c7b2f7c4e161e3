#include <rubato/variation/step_forecast.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <rubato/base/lagrange_weight.hpp>
#include <rubato/variation/power_of.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

using namespace tuning;

/// Of Lagrange, through all samples.
double StepForecast::polynomial(double Sample::*at, double Sample::*value, double time) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < known_; ++i) {
    sum += lagrange_weight(i, known_, time, [&](std::size_t j) { return samples_[j].*at; }) * samples_[i].*value;
  }
  return sum;
}

double StepForecast::by_length(double time, double last) const {
  const double size = std::abs(last);
  double length = size;
  for (int iteration = 0; iteration < 2; ++iteration) {
    const double middle = time + std::copysign(0.5 * length, last);
    length = std::clamp(polynomial(&Sample::middle, &Sample::length, middle), size / largest_foresight,
                        size * largest_foresight);
  }
  return length;
}

/// Newton's iteration from `guess`; infinite where it ends nowhere near.
double StepForecast::by_law(double time, double guess, double remaining, const StepPotential& potential,
                            int order) const {
  const double c = polynomial(&Sample::start, &Sample::coefficient, time);
  double length = guess;
  for (int iteration = 0; iteration < most_forecast_iterations; ++iteration) {
    const double power = power_of(length, order - 1);
    const double slope = order * power * c + potential.slope(length);
    const double change = (remaining - power * length * c - potential.energy(length)) / slope;
    if (!(slope * potential.strength > 0.0) || !(std::abs(change) < (largest_foresight - 1.0) * guess)) {
      break;
    }
    length += change;
    if (std::abs(change) < forecast_accuracy * guess) {
      return length < guess * largest_foresight && length > guess / largest_foresight
                 ? length
                 : std::numeric_limits<double>::infinity();
    }
  }
  return std::numeric_limits<double>::infinity();
}

double StepForecast::length(double time, double last, double remaining, const StepPotential& potential, int order) {
  by_length_ = by_length(time, last);
  by_law_ = by_law(time, by_length_, remaining, potential, order);
  return std::isfinite(by_law_) && law_error_ <= length_error_ ? by_law_ : by_length_;
}

void StepForecast::add(double time, double h, double remaining, const StepPotential& potential, int order) {
  const double length = std::abs(h);
  if (known_ > 0) {
    length_error_ = std::abs(by_length_ - length);
    law_error_ = std::abs(by_law_ - length);
  }
  std::move_backward(samples_.begin(), samples_.end() - 1, samples_.end());
  samples_[0] = {.start = time,
                 .middle = time + 0.5 * h,
                 .length = length,
                 .coefficient = (remaining - potential.energy(h)) / power_of(length, order)};
  known_ = std::min(known_ + 1, samples_.size());
}

void StepForecast::save(StateWriter& state) const {
  for (const double value : {static_cast<double>(known_), by_length_, by_law_, length_error_, law_error_}) {
    state.write(value);
  }
  for (const Sample& sample : samples_) {
    for (const double value : {sample.start, sample.middle, sample.length, sample.coefficient}) {
      state.write(value);
    }
  }
}

void StepForecast::restore(StateReader& state) {
  state.read(known_);
  for (double* value : {&by_length_, &by_law_, &length_error_, &law_error_}) {
    state.read(*value);
  }
  for (Sample& sample : samples_) {
    for (double* value : {&sample.start, &sample.middle, &sample.length, &sample.coefficient}) {
      state.read(*value);
    }
  }
}

}  // namespace rubato
