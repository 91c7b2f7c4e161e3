#include <rubato/variation/time_levels.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

namespace rubato {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr double infinity = std::numeric_limits<double>::infinity();

/// Accuracy asked of a step whose length will still change: Newton's next correction of h squares the error anyway.
constexpr double loose = 1e-6;
/// A root this many times longer or shorter than the step law predicts is on another branch.
constexpr double largest_ratio = 4.0;
/// Trial lengths per step. A regular step takes 2 or 3; the rest is for finding out that there is no root.
constexpr int most_trials = 60;
/// The level equation is solved to this part of the tolerance, so that what is reported stays within it.
constexpr double margin = 0.1;
/// Relative miss of the level equation below which failing to improve is blamed on rounding (terms of H that cancel).
constexpr double stagnation_level = 1e-9;

double sign(double x) {
  return x < 0.0 ? -1.0 : 1.0;
}

}  // namespace

TimeLevels::TimeLevels(LevelScheme& scheme, const LevelOptions& options, double start, double first_step)
    : scheme_(scheme), options_(options), start_(start), fixed_h_(first_step), time_(start), last_step_(first_step) {
  if (!std::isfinite(start) || !std::isfinite(first_step) || first_step == 0.0) {
    throw std::invalid_argument(
        fmt::format("time levels need a finite start and a finite first step that is not 0; got start {} and step {}",
                    start, first_step));
  }
  if (!scheme.has_node_law() && options_.on_singular == OnSingular::bridge) {
    options_.on_singular = OnSingular::stop;
  }
  if (!(options.tolerance > 0.0)) {
    throw std::invalid_argument(
        fmt::format("the tolerance of the level equation must be positive; got {}", options.tolerance));
  }
}

StepReport TimeLevels::step() {
  if (options_.levels == Levels::fixed) {
    return fixed_step();
  }
  return std::isnan(energy_) ? first_step() : variable_step();
}

StepReport TimeLevels::report(Status status, double h) const {
  StepReport result;
  result.status = status;
  result.h = h;
  result.iterations = scheme_.iterations();
  if (status == Status::success || status == Status::ill_conditioned) {
    result.energy = scheme_.discrete_energy();
    result.slope = scheme_.discrete_energy_slope();
    result.target = scheme_.energy_target().value_or(std::isnan(energy_) ? result.energy : energy_);
    result.condition = condition(h, result.slope);
  }
  return result;
}

void TimeLevels::take(StepReport& result) {
  energy_scale_ = std::max(energy_scale_, std::abs(result.energy));
  scheme_.accept();
  ++steps_;
  if (options_.levels == Levels::fixed) {
    // The level is computed, not summed, so that it is start + k·step to rounding however long the run.
    time_ = CompensatedSum(start_ + static_cast<double>(steps_) * fixed_h_);
  } else {
    time_.add(result.h);
    time_.normalize();
  }
  last_step_ = result.h;
}

double TimeLevels::condition(double h, double slope) const {
  return epsilon * energy_scale_ / std::abs(h * slope);
}

StepReport TimeLevels::plain_step(double h) {
  return report(scheme_.advance(h, 0.0), h);
}

StepReport TimeLevels::fixed_step() {
  StepReport result = plain_step(fixed_h_);
  if (result.status == Status::success) {
    if (steps_ == 0) {
      energy_ = result.energy;
    }
    take(result);
  }
  return result;
}

StepReport TimeLevels::first_step() {
  const LevelNode here = scheme_.node();
  energy_scale_ = std::max(energy_scale_, std::abs(here.energy));
  StepReport result = plain_step(fixed_h_);
  if (result.status != Status::success) {
    return result;
  }
  const LevelNode next = scheme_.trial_node();
  energy_scale_ = std::max({energy_scale_, std::abs(result.energy), std::abs(next.energy)});
  result.condition = condition(result.h, result.slope);
  const bool ill_conditioned = !(result.condition <= options_.condition_limit);
  if (options_.on_singular == OnSingular::stop) {
    if (ill_conditioned) {
      result.status = Status::ill_conditioned;
      return result;
    }
  } else if (ill_conditioned || (scheme_.has_node_law() && (here.gamma * next.gamma <= 0.0 ||
                                                            std::min(std::abs(here.gamma), std::abs(next.gamma)) <
                                                                0.5 * std::abs(next.gamma - here.gamma)))) {
    // Too near a zero of Γ for this step to set the law's constants: go on with plain steps until one can.
    return flagged(result);
  }
  singular_ = false;
  energy_ = result.energy;
  direction_ = sign(result.slope * result.h);
  const double s = scheme_.order();
  // From dE/dh = -s(s+1)/24 h^(s-1) Γ: |h^(s+1) Γ| = 24 h²|dE/dh| / (s(s+1)), and c by the node law H - E = (s+1)/24
  // h^s Γ.
  step_constant_ = 24.0 * result.h * result.h * std::abs(result.slope) / (s * (s + 1.0));
  law_constant_ = (s + 1.0) / 24.0 * std::pow(step_constant_, s / (s + 1.0));
  take_ordinary(result);
  return result;
}

