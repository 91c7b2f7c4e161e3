#include <rubato/variation/off_law_causes.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/variation/tuning.hpp>

namespace rubato {

using namespace tuning;

double GammaTrend::ratio() const {
  const double a = std::abs(before);
  const double b = std::abs(after);
  return std::max(a, b) / std::min(a, b);
}

bool GammaTrend::known() const {
  return std::isfinite(before) && std::isfinite(after);
}

bool GammaTrend::meets_zero() const {
  if (!known()) {
    return false;
  }
  if (before * after <= 0.0) {
    return !(ratio() > largest_crossing_ratio) || before == 0.0 || after == 0.0;
  }
  return (after + steps_ahead * (after - before)) * after <= 0.0;
}

void OffLawCauses::add(const StepReport& step) {
  if (!step.off_law) {
    return;
  }
  constexpr double flat_condition = 1e-2;
  ++steps_;
  starting_ += std::isnan(step.target) ? 1 : 0;
  if (!(step.condition <= flat_condition)) {
    ++flat_;
    return;
  }
  const GammaTrend trend{step.gamma_before, step.gamma_after};
  if (!trend.known()) {
    return;
  }
  if (trend.before * trend.after <= 0.0 && trend.meets_zero()) {
    ++crossings_;
  } else if (trend.ratio() > ratio_) {
    ratio_ = trend.ratio();
    before_ = trend.before;
    after_ = trend.after;
  }
}

void OffLawCauses::save(StateWriter& state) const {
  for (const std::size_t count : {steps_, starting_, flat_, crossings_}) {
    state.write(static_cast<double>(count));
  }
  for (const double value : {ratio_, before_, after_}) {
    state.write(value);
  }
}

void OffLawCauses::restore(StateReader& state) {
  for (std::size_t* count : {&steps_, &starting_, &flat_, &crossings_}) {
    state.read(*count);
  }
  for (double* value : {&ratio_, &before_, &after_}) {
    state.read(*value);
  }
}

}  // namespace rubato
