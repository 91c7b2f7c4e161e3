#include <rubato/variation/step_potential.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <rubato/base/limits.hpp>

namespace rubato {

namespace {

/// |ln(h_{k+1}/h_k)| up to which the levels' leading order is believed.
constexpr double believed_change = 0.2;
/// The levels have to exist for an η that much larger, too: the orbit will meet what the scout did not.
constexpr double eta_margin = 1.5;
/// h dE/dh has to be this part of the terms of K: rounding in these then moves h by 1e-6 of itself at most.
constexpr double least_slope = 1e-10;
/// κ tried: from steps as long as the orbit lets them be to steps that are nearly equal.
constexpr double largest_kappa = 60.0, least_kappa = 1.0 / 16.0, kappa_ratio = 1.2;
/// How large f' may become, beside what the node energy is off with equal steps.
constexpr double largest_part = 4.0;
/// And beside the size of the terms of K, which is |K| or some hundredths of the sum of their magnitudes.
constexpr double most_of_terms = 30.0;
/// Where the node energy hardly changes, this part of what it is off with equal steps counts for its change.
constexpr double negligible = 0.01;
/// Where η vanishes, K is the same for every h, and the potential alone tells one step from another: f' is at least
/// this part of the terms of K then, well above what rounding makes of them.
constexpr double least_strength = 1e-6;

/// η at a time: cubic between the middles of its steps.
class EtaAlong {
public:
  EtaAlong(const Scouting& scouting, double factor) : eta_(scouting.eta), step_(scouting.step), factor_(factor) {}

