#include <algorithm>
#include <cmath>
#include <optional>

#include <rubato/base/limits.hpp>
#include <rubato/variation/equal_steps.hpp>
#include <rubato/variation/look_ahead.hpp>
#include <rubato/variation/sign.hpp>
#include <rubato/variation/time_levels.hpp>
#include <rubato/variation/tuning.hpp>

// Levels with a step potential (theory, section 9): its choice, and the scalar equation K_h + f'(h) = E.

namespace rubato {

namespace {

using namespace tuning;

/// Beyond this part of the terms of K a user is warned, and what lies beyond the end of the run does not count.
constexpr double strong_part = 0.1;

/// The x next to 0 with miss + rate x + curvature x² = 0; Newton's where that is far from it.
double move_to_root(double miss, double rate, double curvature) {
  const double bend = 1.0 - 4.0 * curvature * miss / (rate * rate);
  return -2.0 * miss / (rate * (1.0 + (bend > 0.25 ? std::sqrt(bend) : 1.0)));
}

}  // namespace

void TimeLevels::choose_potential() {
  const StepPotentialChoice& choice = options_.potential;
  if (choice.kind == StepPotentialChoice::Kind::none || potential_.active()) {
    return;
  }
  if (choice.kind == StepPotentialChoice::Kind::stated) {
    set_potential(choice.potential);
    return;
  }
  const bool given = choice.kind == StepPotentialChoice::Kind::given;
  const bool short_run =
      !given && options_.spares_look_ahead && is_short_run(scheme_.order(), fixed_h_, options_.run_length);
  const double to_end =
      std::isfinite(options_.run_length) ? options_.run_length : longest_stretch_untold * std::abs(fixed_h_);
  // What lies beyond the end of the run, which may be continued, counts unless it takes a potential too strong for what
  // lies before, as where the motion blows up there.
  const auto is_strong = [&](const CostedPotential& made, const LookAhead& look) {
    return std::abs(made.potential.energy(fixed_h_)) > strong_part * look.first_size;
  };
  std::optional<CostedPotential> chosen;
  for (const double farthest : {infinity, to_end}) {
    const LookAhead look = look_ahead(scheme_, fixed_h_, given || short_run, options_.tolerance, to_end, farthest);
    if (look.eta.empty()) {
      return;  // the first step will show why
    }
    // A little less: the rounding error of a sum of steps decides nothing.
    if (!look.depends_on_step() && look.duration >= (1.0 - 1e-9) * to_end) {
      return;  // every length will do
    }
    if (given) {
      set_potential(make_step_potential(look, choice.kappa, choice.exponent));
      return;
    }
    if (short_run && look.eta.size() == 1) {
      set_potential(nearly_equal_steps(look).value());
      return;
    }
    const CostedPotential found = choose_costed_potential(look, choice.largest_step);
    if (!chosen || !is_strong(found, look)) {
      chosen = found;
    }
    if (look.duration <= to_end || !is_strong(*chosen, look)) {
      break;
    }
  }
  set_potential(chosen->potential);
  potential_cost_ = chosen->cost_in_steps;
}

/// A step of the first length, where K does not depend on it; flagged if it is off E after all.
StepReport TimeLevels::steady_step() {
  StepReport result = plain_step(fixed_h_);
  if (result.status != Status::success) {
    return result;
  }
  if (std::isnan(energy_)) {
    set_energy(result);
    result.target = scheme_.energy_target().value_or(energy_);
  }
  law_scale_ = law_scale_ > 0.0 ? law_scale_ : energy_scale_;  // at rest, of the first step that has terms
  if (!(std::abs(result.energy - result.target) <= allowed_miss(result))) {
    if (options_.on_singular == OnSingular::stop) {
      result.status = Status::singular;
      return result;
    }
    return flagged(result);
  }
  singular_ = false;
  result.condition = 0.0;  // no error of E_k is one of h
  take(result);
  return result;
}

/// dE/dh by differences over the scheme's: as the steps up to the last let expect, or the last that is known.
double TimeLevels::foreseen_slope_ratio() {
  if (slope_ratios_.empty()) {
    return 1.0;
  }
  const bool is_known_of_last = since_ratio_ <= std::abs(regular_step_);
  return is_known_of_last ? std::clamp(slope_ratios_.at(since_ratio_), 1.0 / largest_slope_ratio, largest_slope_ratio)
                          : slope_ratios_.newest();
}

/// Newton's iteration on h ↦ K_h + f'(h), with the curvature of both, kept between lengths known to be too short and
/// too long. A root is taken only where E_k grows to the side of the potential.
Status TimeLevels::solve_with_potential(double guess) {
  const double side = sign(guess);
  const double foreseen = std::abs(guess);
  const double tolerance = solved_to();
  double length = foreseen, last_length = 0.0, last_miss = 0.0, best = infinity;
  double below = 0.0, above = infinity, last_slope = 0.0;
  bool full = scheme_.solves_fully() || first_miss_ <= tolerance, last_full = false;
  int stalls = 0;
  double slope_ratio = foreseen_slope_ratio();
  double rate_ratio = slope_ratio;  // of the last move
  bool ratio_is_known = false;
  for (int trial = 0; trial < most_potential_trials; ++trial) {
    if (const Status status = scheme_.advance(side * length, full ? 0.0 : loose); status != Status::success) {
      // Too long for its own equation, it may be: half way back to the step before.
      const double shorter = 0.5 * (length + std::min(length, std::abs(regular_step_)));
      if (shorter > 0.99 * length) {
        return status;
      }
      length = shorter;
      full = scheme_.solves_fully();
      continue;
    }
    const double h = side * length;
    const double miss = direction_ * (scheme_.discrete_energy() + potential_at(h).energy - energy_);
    const double scheme_slope = direction_ * side * scheme_.discrete_energy_slope();
    const double potential_slope = direction_ * side * potential_at(h).slope;
    const double slope = scheme_slope + potential_slope;
    if (!std::isfinite(miss) || !std::isfinite(slope)) {
      return Status::undefined;
    }
    if (trial == 0) {
      first_miss_ = std::max(std::abs(miss), std::isfinite(first_miss_) ? memory * first_miss_ : 0.0);
    }
    if (last_length > 0.0 && last_length != length && std::abs(last_miss) > tolerance) {
      left_of_miss_ = std::max(memory * left_of_miss_, std::max(0.0, std::abs(miss) - tolerance) / std::abs(last_miss));
    }
    // Where a scheme knows its slope to leading order differences between trials show the rest, and what they reported
    // on the last steps.
    const double secant = (miss - last_miss) / (length - last_length);
    const double ratio = secant / (0.5 * (slope + last_slope));
    const double pair_error = full && last_full ? 2.0 * rounding_ : loose_energy * std::abs(slope) * length;
    const bool is_near = last_length > 0.0 && std::abs(length - last_length) < nearby * length;
    if (scheme_.slope_to_leading_order() && is_near && std::abs(miss - last_miss) > standing_out * pair_error &&
        ratio < largest_slope_ratio && ratio > 1.0 / largest_slope_ratio) {
      slope_ratio = ratio;
      ratio_is_known = true;
    }
    stalls = full && std::abs(miss) >= 0.5 * best ? stalls + 1 : 0;
    if (stalls >= 2) {
      measure(h);  // rounding may be more than at the last level
    }
    // Or so near that neither E_k, by its tolerance, nor h feels the difference.
    const double unfelt = std::min(margin * options_.tolerance * energy_scale_, unfelt_in_step * slope * length);
    const double enough = std::max(tolerance, unfelt);
    const bool stagnated = stalls >= 2 && std::abs(miss) <= std::max(options_.tolerance * energy_scale_,
                                                                     rounding_ + epsilon * std::abs(slope) * length);
    // No other h is nearer than its last place lets it be, which a large f' multiplies.
    const double last_place = 0.5 * epsilon * std::abs(slope) * length;
    if (full && (std::abs(miss) <= std::max(enough, last_place) || stagnated)) {
      trial_step_ = h;
      slope_ratio_ = rate_ratio;
      if (ratio_is_known) {
        slope_ratios_.add(since_ratio_, slope_ratio);
        since_ratio_ = 0.0;
      }
      since_ratio_ += length;
      return slope > 0.0 ? Status::success : Status::singular;
    }
    if (!full && std::abs(miss) <= enough) {
      full = true;  // met already: the same length again, solved to stagnation
      continue;
    }
    // Newton's moves with a slope that is far off: trials solved to rounding show by how much.
    full = full || (last_length > 0.0 && std::abs(miss) > slow * std::abs(last_miss));
    best = full ? std::min(best, std::abs(miss)) : best;
    // E_k has one branch that grows with the length to the side of the potential: a root lies between a length that is
    // too short, or short of that branch, and one that is too long. A loosely solved step may show the wrong side of a
    // root it is nearly at.
    const double error = full && last_full ? 2.0 * rounding_ : loose * std::abs(slope) * length;
    const bool reliable = full || std::abs(miss) > error;
    if (slope <= 0.0 || (reliable && miss < 0.0)) {
      below = std::max(below, length);
    } else if (reliable) {
      above = std::min(above, length);
    }
    const bool measured =
        is_near && stalls > 0 && full && last_full && secant > 0.0 && std::abs(miss - last_miss) > pair_error;
    const double rate = measured ? secant : slope_ratio * slope;
    rate_ratio = rate / slope;
    last_length = length;
    last_miss = miss;
    last_slope = slope;
    last_full = full;
    // K_h - H goes with h^s, f' with h^p.
    const double curvature =
        0.5 * ((scheme_.order() - 1.0) * scheme_slope + (potential_.exponent - 1.0) * potential_slope) / length;
    double next = longest_move * length;
    if (rate > 0.0) {
      next = std::clamp(length + move_to_root(miss, rate, curvature), length / longest_move, next);
    }
    if (stalls == 0 && (next <= below || next >= above)) {
      next = above < infinity ? 0.5 * (below + above) : longest_move * below;
    }
    if (next > farthest_root * foreseen || next < foreseen / farthest_root) {
      return Status::singular;
    }
    // Met after this move, as others have been: then it may be the last.
    const bool expected = left_of_miss_ * std::abs(miss) <= enough;
    full = full || expected || std::abs(next - length) < last_move * length;
    length = next;
  }
  return Status::not_converged;
}

}  // namespace rubato
