#include <algorithm>
#include <cmath>

#include <rubato/variation/time_levels.hpp>

// Which of two bridges across a zero of Γ is taken: the one from the present level, or the one from the end of the
// ordinary step that still exists there.
//
// For the reversible rule the choice has to be undone by a run backward. Call R the ordinary step towards the zero, B
// the bridge, S the ordinary step away from it. From a level a the two ways are S∘B and B∘R. A run that takes B where
// S∘B is the shorter takes it from the levels between a curve Y, where both ways take the same time, and R(Y); their
// bridges end between B(R(Y)) and B(Y), which S carries into each other as far as the two ways, that take the same time
// on Y, also end in the same state. So each orbit beyond the zero is met once, but for those in a strip as thin as the
// amplitude of H - E is uncertain, 1e-4 of all. A run backward asks what the run forward would have done.

namespace rubato {

template <typename Judge>
bool TimeLevels::seen_after(double h, bool otherwise, const Judge& judge) {
  StateWriter before(StateWriter::For::going_back);
  scheme_.save(before);
  save(before);
  bool verdict = otherwise;
  if (scheme_.advance(h, 0.0) == Status::success) {
    scheme_.accept();
    verdict = judge();
  }
  StateReader reader(before);
  scheme_.restore(reader);
  restore(reader);
  return verdict;
}

/// Whether to take the bridge from here, though the ordinary step exists and stays on this side of the zero.
///
/// Anchored: if it is more centred on the zero than a bridge from the end of the ordinary step would be. Reversible: if
/// it and the ordinary step after it take less time than the ordinary step and the bridge from its end; a run backward
/// in time asks what the run forward would have done at the far end of the bridge.
bool TimeLevels::bridge_now(const Bridge& bridge, const StepReport& ordinary, const NodeEnergy& next) {
  if (options_.bridge == BridgeRule::reversible) {
    return regular_step_ > 0.0 || remembered_ == 0 ? is_sooner(bridge.h + bridge.after, ordinary.h)
                                                   : is_way_back(bridge);
  }
  const double here = scheme_.node().gamma;
  const double rate = (bridge.end.gamma - here) / bridge.h;
  const double centre_next = std::abs(next.gamma + bridge.end.gamma + rate * ordinary.h);
  return std::abs(here + bridge.end.gamma) <= centre_next;
}

/// Whether a bridge and the step after it, of this length together, are shorter than an ordinary step and the bridge
/// from its end.
bool TimeLevels::is_sooner(double bridge_and_step, double ordinary) {
  const NodeEnergy here = scheme_.node();
  return seen_after(ordinary, true, [&] {
    measure_law(here);
    const std::optional<Bridge> later = find_bridge(1, true);
    return !later || std::abs(bridge_and_step) < std::abs(ordinary + later->h);
  });
}

/// For a run backward in time: whether a run forward would take this bridge from its far end to the present level, and
/// not one from the level before that end.
bool TimeLevels::is_way_back(const Bridge& bridge) {
  return seen_after(bridge.h, false, [&] { return !is_bridged_before(bridge) && is_bridged_at_end(bridge); });
}

/// From the far end of a bridge backward in time: whether a run forward would rather bridge from the level before it.
bool TimeLevels::is_bridged_before(const Bridge& bridge) {
  return seen_after(bridge.after, false, [&] {
    last_step_ = regular_step_ = bridge.after;
    set_direction(scheme_.node().gamma);
    if (ordinary_step(bridge.after).status != Status::success) {
      return false;
    }
    measure_law(scheme_.trial_node());
    last_step_ = regular_step_ = -bridge.after;
    const std::optional<Bridge> earlier = find_bridge(1, true);
    return earlier && std::abs(earlier->h + earlier->after) < std::abs(bridge.after + bridge.h);
  });
}

/// From the far end of a bridge backward in time: whether a run forward would take it there, not an ordinary step.
bool TimeLevels::is_bridged_at_end(const Bridge& bridge) {
  const NodeEnergy far = scheme_.node();
  const double bridge_and_step = bridge.h + last_step_;
  last_step_ = regular_step_ = -bridge.after;
  set_direction(far.gamma);
  const StepReport ordinary = ordinary_step(std::min(law_step(far.gamma), 2.0 * regular_step_));
  const bool same_side = ordinary.status == Status::success && scheme_.trial_node().gamma * far.gamma > 0.0;
  return !same_side || is_sooner(bridge_and_step, ordinary.h);
}

}  // namespace rubato
