#include <rubato/variation/time_levels.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/base/lagrange_weight.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/variation/power_of.hpp>
#include <rubato/variation/sign.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

using namespace tuning;

namespace {

/// True if Γ is so near a zero that it changes by as much as itself over a step.
bool changes_much(double at_start, double at_end) {
  return at_start * at_end <= 0.0 || std::min(std::abs(at_start), std::abs(at_end)) < 0.5 * std::abs(at_end - at_start);
}

}  // namespace

TimeLevels::TimeLevels(LevelScheme& scheme, const LevelOptions& options, double start, double first_step)
    : scheme_(scheme), options_(options), start_(start), fixed_h_(first_step), time_(start), last_step_(first_step) {
  if (!std::isfinite(start) || !std::isfinite(first_step) || first_step == 0.0) {
    throw std::invalid_argument(
        fmt::format("time levels need a finite start and a finite first step that is not 0; got start {} and step {}",
                    start, first_step));
  }
  if (options_.levels == Levels::fixed || scheme.energy_target()) {
    options_.potential = {};
  }
  if (const StepPotentialChoice& choice = options_.potential; choice.kind == StepPotentialChoice::Kind::given) {
    if (!(choice.kappa > 0.0) || !(choice.exponent > scheme.order())) {
      throw StepPotentialError(
          fmt::format("a step potential needs kappa > 0 and p greater than the order of the scheme, {}; got kappa = {} "
                      "and p = {}",
                      scheme.order(), choice.kappa, choice.exponent));
    }
  }
  if (!(options.tolerance > 0.0)) {
    throw std::invalid_argument(
        fmt::format("the tolerance of the level equation must be positive; got {}", options.tolerance));
  }
  measure(first_step);
}

StepReport TimeLevels::step() {
  StepReport result = options_.levels == Levels::fixed ? fixed_step()
                      : std::isnan(energy_)            ? first_step()
                                                       : variable_step();
  if (result.status != Status::success) {
    add_evidence(result);
  }
  result.energy += options_.energy_constant;
  result.target += options_.energy_constant;
  return result;
}

/// What the terms of E_k and its rounding are at the trial step; of a step potential its own rounding, and that of the
/// sum.
void TimeLevels::measure(double h) {
  const formula::SumSize size = scheme_.energy_size();
  if (std::isfinite(size.terms) && std::isfinite(size.rounding)) {
    // Where f' is large K is as large, and E is what is left of both.
    const bool is_set = potential_.active() && !std::isnan(energy_);
    const double scale = is_set ? std::min(size.terms, std::max(std::abs(energy_), size.cancelled)) : size.terms;
    energy_scale_ = std::max(energy_scale_, scale);
    sizes_.terms = std::max(sizes_.terms, size.terms);
    sizes_.cancelled = std::max(sizes_.cancelled, size.cancelled);
    sizes_.rounding = std::max(sizes_.rounding, size.rounding);
    rounding_ = size.rounding;
    if (potential_.active()) {
      const double potential = potential_at(h).energy;
      rounding_ += potential_.rounding_of(potential) + 0.5 * epsilon * std::abs(scheme_.discrete_energy() + potential);
    }
  }
}

StepReport TimeLevels::report(Status status, double h) {
  StepReport result;
  result.status = status;
  result.h = h;
  result.iterations = scheme_.iterations();
  result.target = scheme_.energy_target().value_or(energy_);
  if (status == Status::success) {
    // With fixed levels nothing is solved to it; with variable ones the caller that stalls looks again.
    const std::size_t period = scheme_.energy_size_period();
    if (steps_ % (options_.levels == Levels::fixed ? period : period / size_period) == 0) {
      measure(h);
    }
    result.potential = potential_at(h).energy;
    result.energy = scheme_.discrete_energy() + result.potential;
    result.slope = options_.levels == Levels::fixed && scheme_.slope_costs_more()
                       ? std::numeric_limits<double>::quiet_NaN()
                       : scheme_.discrete_energy_slope() + potential_at(h).slope;
    result.condition = options_.levels == Levels::fixed ? std::numeric_limits<double>::quiet_NaN()
                                                        : rounding_ / std::abs(h * result.slope);
  }
  return result;
}

