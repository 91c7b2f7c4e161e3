#include <algorithm>
#include <array>
#include <cmath>

#include <rubato/variation/time_levels.hpp>

// Where Γ changes sign the step equation loses its solution (theory, section 3). The node law continues through that
// set,
//
//     H(z_k) - E = c·sign(Γ(z_k))|Γ(z_k)|^(1/(s+1)),   c fixed by the first step for the whole run,
//
// so a bridge is a plain step of (3.3) whose length is chosen so that its *end* meets the node law; after it the
// ordinary step equation has a solution again, with the same E. Choosing c anew instead would let the amplitude of
// H - E random-walk.

namespace rubato {

namespace {

/// A step this many times longer than the one before tells that Γ is about to vanish, or of a root beyond its zero.
constexpr double sudden_growth = 1.5;
/// Accuracy asked of trial steps while a bridge is being looked for.
constexpr double trial_accuracy = 1e-9;
/// Lengths tried for the n equal steps of a bridge, in units of the last regular step. Over plain steps of length κh
/// H changes by (κh)²ΔΓ/24; from Γ to -Γ the node law asks for 2(h²/8)Γ, that is κ = √3, and for a return to the same Γ
/// (Γ only touches zero) any κ but 1 will do: at κ = 1 the law is met to second order, and not crossed.
constexpr std::array lengths = {0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.25, 2.5, 2.75, 3.0, 3.3, 3.6};
/// A plain step longer than this, relative to what the step law asks for at its ends, does not belong to a bridge: Γ is
/// large there, and the law must be met before.
constexpr double longest_for_gamma = 3.5;
/// Steps tried while no bridge is found, relative to the step law: whichever leaves the smallest defect of the node
/// law.
constexpr std::array waiting_lengths = {0.6, 1.0, 1.5};
/// How far the end of a bridge may be off the node law, relative to H - E, where none meets it.
constexpr double largest_miss = 0.5;
/// With `fixed`, the first step that meets the energy law again may differ from the step law by this factor.
constexpr double largest_misfit = 1.5;
/// Numbers of steps tried where no single step leads across.
constexpr std::array counts = {1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32};

double sign(double x) {
  return x < 0.0 ? -1.0 : 1.0;
}

}  // namespace

bool TimeLevels::crossing_is_near(const StepReport& step) {
  const bool grown = std::abs(step.h) > sudden_growth * std::abs(regular_step_);
  if (grown || (step.status == Status::success && scheme_.trial_node().gamma * scheme_.node().gamma <= 0.0)) {
    return true;
  }
  if (remembered_ < 2) {
    return false;
  }
  // Γ ∝ density, extrapolated as the predictor does: does it change sign within the next steps?
  for (const double ahead : {0.5, 1.0, 1.5, 2.0, 2.5, 3.0}) {
    if (density_at(time_.value() + ahead * regular_step_) * history_[0].density <= 0.0) {
      return true;
    }
  }
  return false;
}

double TimeLevels::law_defect(const LevelNode& node) const {
  const double exponent = 1.0 / (scheme_.order() + 1.0);
  const double orientation = scheme_.order() % 2 == 0 ? 1.0 : sign(regular_step_);  // h^s carries the sign of h
  return node.energy - energy_ -
         orientation * law_constant_ * sign(node.gamma) * std::pow(std::abs(node.gamma), exponent);
}

/// The end of `count` plain steps of length h. Leaves the scheme at the present level.
std::optional<LevelNode> TimeLevels::plain_end(double h, int count) {
  StateWriter before;
  if (count > 1) {
    scheme_.save(before);
  }
  std::optional<LevelNode> end;
  for (int i = 1; i <= count; ++i) {
    if (scheme_.advance(h, trial_accuracy) != Status::success) {
      break;
    }
    const LevelNode node = scheme_.trial_node();
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
    StateReader reader(before.values());
    scheme_.restore(reader);
  }
  return end;
}

/// Looks for the shortest `count` equal plain steps that end on the node law and after which the step equation has a
/// solution; when `crossing`, on the other side of zero.
std::optional<TimeLevels::Bridge> TimeLevels::find_bridge(int count, bool crossing) {
  const double here = scheme_.node().gamma;
  const double unit = plain_length();
  std::optional<LevelNode> previous;
  double previous_h = 0.0;
  for (const double ratio : lengths) {
    const double h = ratio * unit;
    const std::optional<LevelNode> node = plain_end(h, count);
    if (!node) {
      return std::nullopt;
    }
    const double miss = std::abs(law_defect(*node) / (node->energy - energy_ - law_defect(*node)));
    if (!crossing && miss < nearest_.miss) {
      nearest_ = Bridge{h, count, *node, miss};
    }
    if (previous) {
      const bool across = !crossing || node->gamma * here < 0.0;
      const double defect = law_defect(*node);
      const double previous_defect = law_defect(*previous);
      if (across && defect * previous_defect <= 0.0) {
        const std::optional<Bridge> bridge = refine_bridge(count, previous_h, previous_defect, h, defect);
        if (bridge && (!crossing || bridge->end.gamma * here < 0.0) && law_holds_after(*bridge)) {
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
    const std::optional<LevelNode> node = plain_end(bridge.h, count);
    if (!node) {
      return std::nullopt;
    }
    bridge.end = *node;
    const double defect = law_defect(*node);
    if (std::abs(defect) <= 0.1 * options_.tolerance * energy_scale_ ||
        std::abs(far_h - near_h) <= 1e-14 * std::abs(far_h)) {
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

/// Whether the ordinary step equation has a solution from the end of the bridge. Leaves the scheme at the present
/// level.
bool TimeLevels::law_holds_after(const Bridge& bridge) {
  StateWriter before;
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
    set_direction(bridge.end.gamma);
    holds = ordinary_step(step_after(bridge)).status == Status::success;
  }
  direction_ = direction;
  StateReader reader(before.values());
  scheme_.restore(reader);
  return holds;
}

StepReport TimeLevels::flagged(StepReport result) {
  if (result.status == Status::success) {
    result.bridged = true;
    result.crossing = !singular_;
    singular_ = true;
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

/// The ordinary step from here does not exist, or comes near the zero of Γ: bridge from here or from its end, whichever
/// bridge is the more centred on the zero.
StepReport TimeLevels::singular_step(StepReport ordinary) {
  if (options_.on_singular == OnSingular::fixed) {
    return wait_step();
  }
  const LevelNode here = scheme_.node();
  const bool exists = ordinary.status == Status::success;
  const LevelNode next = exists ? scheme_.trial_node() : here;
  const bool same_side = exists && next.gamma * here.gamma > 0.0;
  std::optional<Bridge> bridge = find_bridge(1, true);
  bool from_here = bridge.has_value();
  if (bridge && same_side) {
    const double rate = (bridge->end.gamma - here.gamma) / bridge->h;
    const double centre_here = std::abs(here.gamma + bridge->end.gamma);
    const double centre_next = std::abs(next.gamma + bridge->end.gamma + rate * ordinary.h);
    from_here = centre_here <= centre_next;
  }
  if (!from_here && same_side) {
    StepReport result = plain_step(ordinary.h);
    if (result.status == Status::success) {
      take_ordinary(result);
    }
    return result;
  }
  return bridge ? start_bridge(*bridge) : long_bridge();
}

StepReport TimeLevels::start_bridge(const Bridge& bridge) {
  bridge_ = bridge;
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

/// The last regular step, or what the step law asks for here if that is shorter: Γ may be large by now.
double TimeLevels::plain_length() const {
  return std::min(std::abs(regular_step_), law_step(scheme_.node().gamma)) * sign(regular_step_);
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
      const std::optional<LevelNode> end = plain_end(ratio * length, 1);
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

/// Between two steps that meet the law: go on with the bridge under way, or see whether the law can be met again.
StepReport TimeLevels::wait_step() {
  if (bridge_.count > 0) {
    return bridge_step();
  }
  if (options_.on_singular == OnSingular::bridge) {
    const std::optional<Bridge> bridge = find_bridge(1, false);
    return bridge ? start_bridge(*bridge) : waiting_step();
  }
  if (singular_) {
    double expected = std::abs(regular_step_);
    if (scheme_.has_node_law()) {
      const LevelNode here = scheme_.node();
      set_direction(here.gamma);
      expected = law_step(here.gamma);
    }
    StepReport result = ordinary_step(std::min(expected, std::abs(regular_step_)) * sign(regular_step_));
    // A step far from what the law asks for with the run's own constant would let the amplitude of H - E wander off.
    const bool fits = std::abs(result.h) > expected / largest_misfit && std::abs(result.h) < expected * largest_misfit;
    if (result.status == Status::success && fits) {
      singular_ = false;
      remembered_ = 0;
      take_ordinary(result);
      return result;
    }
  }
  return waiting_step();
}

}  // namespace rubato