StepReport TimeLevels::ordinary_step(double guess) {
  const Status status = solve_level(guess);
  StepReport result = report(status, trial_step_);
  if (status == Status::success && !(result.condition <= options_.condition_limit)) {
    result.status = Status::ill_conditioned;
  }
  return result;
}

StepReport TimeLevels::variable_step() {
  if (singular_) {
    return wait_step();
  }
  StepReport result = ordinary_step(predicted_step());
  // Near the zero of Γ the step may be so long that its own equation cannot be solved either.
  const bool lost =
      result.status != Status::success && (result.status != Status::undefined || crossing_is_near(result));
  const bool near =
      result.status == Status::success && options_.on_singular == OnSingular::bridge && crossing_is_near(result);
  if (near || (lost && options_.on_singular != OnSingular::stop)) {
    return singular_step(result);
  }
  if (result.status == Status::success) {
    take_ordinary(result);
  }
  return result;
}

void TimeLevels::take_ordinary(StepReport& result) {
  remember(result.h, result.slope);
  regular_step_ = result.h;
  take(result);
}

void TimeLevels::remember(double h, double slope) {
  const int s = scheme_.order();
  std::move_backward(history_.begin(), history_.end() - 1, history_.end());
  const double gamma_sign = -sign(slope * std::pow(sign(h), s - 1));
  history_[0] = {time_.value() + 0.5 * h, gamma_sign * std::pow(std::abs(h), -(s + 1))};
  remembered_ = std::min(remembered_ + 1, history_.size());
}

double TimeLevels::law_step(double gamma) const {
  return std::pow(step_constant_ / std::abs(gamma), 1.0 / (scheme_.order() + 1.0));
}

void TimeLevels::set_direction(double gamma) {
  // dE/d|h| = -s(s+1)/24 |h|^(s-1) sign(h)^s Γ
  direction_ = -sign(gamma) * (scheme_.order() % 2 == 0 ? 1.0 : sign(last_step_));
}

double TimeLevels::density_at(double time) const {
  double density = 0.0;
  for (std::size_t i = 0; i < remembered_; ++i) {
    double weight = 1.0;
    for (std::size_t j = 0; j < remembered_; ++j) {
      if (j != i) {
        weight *= (time - history_[j].time) / (history_[i].time - history_[j].time);
      }
    }
    density += weight * history_[i].density;
  }
  return density;
}

double TimeLevels::predicted_step() const {
  if (remembered_ < 2) {
    return regular_step_;
  }
  // The density Γ ∝ 1/h^(s+1) is a smooth function of time; extrapolate it to the middle of the coming step, whose
  // length it gives: a short fixed-point iteration.
  const double exponent = -1.0 / (scheme_.order() + 1.0);
  const double limit = 2.0 * std::abs(regular_step_);
  double length = std::abs(regular_step_);
  for (int iteration = 0; iteration < 3; ++iteration) {
    const double density = density_at(time_.value() + 0.5 * length * sign(regular_step_));
    const bool same_sign = density * history_[0].density > 0.0;
    length = same_sign ? std::min(std::pow(std::abs(density), exponent), limit) : limit;
  }
  return std::max(length, 0.5 * std::abs(regular_step_)) * sign(regular_step_);
}

