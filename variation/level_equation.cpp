#include <algorithm>
#include <cmath>

#include <rubato/base/limits.hpp>
#include <rubato/variation/sign.hpp>
#include <rubato/variation/time_levels.hpp>
#include <rubato/variation/tuning.hpp>

// The scalar equation E(h) = E for the length of a step (theory, section 3.2).

namespace rubato {

using namespace tuning;

namespace {

/// A length h and what E(h) - E and its slope are there, with the sign that makes short steps negative: G < 0, and
/// G' > 0 up to the fold of E(h); the root is the crossing.
struct Trial {
  double length = 0.0, miss = 0.0, slope = 0.0;
  bool full = false;  ///< solved to stagnation, not loosely
};

/// What trials have reported on where the root is.
struct RootBracket {
  double below = 0.0;         ///< longest length known to be on the near side of the root
  double below_slope = 0.0;   ///< G' there
  double above = infinity;    ///< shortest length known to be past the root, before the fold
  double fold = infinity;     ///< shortest length known to be past the fold
  double blocked = infinity;  ///< shortest length at which the step itself could not be solved

  [[nodiscard]] double upper() const { return std::min({above, fold, blocked}); }
  /// No length is left between those known to be too short and too long.
  [[nodiscard]] bool is_closed(double length) const { return std::min(above, fold) - below <= 4.0 * epsilon * length; }
  /// It closed on no root: some trial was solved too loosely to show its side.
  void reopen() {
    below = below_slope = 0.0;
    above = blocked = infinity;
  }

  /// A loosely solved step may show the wrong side of a root it is nearly at: it moves the bracket only from afar.
  void add(const Trial& trial) {
    if (!trial.full && std::abs(trial.miss) <= loose * trial.slope * trial.length) {
      return;
    }
    if (trial.miss >= 0.0) {
      above = std::min(above, trial.length);
    } else if (trial.length > below) {
      below = trial.length;
      below_slope = trial.slope;
    }
  }

  /// Of a trial past the fold. Between `below` and there E(h) has an extremum; where the parabola through both slopes
  /// puts it decides whether there is a root before it.
  [[nodiscard]] bool turns_before_root(const Trial& trial, double tolerance) const {
    const double curvature = (below_slope - trial.slope) / (trial.length - below);
    const double rise = 0.5 * trial.slope * trial.slope / curvature;
    const bool resolved = below > 0.0 && curvature > 0.0 && rise < 0.25 * std::abs(trial.miss);
    return trial.miss < 0.0 && resolved && trial.miss + rise < -tolerance;
  }
  /// A length before the fold, from a trial past it.
  [[nodiscard]] double before_fold(const Trial& trial) const {
    const double extremum = below + (trial.length - below) * below_slope / (below_slope - trial.slope);
    return below > 0.0 && extremum > below && extremum < trial.length ? extremum : 0.5 * (below + trial.length);
  }
};

/// dE/dh as trials correct it. A scheme may take its slope from a matrix that is a little out of date, and a lattice
/// knows it to leading order only, which is far off where Γ is small. Where it is nearly right the secant itself
/// serves, moved by the curvature that slopes to leading order show as well; elsewhere secants that stand out from the
/// errors of their ends correct it.
///
/// All of it by h^s, on which E_k depends linearly to leading order, with the slope s h^(s-1) of the present length
/// taken out.
class SlopeOfTrials {
public:
  SlopeOfTrials(int order, bool to_leading_order) : order_(order), to_leading_order_(to_leading_order) {}