  [[nodiscard]] double operator()(double time) const {
    const double at = time / step_ - 0.5;
    if (at <= 0.0) {
      return factor_ * eta_.front();
    }
    const auto i = static_cast<std::size_t>(at);
    if (i + 1 >= eta_.size()) {
      return factor_ * eta_.back();
    }
    // The cubic through both, with the slopes that their neighbours tell.
    const double part = at - static_cast<double>(i);
    const double left = eta_[i], right = eta_[i + 1];
    const double before = i > 0 ? eta_[i - 1] : left, after = i + 2 < eta_.size() ? eta_[i + 2] : right;
    const double rise = right - left, slope_left = 0.5 * (right - before), slope_right = 0.5 * (after - left);
    const double bend = slope_left - rise, twist = rise - slope_right;
    return factor_ * (left + part * (rise + (1.0 - part) * ((1.0 - part) * bend + part * twist)));
  }
  [[nodiscard]] double duration() const { return step_ * static_cast<double>(eta_.size()); }

private:
  std::span<const double> eta_;
  double step_, factor_;
};

double largest_of(std::span<const double> eta) {
  double largest = 0.0;
  for (const double value : eta) {
    largest = std::max(largest, std::abs(value));
  }
  return largest;
}

StepPotential with_kappa(const Scouting& scouting, double eta, double kappa, double exponent) {
  const double s = scouting.order;
  const double size = (s + 1.0) * std::abs(eta) * std::pow(scouting.step, s);
  const double least = least_strength * (scouting.energy_size > 0.0 ? scouting.energy_size : 1.0);
  return {.strength = std::copysign(std::max(size, least), eta), .length = kappa * scouting.step, .exponent = exponent};
}

}  // namespace

double StepPotential::energy(double h) const {
  return strength == 0.0 ? 0.0 : strength * std::pow(std::abs(h) / length, exponent);
}

/// Of |h|/length, raised to p; of pow() itself, good to two units in the last place; and of the product.
double StepPotential::rounding(double h) const {
  return 0.5 * epsilon * (exponent + 3.0) * std::abs(energy(h));
}

double StepPotential::slope(double h) const {
  return strength == 0.0 ? 0.0
                         : std::copysign(strength * exponent / length * std::pow(std::abs(h) / length, exponent - 1.0),
                                         strength * h);
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

LevelForecast forecast_levels(const Scouting& scouting, const StepPotential& potential, double eta_factor) {
  const EtaAlong eta(scouting, eta_factor);
  const double s = scouting.order;
  const double side = std::copysign(1.0, potential.strength);
  double h = scouting.step, time = 0.0, here = eta(0.0);
  const double resolved = least_slope * scouting.energy_size;
  double defect = (s + 1.0) * std::pow(h, s) * here + potential.energy(h);
  LevelForecast forecast{.complete = true,
                         .steps = 0.0,
                         .shortest = h,
                         .longest = h,
                         .energy = 0.0,
                         .potential = std::abs(potential.energy(h))};
  const double first_defect = defect;
  const double end = eta.duration();
  const double most = 20.0 * end / scouting.step;
  while (time < end) {
    // Newton's iteration from the last step, on the branch where the energy grows to the side of the potential.
    const double last = h;
    bool solved = false;
    for (int iteration = 0; iteration < 20 && !solved; ++iteration) {
      const double power = std::pow(h, s - 1.0);
      const double miss = (s + 1.0) * power * h * here + potential.energy(h) - defect;
      const double slope = s * (s + 1.0) * power * here + potential.slope(h);
      if (!(slope * side * h > resolved)) {
        break;
      }
      const double next = std::clamp(h - miss / slope, 0.5 * h, 2.0 * h);
      solved = std::abs(next - h) < 1e-9 * h;
      h = next;
    }
    if (!solved || std::abs(std::log(h / last)) > believed_change || forecast.steps > most) {
      forecast.complete = false;
      return forecast;
    }
    time += h;
    const double there = eta(time);
    defect += std::pow(h, s) * (there - here);
    here = there;
    forecast.steps += 1.0;
    forecast.potential = std::max(forecast.potential, std::abs(potential.energy(h)));
    forecast.energy = std::max(forecast.energy, std::abs(defect - first_defect));
    forecast.shortest = std::min(forecast.shortest, h);
    forecast.longest = std::max(forecast.longest, h);
  }
  // As many as the stretch needs, a part of the last one left out.
  forecast.steps -= (time - end) / h;
  return forecast;
}

StepPotential make_step_potential(const Scouting& scouting, double kappa, double exponent) {
  return with_kappa(scouting, scouting.eta.front(), kappa, exponent);
}

StepPotential choose_step_potential(const Scouting& scouting, std::optional<double> largest_step) {
  const double s = scouting.order;
  const double largest = largest_of(scouting.eta);
  double kappa_limit = largest_kappa;
  if (largest_step) {
    kappa_limit = std::clamp(*largest_step / scouting.step, least_kappa, largest_kappa);
  }
  const std::array exponents = {s + 1.0, s + 2.0, s + 4.0, 2.0 * s + 2.0, 3.0 * s, 4.0 * s};
  StepPotential best;
  double least_work = 0.0;
  // An f' beside which the terms of K are lost would be all that is conserved.
  const double most =
      scouting.first_size > 0.0 ? most_of_terms * scouting.first_size : std::numeric_limits<double>::infinity();
  const double strength_limit = std::min(largest_part * std::abs(with_kappa(scouting, largest, 1.0, s).strength), most);
  const double least_energy = negligible * std::abs(with_kappa(scouting, largest, 1.0, s).strength);
  for (const double side : {std::copysign(1.0, scouting.eta.front()), -std::copysign(1.0, scouting.eta.front())}) {
    for (const double exponent : exponents) {
      for (double kappa = kappa_limit; kappa >= least_kappa; kappa /= kappa_ratio) {
        const StepPotential candidate = with_kappa(scouting, std::copysign(largest, side), kappa, exponent);
        const LevelForecast forecast = forecast_levels(scouting, candidate);
        if (!forecast.complete || forecast.potential > strength_limit ||
            !forecast_levels(scouting, candidate, eta_margin).complete) {
          continue;
        }
        // Steps needed for an error, which falls with the power s of the step.
        const double work = forecast.steps * std::pow(std::max(forecast.energy, least_energy), 1.0 / s);
        if (!best.active() || work < least_work) {
          best = candidate;
          least_work = work;
        }
      }
    }
  }
  if (best.active()) {
    return best;
  }
  // Nothing is forecast to last: steps as nearly equal as they can be.
  StepPotential equal = with_kappa(scouting, std::copysign(largest, scouting.eta.front()), least_kappa, s + 1.0);
  equal.strength /= std::max(1.0, std::abs(equal.energy(scouting.step)) / most);
  return equal;
}

}  // namespace rubato