/// What may be left of the level equation. A part of the tolerance, so that what is reported stays within it, and
/// further down to the rounding error of E_k at this level, or to as many times that as the tolerance is coarser than
/// the usual one: the tolerance is relative to the largest terms of the run, beside which H - E itself may be nothing
/// where terms are small, as far out on an eccentric orbit. A trial more is cheap, and what is left of the equation is
/// part of the error of h. Never less than the last place of E, which is far more than that of the terms of K beside a
/// large step potential.
double TimeLevels::solved_to() const {
  const double rounding = std::max(rounding_, epsilon * std::abs(energy_));
  const double coarser = std::max(1.0, options_.tolerance / LevelOptions{}.tolerance);
  return std::max(std::min(coarser * rounding, margin * options_.tolerance * energy_scale_),
                  epsilon * std::abs(energy_));
}

/// |E_k - E| up to which a step meets the law: the tolerance, or where that is less, what rounding in E_k and in h
/// leave.
double TimeLevels::allowed_miss(const StepReport& step) const {
  return std::max(options_.tolerance * energy_scale_, 2.0 * (rounding_ + epsilon * std::abs(step.h * step.slope)));
}

/// What the slope of a step makes of Γ, from dK/dh = -s(s+1)/24 h^(s-1) Γ.
double TimeLevels::gamma_of(const StepReport& step) const {
  const double s = scheme_.order();
  const double power = power_of(step.h, scheme_.order() - 1);
  return -24.0 * (step.slope - potential_at(step.h).slope) / (s * (s + 1.0) * power);
}

void TimeLevels::add_evidence(StepReport& failed) const {
  failed.gamma_before = reported_gamma(scheme_.has_gamma() && steps_ < 2 ? slope_gamma_[0] : slope_gamma_[1]);
  failed.gamma_after = reported_gamma(scheme_.has_gamma() ? scheme_.node().gamma : slope_gamma_[0]);
}