Status TimeLevels::solve_level(double guess) {
  const double side = sign(guess);
  const double target = scheme_.energy_target().value_or(energy_);
  const double tolerance = margin * options_.tolerance * energy_scale_;
  const double longest = largest_ratio * std::abs(guess);
  const double shortest = std::abs(guess) / largest_ratio;

  // With G = direction·(E(h) - E): G < 0 for short steps, G' > 0 up to the fold of E(h), and the root is the crossing.
  double below = 0.0;         // longest length known to be on the near side of the root
  double below_slope = 0.0;   // G' there
  double above = infinity;    // shortest length known to be past the root, before the fold
  double fold = infinity;     // shortest length known to be past the fold
  double blocked = infinity;  // shortest length at which the step itself could not be solved
  double length = std::abs(guess);
  double best = infinity;
  double last_length = 0.0;  // the last trial before the fold, for the secant
  double last_miss = 0.0;
  int stalls = 0;  // trials in a row that brought no improvement
  bool full = false;
  Status failure = Status::singular;

  for (int trial = 0; trial < most_trials; ++trial) {
    const Status status = scheme_.advance(side * length, full ? 0.0 : loose);
    if (status != Status::success) {
      failure = status;
      blocked = length;
      length = 0.5 * (below + length);
      full = false;
      if (length < shortest) {
        return failure;
      }
      continue;
    }
    const double miss = direction_ * (scheme_.discrete_energy() - target);
    const double slope = direction_ * side * scheme_.discrete_energy_slope();
    if (!std::isfinite(miss) || !std::isfinite(slope)) {
      return Status::undefined;
    }

    if (slope <= 0.0) {
      // Past the fold. Between `below` and here E(h) has an extremum; where the parabola through both slopes puts it
      // decides.
      fold = std::min(fold, length);
      const double width = length - below;
      const double curvature = (below_slope - slope) / width;
      const double extremum = miss + 0.5 * slope * slope / curvature;
      const bool resolved = below > 0.0 && curvature > 0.0 && 0.5 * slope * slope / curvature < 0.25 * std::abs(miss);
      if (miss < 0.0 && resolved && extremum < -tolerance) {
        return blocked < infinity ? failure : Status::singular;
      }
      if (width < 1e-10 * length) {
        return Status::singular;
      }
      full = false;
      const double secant = below + width * below_slope / (below_slope - slope);
      length = below > 0.0 && secant > below && secant < length ? secant : 0.5 * (below + length);
      if (length < shortest) {
        return Status::singular;
      }
      continue;
    }

    // Met, or as near as rounding inside H allows: Newton's own correction, too, no longer improves it.
    stalls = full && std::abs(miss) >= 0.5 * best ? stalls + 1 : 0;
    const bool stagnated = stalls >= 2 && std::abs(miss) <= stagnation_level * energy_scale_;
    if (full && (std::abs(miss) <= tolerance || stagnated)) {
      trial_step_ = side * length;
      return Status::success;
    }
    if (!full && std::abs(miss) <= tolerance) {
      full = true;  // met already: the same length again, solved to stagnation
      continue;
    }
    // A loosely solved step may tell the wrong side of a root it is nearly at: it moves the bracket only from afar.
    const bool reliable = full || std::abs(miss) > loose * slope * length;
    if (reliable && miss < 0.0) {
      if (length > below) {
        below = length;
        below_slope = slope;
      }
    } else if (reliable) {
      above = std::min(above, length);
    }
    if (full) {
      best = std::min(best, std::abs(miss));
    }
    const double upper = std::min({above, fold, blocked});
    // A scheme may take its slope from a matrix that is a little out of date; where the secant agrees it is the better
    // one.
    const double secant = (miss - last_miss) / (length - last_length);
    const bool agrees = stalls == 0 && last_length > 0.0 && secant > 0.8 * slope && secant < 1.25 * slope;
    last_length = length;
    last_miss = miss;
    double next = length - miss / (agrees ? secant : slope);
    next = std::clamp(next, 0.5 * length, 2.0 * length);
    if (next <= below || next >= upper) {
      if (upper == fold && above == infinity && miss < 0.0) {
        // Newton points past the fold: only a parabola that turns before the root can say no.
        next = 0.5 * (below + fold);
        if (fold - below < 1e-10 * fold) {
          return Status::singular;
        }
      } else if (std::isfinite(upper)) {
        next = 0.5 * (below + upper);
      }
    }
    if (next > longest || next < shortest) {
      return Status::singular;
    }
    // Once the correction is small the step is solved to stagnation, and the next miss is judged.
    full = full || std::abs(next - length) < 1e-4 * length;
    length = next;
  }
  return failure == Status::singular ? Status::not_converged : failure;
}

void TimeLevels::save(StateWriter& state) const {
  state.write(time_.high);
  state.write(time_.low);
  for (const double value :
       {static_cast<double>(steps_), energy_, energy_scale_, law_constant_, step_constant_, last_step_, regular_step_,
        direction_, static_cast<double>(singular_), bridge_.h, static_cast<double>(bridge_.count), bridge_.end.energy,
        bridge_.end.gamma, static_cast<double>(remembered_)}) {
    state.write(value);
  }
  for (const Sample& sample : history_) {
    state.write(sample.time);
    state.write(sample.density);
  }
}

void TimeLevels::restore(StateReader& state) {
  state.read(time_.high);
  state.read(time_.low);
  state.read(steps_);
  state.read(energy_);
  state.read(energy_scale_);
  state.read(law_constant_);
  state.read(step_constant_);
  state.read(last_step_);
  state.read(regular_step_);
  state.read(direction_);
  state.read(singular_);
  state.read(bridge_.h);
  state.read(bridge_.count);
  state.read(bridge_.end.energy);
  state.read(bridge_.end.gamma);
  state.read(remembered_);
  for (Sample& sample : history_) {
    state.read(sample.time);
    state.read(sample.density);
  }
}

}  // namespace rubato