  /// Newton's next length after a trial; `stalls`: Newton's steps that brought no improvement.
  double next_length(const Trial& now, int stalls, double rounding) {
    const double unit = now.length / order_;  // h^s over its derivative
    const double rise = now.miss - last_.miss;
    const double secant = rise / (unit * (1.0 - std::pow(last_.length / now.length, order_)));
    const double last_here = last_.slope * std::pow(now.length / last_.length, order_ - 1);  // the last slope, moved
    const double mean = 0.5 * (now.slope + last_here);
    const bool agrees = stalls == 0 && last_.length > 0.0 && secant > 0.8 * now.slope && secant < 1.25 * now.slope;
    const bool both_full = now.full && last_.full;
    const double error = both_full ? 2.0 * rounding : loose * now.slope * now.length;
    if (last_.length > 0.0 && secant > 0.0 && std::abs(rise) > 100.0 * error) {
      const double ratio = secant / mean;
      correction_ = ratio > 0.8 && ratio < 1.25 ? 1.0 : ratio;
    }
    const double bend = to_leading_order_ ? now.slope / mean : 1.0;
    // Where Newton's steps have stalled, the secant between two solved steps is the truth as far as rounding lets it
    // be.
    const bool measured = stalls > 0 && both_full && secant > 0.0 && std::abs(rise) > error;
    const double slope = measured ? secant : agrees ? bend * secant : correction_ * now.slope;
    last_ = now;
    const double next = now.length * std::pow(std::max(0.0, 1.0 - now.miss / (slope * unit)), 1.0 / order_);
    return std::clamp(next, 0.5 * now.length, 2.0 * now.length);
  }

private:
  int order_;
  bool to_leading_order_;
  Trial last_;               ///< before the fold
  double correction_ = 1.0;  ///< secant over slope, where the slope is found to be off
};

}  // namespace

Status TimeLevels::solve_level(double guess) {
  const double side = sign(guess);
  const double target = scheme_.energy_target().value_or(energy_);
  const double tolerance = solved_to();
  const double longest = largest_ratio * std::abs(guess);
  const double shortest = std::abs(guess) / largest_ratio;

  RootBracket bracket;
  SlopeOfTrials slopes(scheme_.order(), scheme_.slope_to_leading_order());
  const bool full = scheme_.solves_fully();
  Trial now{.length = std::abs(guess), .full = full};
  double best = infinity;
  bool newton = true;  // whether this length came from the last slope, not from halving a bracket
  int stalls = 0;      // such trials in a row that brought no improvement
  bool reopened = false;
  Status failure = Status::singular;

  for (int trial = 0; trial < most_trials; ++trial) {
    const Status status = scheme_.advance(side * now.length, now.full ? 0.0 : loose);
    if (status != Status::success) {
      failure = status;
      bracket.blocked = now.length;
      newton = false;
      now = {.length = 0.5 * (bracket.below + now.length), .full = full};
      if (now.length < shortest) {
        return failure;
      }
      continue;
    }
    now.miss = direction_ * (scheme_.discrete_energy() - target);
    now.slope = direction_ * side * scheme_.discrete_energy_slope();
    if (!std::isfinite(now.miss) || !std::isfinite(now.slope)) {
      return Status::undefined;
    }

    if (now.slope <= 0.0) {  // past the fold
      bracket.fold = std::min(bracket.fold, now.length);
      if (bracket.turns_before_root(now, tolerance)) {
        return bracket.blocked < infinity ? failure : Status::singular;
      }
      if (now.length - bracket.below < 1e-10 * now.length) {
        return Status::singular;
      }
      newton = false;
      now = {.length = bracket.before_fold(now), .full = full};
      if (now.length < shortest) {
        return Status::singular;
      }
      continue;
    }

    // Met, or as near as rounding inside H allows: Newton's own correction, too, no longer improves it, or no length is
    // left between those known to be too short and too long.
    const double miss = std::abs(now.miss);
    const bool worse = now.full && miss >= 0.5 * best;
    stalls = worse ? stalls + (newton ? 1 : 0) : 0;
    const bool closed = worse && bracket.is_closed(now.length);
    if (stalls >= 2 || closed) {
      measure(side * now.length);  // rounding may be more than at the last level
    }
    const bool stagnated = (stalls >= 2 || closed) && miss <= std::max(options_.tolerance * energy_scale_,
                                                                       rounding_ + epsilon * now.slope * now.length);
    if (now.full && (miss <= tolerance || stagnated)) {
      trial_step_ = side * now.length;
      return Status::success;
    }
    if (closed && !reopened) {
      reopened = true;
      bracket.reopen();
      best = infinity;
      stalls = 0;
    }
    if (!now.full && miss <= tolerance) {
      now.full = true;  // met already: the same length again, solved to stagnation
      continue;
    }
    bracket.add(now);
    if (now.full) {
      best = std::min(best, miss);
    }

    double next = slopes.next_length(now, stalls, rounding_);
    const double upper = bracket.upper();
    newton = next > bracket.below && next < upper;
    if (!newton && upper == bracket.fold && bracket.above == infinity && now.miss < 0.0) {
      // Newton points past the fold: only a parabola that turns before the root can say no.
      next = 0.5 * (bracket.below + bracket.fold);
      if (bracket.fold - bracket.below < 1e-10 * bracket.fold) {
        return Status::singular;
      }
    } else if (!newton && std::isfinite(upper)) {
      next = 0.5 * (bracket.below + upper);
    }
    if (next > longest || next < shortest) {
      return Status::singular;
    }
    // Once the correction is small the step is solved to stagnation, and the next miss is judged.
    now.full = now.full || std::abs(next - now.length) < 1e-4 * now.length;
    now.length = next;
  }
  return failure == Status::singular ? Status::not_converged : failure;
}

}  // namespace rubato
