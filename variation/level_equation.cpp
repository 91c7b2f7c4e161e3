#include <algorithm>
#include <cmath>

#include <rubato/base/limits.hpp>
#include <rubato/variation/sign.hpp>
#include <rubato/variation/time_levels.hpp>
#include <rubato/variation/tuning.hpp>

// The scalar equation E(h) = E for the length of a step (theory, section 3.2).

namespace rubato {

using namespace tuning;

Status TimeLevels::solve_level(double guess) {
  const double side = sign(guess);
  const double target = scheme_.energy_target().value_or(energy_);
  const double tolerance = solved_to();
  const int order = scheme_.order();
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
  double last_slope = 0.0;
  double correction = 1.0;  // secant over slope, where the slope is found to be off
  bool last_full = false;
  bool newton = true;  // whether this length came from the last slope, not from halving a bracket
  int stalls = 0;      // such trials in a row that brought no improvement
  bool full = false;
  bool reopened = false;
  Status failure = Status::singular;

  for (int trial = 0; trial < most_trials; ++trial) {
    const Status status = scheme_.advance(side * length, full ? 0.0 : loose);
    if (status != Status::success) {
      failure = status;
      blocked = length;
      newton = false;
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
      newton = false;
      const double secant = below + width * below_slope / (below_slope - slope);
      length = below > 0.0 && secant > below && secant < length ? secant : 0.5 * (below + length);
      if (length < shortest) {
        return Status::singular;
      }
      continue;
    }

    // Met, or as near as rounding inside H allows: Newton's own correction, too, no longer improves it, or no length is
    // left between those known to be too short and too long.
    const bool worse = full && std::abs(miss) >= 0.5 * best;
    stalls = worse ? stalls + (newton ? 1 : 0) : 0;
    const bool closed = worse && std::min(above, fold) - below <= 4.0 * epsilon * length;
    if (stalls >= 2 || closed) {
      measure(side * length);  // rounding may be more than at the last level
    }
    const bool stagnated = (stalls >= 2 || closed) && std::abs(miss) <= std::max(options_.tolerance * energy_scale_,
                                                                                 rounding_ + epsilon * slope * length);
    if (full && (std::abs(miss) <= tolerance || stagnated)) {
      trial_step_ = side * length;
      return Status::success;
    }
    if (closed && !reopened) {
      // The bracket closed on no root: some trial was solved too loosely to tell its side.
      reopened = true;
      below = below_slope = 0.0;
      above = blocked = infinity;
      best = infinity;
      stalls = 0;
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
    // A scheme may take its slope from a matrix that is a little out of date, and a lattice knows it to leading order
    // only, which is far off where Γ is small. Where it is nearly right the secant itself serves, moved by the
    // curvature that slopes to leading order tell as well; elsewhere secants that stand out from the errors of their
    // ends correct it.
    // All of it by h^s, on which E_k depends linearly to leading order, with the slope s h^(s-1) of the present length
    // taken out.
    const double unit = length / order;  // h^s over its derivative
    const double secant = (miss - last_miss) / (unit * (1.0 - std::pow(last_length / length, order)));
    const double same_slope = last_slope * std::pow(length / last_length, order - 1);  // that of the last trial, here
    const bool agrees = stalls == 0 && last_length > 0.0 && secant > 0.8 * slope && secant < 1.25 * slope;
    const double error = full && last_full ? 2.0 * rounding_ : loose * slope * length;
    if (last_length > 0.0 && secant > 0.0 && std::abs(miss - last_miss) > 100.0 * error) {
      const double ratio = secant / (0.5 * (slope + same_slope));
      correction = ratio > 0.8 && ratio < 1.25 ? 1.0 : ratio;
    }
    const double bend = scheme_.slope_to_leading_order() ? slope / (0.5 * (slope + same_slope)) : 1.0;
    // Where Newton's steps have stalled, the secant between two solved steps is the truth as far as rounding lets it
    // be.
    const bool measured = stalls > 0 && full && last_full && secant > 0.0 && std::abs(miss - last_miss) > error;
    const double local_slope = measured ? secant : agrees ? bend * secant : correction * slope;
    last_length = length;
    last_miss = miss;
    last_slope = slope;
    last_full = full;
    double next = length * std::pow(std::max(0.0, 1.0 - miss / (local_slope * unit)), 1.0 / order);
    newton = true;
    next = std::clamp(next, 0.5 * length, 2.0 * length);
    if (next <= below || next >= upper) {
      newton = false;
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

}  // namespace rubato
