#include <algorithm>
#include <array>
#include <cmath>

#include <rubato/variation/sign.hpp>
#include <rubato/variation/time_levels.hpp>
#include <rubato/variation/tuning.hpp>

// Where Γ changes sign the step equation loses its solution (theory, section 3). The node law continues through that
// set,
//
//     H(z_k) - E = c·sign(Γ(z_k))|Γ(z_k)|^(1/(s+1)),   c fixed by the first step for the whole run,
//
// so a bridge is a plain step of (3.3) whose length is chosen so that the node law is met beyond the zero, one ordinary
// step after the bridge's end: at the end itself the law has an error of a few per cent. With the reversible rule c is
// read in the same way before the bridge; which bridge is taken, bridge_choice.cpp says.

namespace rubato {

namespace {

using namespace tuning;

/// Whether a bridge may lead from one of these Γ to the other.
bool balanced(double from, double to) {
  return from * to < 0.0 && std::abs(from) <= largest_imbalance * std::abs(to) &&
         std::abs(to) <= largest_imbalance * std::abs(from);
}

}  // namespace

bool TimeLevels::crossing_is_near(const StepReport& step) {
  if (std::abs(step.h) > sudden_growth * std::abs(regular_step_)) {
    return true;
  }
  if (step.status != Status::success) {
    return remembered_ > 1 && density_at(time_.value() + 2.0 * regular_step_) * history_[0].density <= 0.0;
  }
  const double here = scheme_.node().gamma;
  const double next = scheme_.trial_node().gamma;
  // Γ(t) by divided differences over the last level, this one and the next: does it change sign soon after the next?
  const double slope = (next - here) / step.h;
  const double curvature =
      std::isnan(last_node_.gamma) ? 0.0 : (slope - (here - last_node_.gamma) / last_step_) / (step.h + last_step_);
  return std::ranges::any_of(look_ahead, [&](double ratio) {
    const double ahead = ratio * step.h;
    return (here + ahead * (slope + (ahead - step.h) * curvature)) * here <= 0.0;
  });
}

/// sign(Γ)|Γ|^(1/(s+1)), and h^s carries the sign of h.
double TimeLevels::law_power(double gamma) const {
  const double orientation = scheme_.order() % 2 == 0 ? 1.0 : sign(regular_step_);
  return orientation * sign(gamma) * std::pow(std::abs(gamma), 1.0 / (scheme_.order() + 1.0));
}

double TimeLevels::law_defect(const NodeEnergy& node) const {
  return node.energy - energy_ - law_constant_ * law_power(node.gamma);
}

/// Where the amplitude before a bridge from the present level is read: at the level before, as the amplitude after the
/// bridge is at the level after its end.
NodeEnergy TimeLevels::law_node() {
  const NodeEnergy here = scheme_.node();
  return remembered_ > 0 && last_node_.gamma * here.gamma > 0.0 ? last_node_ : here;
}

/// The reversible rule: the law's constant is the amplitude at this node.
void TimeLevels::measure_law(const NodeEnergy& node) {
  if (options_.bridge == BridgeRule::anchored) {
    return;
  }
  const double measured = (node.energy - energy_) / law_power(node.gamma);
  if (measured > law_constant_ / largest_change && measured < law_constant_ * largest_change) {
    const double s = scheme_.order();
    law_constant_ = measured;
    step_constant_ = std::pow(24.0 / (s + 1.0) * measured, (s + 1.0) / s);
  }
}

/// The end of `count` plain steps of length h. Leaves the scheme at the present level.
std::optional<NodeEnergy> TimeLevels::plain_end(double h, int count, double accuracy) {
  StateWriter before(StateWriter::For::going_back);
  if (count > 1) {
    scheme_.save(before);
  }
  std::optional<NodeEnergy> end;
  for (int i = 1; i <= count; ++i) {
    if (scheme_.advance(h, accuracy) != Status::success) {
      break;
    }
    const NodeEnergy node = scheme_.trial_node();
    if (!std::isfinite(node.energy) || !(std::abs(h) <= longest_for_gamma * law_step(node.gamma))) {
      break;
    }
    if (i == count) {
      end = node;
    } else {
      scheme_.accept();
    }
  }
  if (count > 1) {
    StateReader reader(before);
    scheme_.restore(reader);
  }
  return end;
}

/// Looks for the shortest `count` equal plain steps that end on the node law and after which the step equation has a
/// solution; when `crossing`, on the other side of zero.
std::optional<TimeLevels::Bridge> TimeLevels::find_bridge(int count, bool crossing) {
  const double here = scheme_.node().gamma;
  const double unit = plain_length();
  std::optional<NodeEnergy> previous;
  double previous_h = 0.0;
  for (const double ratio : lengths) {
    const double h = ratio * unit;
    const std::optional<NodeEnergy> node = plain_end(h, count, trial_accuracy);
    if (!node) {
      return std::nullopt;
    }
    const double miss = std::abs(law_defect(*node) / (node->energy - energy_ - law_defect(*node)));
    if (!crossing && miss < nearest_.miss) {
      nearest_ = Bridge{.h = h, .count = count, .end = *node, .miss = miss};
    }
    if (previous) {
      const bool across = !crossing || node->gamma * here < 0.0;
      const double defect = law_defect(*node);
      const double previous_defect = law_defect(*previous);
      if (across && defect * previous_defect <= 0.0) {
        std::optional<Bridge> bridge = refine_bridge(count, previous_h, previous_defect, h, defect);
        if (bridge && (!crossing || balanced(here, bridge->end.gamma)) && law_holds_after(*bridge)) {
          polish(*bridge);
          return bridge;
        }
      }
    }
    previous = node;
    previous_h = h;
  }
  return std::nullopt;
}

/// Zero of the law defect between two lengths at which it has opposite signs (Illinois variant of false position).
std::optional<TimeLevels::Bridge> TimeLevels::refine_bridge(int count, double near_h, double near_defect, double far_h,
                                                            double far_defect) {
  Bridge bridge;
  bridge.count = count;
  for (int iteration = 0; iteration < 60; ++iteration) {
    bridge.h = far_h - far_defect * (far_h - near_h) / (far_defect - near_defect);
    const std::optional<NodeEnergy> node = plain_end(bridge.h, count, 0.0);
    if (!node) {
      return std::nullopt;
    }
    bridge.end = *node;
    const double defect = law_defect(*node);
    bridge.slope = (far_defect - near_defect) / (far_h - near_h);
    if (std::abs(defect) <= solved_to() || std::abs(far_h - near_h) <= 1e-14 * std::abs(far_h)) {
      return bridge;
    }
    if (defect * far_defect < 0.0) {
      near_h = far_h;
      near_defect = far_defect;
    } else {
      near_defect *= 0.5;
    }
    far_h = bridge.h;
    far_defect = defect;
  }
  return bridge;
}

/// What the step law predicts after the bridge.
double TimeLevels::step_after(const Bridge& bridge) const {
  return std::min(law_step(bridge.end.gamma), std::abs(bridge.h)) * sign(bridge.h);
}

/// Whether the ordinary step equation has a solution from the end of the bridge, and which. Leaves the scheme at the
/// present level.
bool TimeLevels::law_holds_after(Bridge& bridge) {
  StateWriter before(StateWriter::For::going_back);
  scheme_.save(before);
  const double direction = direction_;
  bool holds = true;
  for (int i = 0; i < bridge.count && holds; ++i) {
    holds = scheme_.advance(bridge.h, 0.0) == Status::success;
    if (holds) {
      scheme_.accept();
    }
  }
  if (holds) {
    bridge.end = scheme_.node();
    set_direction(bridge.end.gamma);
    const StepReport after = ordinary_step(step_after(bridge));
    holds = after.status == Status::success;
    if (holds) {
      bridge.after = after.h;
      bridge.next = scheme_.trial_node();
    }
  }
  direction_ = direction;
  StateReader reader(before);
  scheme_.restore(reader);
  return holds;
}

/// The node law has an error of a few per cent at the end of a bridge, and of a thousandth one step later (the terms it
/// leaves out fall off like the 8/3rd power of the distance from the zero): lengthens or shortens the bridge so that
/// the law is met there.
void TimeLevels::polish(Bridge& bridge) {
  const auto matters = [&](const Bridge& candidate) {
    return candidate.next.gamma * candidate.end.gamma > 0.0 &&
           std::abs(candidate.next.gamma) > std::abs(candidate.end.gamma);
  };
  if (!matters(bridge)) {
    return;
  }
  double defect = law_defect(bridge.next);
  double slope = bridge.slope * law_power(bridge.next.gamma) / law_power(bridge.end.gamma);
  const double enough = solved_to();
  double shortening = 1.0;
  for (int iteration = 0; iteration < most_polishing && std::abs(defect) > enough; ++iteration) {
    Bridge other = bridge;
    other.h -= shortening * std::clamp(defect / (slope * bridge.h), -longest_polish, longest_polish) * bridge.h;
    if (other.h == bridge.h) {
      return;
    }
    if (!law_holds_after(other) || other.end.gamma * bridge.end.gamma <= 0.0 || !matters(other)) {
      shortening *= 0.5;
      continue;
    }
    const double other_defect = law_defect(other.next);
    slope = (other_defect - defect) / (other.h - bridge.h);
    shortening = 1.0;
    if (std::abs(other_defect) < std::abs(defect)) {
      defect = other_defect;
      bridge = other;
    } else if (std::abs(other.h - bridge.h) < stagnation_polish * std::abs(bridge.h)) {
      return;
    }
  }
}

StepReport TimeLevels::flagged(StepReport result) {
  if (result.status == Status::success && std::abs(result.energy - energy_) > another_energy * law_scale_) {
    result.status = Status::not_converged;  // the motion blows up: there is nothing beyond
  }
  if (result.status == Status::success) {
    result.bridged = true;
    result.crossing = !singular_;
    singular_ = true;
    result.gamma_from_slope = !scheme_.has_gamma();
    result.gamma_before = result.gamma_from_slope ? slope_gamma_[0] : scheme_.node().gamma;
    result.gamma_after = result.gamma_from_slope ? gamma_of(result) : scheme_.trial_node().gamma;
    take(result);
  }
  return result;
}

/// The next plain step of the bridge under way; after its last one the energy law is on again.
StepReport TimeLevels::bridge_step() {
  StepReport result = flagged(plain_step(bridge_.h));
  if (result.status == Status::success && --bridge_.count == 0) {
    singular_ = false;
    set_direction(bridge_.end.gamma);
    remembered_ = 0;
    regular_step_ = step_after(bridge_);
  }
  return result;
}

/// The ordinary step from here does not exist, or comes near the zero of Γ: bridge from here, or from its end.
StepReport TimeLevels::singular_step(const StepReport& ordinary) {
  if (options_.on_singular == OnSingular::fixed) {
    return wait_step();
  }
  const bool exists = ordinary.status == Status::success;
  const NodeEnergy next = exists ? scheme_.trial_node() : NodeEnergy{};
  const bool same_side = exists && next.gamma * scheme_.node().gamma > 0.0;
  measure_law(law_node());
  const std::optional<Bridge> bridge = find_bridge(1, true);
  if (same_side && !(bridge && bridge_now(*bridge, ordinary, next))) {
    // The looking around has left the scheme elsewhere, and another solution of the value equations may be nearer now.
    StepReport result = ordinary_step(ordinary.h);
    if (result.status == Status::success) {
      take_ordinary(result);
      return result;
    }
  }
  return bridge ? start_bridge(*bridge) : long_bridge();
}

StepReport TimeLevels::start_bridge(const Bridge& bridge) {
  bridge_ = bridge;
  waited_ = 0;
  return bridge_step();
}

/// A bridge of several equal steps, the fewest for which its end meets the law. Where steps are so coarse that none
/// does, the one that comes nearest: the amplitude of H - E is then off until the next bridge, which asks for the same
/// c again. Else a plain step, to look again from its end.
StepReport TimeLevels::long_bridge() {
  nearest_ = Bridge{};
  nearest_.miss = largest_miss;
  for (const int count : counts) {
    if (const std::optional<Bridge> bridge = find_bridge(count, false)) {
      return start_bridge(*bridge);
    }
  }
  if (nearest_.count > 0 && law_holds_after(nearest_)) {
    return start_bridge(nearest_);
  }
  return waiting_step();
}

/// The last regular step, or what the step law asks for here if that is shorter: Γ may be large by now. Where no bridge
/// is found, and Γ falls by powers of ten meanwhile, plain steps grow with the law's. Without a node law there is
/// nothing to grow by.
double TimeLevels::plain_length() const {
  if (!scheme_.has_node_law()) {
    return regular_step_;
  }
  const double longest = waited_ > 0 ? largest_growth * std::abs(last_step_) : std::abs(regular_step_);
  return std::min(longest, law_step(scheme_.node().gamma)) * sign(regular_step_);
}

StepReport TimeLevels::waiting_step() {
  // Over a plain step of κ times the law's length the defect of the node law changes by (κ² - 1) h² ΔΓ/24: as Γ grows,
  // steer it to zero; as Γ shrinks, keep it.
  const double gamma = scheme_.node().gamma;
  double length = plain_length();
  double best = length;
  double smallest = std::numeric_limits<double>::infinity();
  for (int halving = 0; halving < 10 && smallest == std::numeric_limits<double>::infinity(); ++halving) {
    for (const double ratio : waiting_lengths) {
      const std::optional<NodeEnergy> end = plain_end(ratio * length, 1, trial_accuracy);
      if (!end) {
        continue;
      }
      const bool outward = end->gamma * (end->gamma - gamma) > 0.0;
      const double defect = outward ? std::abs(law_defect(*end)) : std::abs(ratio - 1.0);
      if (defect < smallest) {
        smallest = defect;
        best = ratio * length;
      }
    }
    length *= 0.5;
  }
  return flagged(plain_step(best));
}

/// An ordinary step from here, after plain ones, if it differs from what the law asks for with the run's own constant
/// by less than the factor `misfit`: one farther off would let the amplitude of H - E wander away.
std::optional<StepReport> TimeLevels::resumed_step(double misfit) {
  double expected = std::abs(regular_step_);
  if (scheme_.has_node_law()) {
    const NodeEnergy here = scheme_.node();
    set_direction(here.gamma);
    expected = law_step(here.gamma);
  } else if (std::isfinite(slope_gamma_[0])) {
    set_direction(slope_gamma_[0]);  // of the plain step before: the law may hold again beyond the zero
  }
  StepReport result = ordinary_step(std::min(expected, std::abs(regular_step_)) * sign(regular_step_));
  const bool fits = std::abs(result.h) > expected / misfit && std::abs(result.h) < expected * misfit;
  if (result.status != Status::success || !fits) {
    return std::nullopt;
  }
  singular_ = false;
  waited_ = 0;
  remembered_ = 0;
  take_ordinary(result);
  return result;
}

/// Between two steps that meet the law: go on with the bridge under way, or see whether the law can be met again.
StepReport TimeLevels::wait_step() {
  if (bridge_.count > 0) {
    return bridge_step();
  }
  const bool bridging = options_.on_singular == OnSingular::bridge;
  if (bridging) {
    if (const std::optional<Bridge> bridge = find_bridge(1, false)) {
      return start_bridge(*bridge);
    }
  }
  if (singular_ && (!bridging || waited_ >= longest_wait)) {
    const double misfit = bridging && waited_ >= 2 * longest_wait ? largest_misfit * largest_misfit : largest_misfit;
    if (std::optional<StepReport> resumed = resumed_step(misfit)) {
      return *resumed;
    }
  }
  ++waited_;
  return waiting_step();
}

}  // namespace rubato