void TimeLevels::take(StepReport& result) {
  slope_gamma_ = {gamma_of(result), slope_gamma_[0]};
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

StepReport TimeLevels::plain_step(double h) {
  return report(scheme_.advance(h, 0.0), h);
}

StepReport TimeLevels::fixed_step() {
  StepReport result = plain_step(fixed_h_);
  if (result.status == Status::success) {
    if (steps_ == 0) {
      energy_ = result.energy;
      result.target = scheme_.energy_target().value_or(energy_);
    }
    take(result);
  }
  return result;
}

StepReport TimeLevels::first_step() {
  choose_potential();
  if (is_steady()) {
    return steady_step();
  }
  const NodeEnergy here = scheme_.node();
  StepReport result = plain_step(fixed_h_);
  if (result.status != Status::success) {
    return result;
  }
  const bool ill_conditioned = !(result.condition <= options_.condition_limit);
  const double terms_of_step = least_terms * std::abs(result.energy - result.potential - here.energy);
  if (potential_.active()) {
    if (ill_conditioned && options_.potential.kind == StepPotentialChoice::Kind::automatic) {
      // Chosen for what rounding grows into later, as at an unstable equilibrium: here K does not depend on h.
      set_potential({});
      potential_cost_.reset();
      return steady_step();
    }
    if (ill_conditioned) {
      result.status = Status::ill_conditioned;
      return result;
    }
    set_energy(result, terms_of_step);
    result.target = energy_;
    direction_ = sign(potential_.strength);
    take_ordinary(result);
    return result;
  }
  if (options_.on_singular == OnSingular::stop) {
    if (ill_conditioned) {
      result.status = Status::ill_conditioned;
      return result;
    }
  } else if (const double middle = gamma_of(result);
             ill_conditioned ||
             (scheme_.has_node_law() &&
              // From the middle of the step before to that of this one; of the first from end to end.
              (steps_ > 0 ? changes_much(slope_gamma_[0], middle)
                          : changes_much(here.gamma, 2.0 * middle - here.gamma)))) {
    // Too near a zero of Γ for this step to set the law's constants: go on with plain steps until one can.
    return flagged(result);
  }
  singular_ = false;
  set_energy(result, terms_of_step);
  result.target = scheme_.energy_target().value_or(energy_);
  direction_ = sign(result.slope * result.h);
  const double s = scheme_.order();
  // From dE/dh = -s(s+1)/24 h^(s-1) Γ: |h^(s+1) Γ| = 24 h²|dE/dh| / (s(s+1)).
  step_constant_ = 24.0 * result.h * result.h * std::abs(result.slope) / (s * (s + 1.0));
  take_ordinary(result);
  return result;
}

StepReport TimeLevels::ordinary_step(double guess) {
  const Status status = potential_.active() ? solve_with_potential(guess) : solve_level(guess);
  StepReport result = report(status, trial_step_);
  if (status == Status::success) {
    const double miss = std::abs(result.energy - result.target);
    result.condition = (rounding_ + miss) / std::abs(result.h * result.slope * slope_ratio_);
    if (!(miss <= allowed_miss(result))) {
      result.status = Status::not_converged;
    } else if (!(miss <= largest_miss_of_terms * law_scale_) || !(result.condition <= options_.condition_limit)) {
      result.status = Status::ill_conditioned;
    }
  }
  return result;
}

StepReport TimeLevels::variable_step() {
  if (is_steady()) {
    return steady_step();
  }
  if (singular_) {
    return resumed();
  }
  StepReport result = ordinary_step(predicted_step());
  if (result.status != Status::success && potential_.active()) {
    // Where η turns unforeseen, as on a chaotic orbit: steps may not go on growing or shrinking, or be as long as f'
    // lets them be at once.
    for (const double guess : {regular_step_, std::copysign(potential_.length, regular_step_)}) {
      if (result.status != Status::success) {
        result = ordinary_step(guess);
      }
    }
  }
  if (result.status != Status::success && options_.on_singular == OnSingular::plain) {
    return plain_instead(result);
  }
  if (result.status == Status::success) {
    take_ordinary(result);
  }
  return result;
}

/// The law again, if it can be met from here; else a plain step. The pure law is not met again by a step that differs
/// much from what the step law asks for: the amplitude of H - E would wander away.
StepReport TimeLevels::resumed() {
  const double gamma = slope_gamma_[0];
  if (!potential_.active() && std::isfinite(gamma)) {
    // Beyond the zero of Γ the law may hold again: dE/d|h| = -s(s+1)/24 |h|^(s-1) sign(h)^s Γ.
    direction_ = -sign(gamma) * (scheme_.order() % 2 == 0 ? 1.0 : sign(last_step_));
  }
  StepReport result = ordinary_step(plain_length());
  const double misfit = std::abs(result.h) / law_step(gamma);
  const bool fits = potential_.active() || (misfit < largest_misfit && misfit > 1.0 / largest_misfit);
  if (result.status != Status::success || !fits) {
    if (result.status == Status::success) {
      result.status = Status::not_converged;  // it is not taken
    }
    return plain_instead(result);
  }
  singular_ = false;
  forecast_.restart();
  slope_ratios_ = {};
  remembered_ = 0;
  take_ordinary(result);
  return result;
}

/// The last step that met the law, or what the pure law asks for here where that is shorter.
double TimeLevels::plain_length() const {
  const double longest = std::abs(regular_step_);
  return std::copysign(potential_.active() ? longest : std::min(longest, law_step(slope_gamma_[0])), regular_step_);
}

/// A plain step, flagged, where the law was not met: of plain_length() or, where that is too long for the
/// step's own equation, of half of it, and so on as far as the first step's. One that has another energy altogether is
/// none: the motion blows up, and there is nothing beyond. Where a longer one, or the trials for the law, left the
/// domain of H that is distinguished from less, as shorter steps would only lead across.
StepReport TimeLevels::plain_instead(const StepReport& failed) {
  const double first = std::abs(fixed_h_);
  double length = std::abs(plain_length());
  bool doubtful = failed.status == Status::undefined;
  for (;;) {
    const StepReport plain = plain_step(std::copysign(length, regular_step_));
    if (plain.status == Status::success) {
      return !doubtful || std::abs(plain.energy - plain.target) <= law_scale_ ? flagged(plain) : failed;
    }
    if (!(length > first)) {  // shorter steps are not tried
      return plain;
    }
    length = std::max(0.5 * length, first);
    doubtful = true;
  }
}

/// Takes a plain step, which does not meet the law.
StepReport TimeLevels::flagged(StepReport result) {
  if (std::abs(result.energy - result.target) > another_energy * law_scale_) {
    result.status = Status::not_converged;  // the motion blows up: there is nothing beyond
    return result;
  }
  result.off_law = true;
  singular_ = true;
  result.gamma_before = reported_gamma(steps_ == 0 && scheme_.has_gamma() ? scheme_.node().gamma : slope_gamma_[0]);
  result.gamma_after = reported_gamma(gamma_of(result));
  take(result);
  return result;
}

/// E of the run is that of this step. \param terms of E at the least, by what the step adds to H: where all is the same
/// everywhere and nothing moves at the start, the terms are 0 there
void TimeLevels::set_energy(const StepReport& result, double terms) {
  energy_ = result.energy;
  energy_scale_ = std::max(energy_scale_, terms);
  law_scale_ = std::max({scheme_.energy_size().terms, std::abs(result.potential), terms});
}

void TimeLevels::take_ordinary(StepReport& result) {
  if (potential_.active()) {
    forecast_.add(result.h, energy_ - scheme_.node().energy, result.slope, result.potential, scheme_.order());
  } else {
    remember(result.h, result.slope);
  }
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

double TimeLevels::density_at(double time) const {
  double density = 0.0;
  for (std::size_t i = 0; i < remembered_; ++i) {
    density +=
        lagrange_weight(i, remembered_, time, [&](std::size_t j) { return history_[j].time; }) * history_[i].density;
  }
  return density;
}

double TimeLevels::predicted_step() {
  if (potential_.active()) {
    return forecast_.empty() ? regular_step_
                             : std::copysign(forecast_.length(regular_step_, energy_ - scheme_.node().energy,
                                                              potential_, scheme_.order()),
                                             regular_step_);
  }
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

void TimeLevels::save(StateWriter& state) const {
  potential_.save(state);
  forecast_.save(state);
  slope_ratios_.save(state);
  state.write(since_ratio_);
  state.write(first_miss_);
  state.write(left_of_miss_);
  state.write(time_.high);
  state.write(time_.low);
  for (const double value : {static_cast<double>(steps_), energy_, energy_scale_, law_scale_, rounding_, step_constant_,
                             last_step_, regular_step_, direction_, static_cast<double>(singular_), slope_gamma_[0],
                             slope_gamma_[1], static_cast<double>(remembered_)}) {
    state.write(value);
  }
  for (const Sample& sample : history_) {
    state.write(sample.time);
    state.write(sample.density);
  }
}

void TimeLevels::restore(StateReader& state) {
  StepPotential potential;
  potential.restore(state);
  set_potential(potential);
  forecast_.restore(state);
  slope_ratios_.restore(state);
  state.read(since_ratio_);
  state.read(first_miss_);
  state.read(left_of_miss_);
  state.read(time_.high);
  state.read(time_.low);
  state.read(steps_);
  state.read(energy_);
  state.read(energy_scale_);
  state.read(law_scale_);
  state.read(rounding_);
  state.read(step_constant_);
  state.read(last_step_);
  state.read(regular_step_);
  state.read(direction_);
  state.read(singular_);
  state.read(slope_gamma_[0]);
  state.read(slope_gamma_[1]);
  state.read(remembered_);
  for (Sample& sample : history_) {
    state.read(sample.time);
    state.read(sample.density);
  }
}

}  // namespace rubato
