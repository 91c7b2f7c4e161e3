#include <rubato/variation/step_potential.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <vector>

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
constexpr double last_resort = 0.5;
/// How large f' may become, beside what the node energy is off with equal steps.
constexpr double largest_part = 4.0;
/// Potentials are as good as the best up to this part of its work.
constexpr double as_good = 0.1;
/// So many times η is made to change its sign and back, to see whether levels would last where it does so unseen.
constexpr double unseen_turns = 6.0;
constexpr double two_pi = 2.0 * std::numbers::pi;
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
  EtaAlong(const Scouting& scouting, const EtaDoubt& doubt) : eta_(scouting.eta), step_(scouting.step), doubt_(doubt) {}

  [[nodiscard]] double operator()(double time) const {
    const double turned = doubt_.turn > 0.0 ? std::cos(two_pi * time / doubt_.turn) : 1.0;
    return doubt_.factor * turned * seen(time);
  }
  [[nodiscard]] double duration() const { return step_ * static_cast<double>(eta_.size()); }

private:
  [[nodiscard]] double seen(double time) const {
    const double at = time / step_ - 0.5;
    if (at <= 0.0) {
      return eta_.front();
    }
    const auto i = static_cast<std::size_t>(at);
    if (i + 1 >= eta_.size()) {
      return eta_.back();
    }
    // The cubic through both, with the slopes that their neighbours tell.
    const double part = at - static_cast<double>(i);
    const double left = eta_[i], right = eta_[i + 1];
    const double before = i > 0 ? eta_[i - 1] : left, after = i + 2 < eta_.size() ? eta_[i + 2] : right;
    const double rise = right - left, slope_left = 0.5 * (right - before), slope_right = 0.5 * (after - left);
    const double bend = slope_left - rise, twist = rise - slope_right;
    return left + part * (rise + (1.0 - part) * ((1.0 - part) * bend + part * twist));
  }

  std::span<const double> eta_;
  double step_;
  EtaDoubt doubt_;
};

double largest_of(std::span<const double> eta) {
  double largest = 0.0;
  for (const double value : eta) {
    largest = std::max(largest, std::abs(value));
  }
  return largest;
}

/// To two digits, so that what rounding makes of η, or another statement of the same problem, changes no potential.
double rounded(double value) {
  const double unit = std::pow(10.0, std::floor(std::log10(std::abs(value))) - 1.0);
  return std::round(value / unit) * unit;
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

StepPotentialChoice resolved(const StepPotentialChoice& choice, bool usual_is_automatic) {
  using Kind = StepPotentialChoice::Kind;
  return choice.kind != Kind::usual ? choice
                                    : StepPotentialChoice{.kind = usual_is_automatic ? Kind::automatic : Kind::none};
}

LevelForecast forecast_levels(const Scouting& scouting, const StepPotential& potential, const EtaDoubt& doubt) {
  const EtaAlong eta(scouting, doubt);
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
  struct Candidate {
    StepPotential potential;
    double work, part;
  };
  const double s = scouting.order;
  const auto made = [&](double eta, double kappa, double exponent) {
    StepPotential potential = with_kappa(scouting, eta, kappa, exponent);
    potential.strength = rounded(potential.strength);
    return potential;
  };
  const double largest = largest_of(scouting.eta), side = std::copysign(1.0, scouting.eta.front());
  const double strayed = std::abs(made(largest, 1.0, s).strength);
  // An f' beside which the terms of K are lost would be all that is conserved.
  const double most =
      scouting.first_size > 0.0 ? most_of_terms * scouting.first_size : std::numeric_limits<double>::infinity();
  double kappa_limit = largest_kappa;
  if (largest_step) {
    kappa_limit = std::clamp(*largest_step / scouting.step, least_kappa, largest_kappa);
  }
  if (s * (s + 1.0) * largest * std::pow(scouting.step, s) < least_slope * scouting.energy_size) {
    return made(0.0, 1.0, s + 1.0);  // K hardly knows h: steps are as long as the first
  }
  std::vector<Candidate> candidates;
  for (const double sign : {side, -side}) {
    for (const double exponent : {s + 1.0, s + 2.0, s + 4.0, 2.0 * s + 2.0, 3.0 * s, 4.0 * s}) {
      for (double kappa = kappa_limit; kappa >= least_kappa; kappa /= kappa_ratio) {
        const StepPotential potential = made(std::copysign(largest, sign), kappa, exponent);
        const LevelForecast forecast = forecast_levels(scouting, potential);
        if (forecast.complete && forecast_levels(scouting, potential, {.factor = eta_margin}).complete) {
          // Steps needed for an error, which falls with the power s of the step.
          const double strays = std::max(forecast.energy, negligible * strayed);
          candidates.push_back({potential, forecast.steps * std::pow(strays, 1.0 / s), forecast.potential});
        }
      }
    }
  }
  if (candidates.empty()) {
    // Nothing is forecast to last: steps that are nearly equal.
    StepPotential equal = made(std::copysign(largest, side), last_resort, s + 1.0);
    equal.strength /= std::max(1.0, std::abs(equal.energy(scouting.step)) / most);
    return equal;
  }
  const auto weakest = [&] { return std::ranges::min_element(candidates, {}, &Candidate::part)->potential; };
  const double limit = std::min(largest_part * strayed, most);
  if (std::ranges::none_of(candidates, [&](const Candidate& one) { return one.part <= limit; })) {
    return weakest();
  }
  std::erase_if(candidates, [&](const Candidate& one) { return one.part > limit; });
  // One by one, each unless it leaves none.
  const auto keep = [&](auto&& condition) {
    std::vector<Candidate> kept;
    std::ranges::copy_if(candidates, std::back_inserter(kept), condition);
    if (!kept.empty()) {
      candidates = std::move(kept);
    }
  };
  // An η that was seen with one sign only may grow beyond what was seen: a potential of the other sign would not last.
  if (std::ranges::all_of(scouting.eta, [&](double eta) { return eta * side >= 0.0; })) {
    keep([&](const Candidate& one) { return one.potential.strength * side > 0.0; });
  }
  const double least_work = std::ranges::min_element(candidates, {}, &Candidate::work)->work;
  keep([&](const Candidate& one) { return one.work <= (1.0 + as_good) * least_work; });
  const double turn = scouting.step * static_cast<double>(scouting.eta.size()) / unseen_turns;
  keep([&](const Candidate& one) {
    return forecast_levels(scouting, one.potential, {.factor = eta_margin, .turn = turn}).complete;
  });
  return weakest();
}

}  // namespace rubato
