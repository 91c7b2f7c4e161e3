#include <rubato/variation/equal_steps.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning;

/// The same for a potential of one sign, with which η̃ = side · η + μ is positive.
double gain_with(const LookAhead& look, double side) {
  const double s = look.order;
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (const double eta : look.eta) {
    least = std::min(least, side * eta);
    most = std::max(most, side * eta);
  }
  if (!(most > 0.0) || !(most > least)) {
    return 1.0;
  }
  const double mu = std::max(0.0, -eta_margin * least);
  double mean = 0.0;
  double least_root = std::numeric_limits<double>::infinity(), most_root = 0.0;
  for (std::size_t i = 0; i < look.eta.size(); ++i) {
    const double root = std::pow(side * look.eta[i] + mu, 1.0 / (s + 1.0));
    mean += root * look.time_of(i) / look.duration;
    least_root = std::min(least_root, root);
    most_root = std::max(most_root, root);
  }
  const double following = mean * std::pow((s + 1.0) * (most_root - least_root), 1.0 / s);
  return following > 0.0 ? std::pow(most - least, 1.0 / s) / following : 1.0;
}

}  // namespace

double gain_of_following(const LookAhead& look) {
  return std::max(gain_with(look, 1.0), gain_with(look, -1.0));
}

int turns_of_eta(const LookAhead& look) {
  const double reported = look.least_resolved();
  double extreme = look.eta.front(), direction = 0.0;
  int turns = 0;
  for (const double eta : look.eta) {
    const double moved = eta - extreme;
    if (direction * moved > 0.0) {
      extreme = eta;
    } else if (std::abs(moved) > std::max(turn_of_eta * std::max(std::abs(eta), std::abs(extreme)), reported)) {
      turns += direction == 0.0 ? 0 : 1;
      direction = std::copysign(1.0, moved);
      extreme = eta;
    }
  }
  return turns;
}

bool repeats(const LookAhead& look) {
  double first = 0.0, second = 0.0;  // the largest |η| of either half
  for (std::size_t i = 0; i < look.eta.size(); ++i) {
    double& largest = look.time[i] < 0.5 * look.duration ? first : second;
    largest = std::max(largest, std::abs(look.eta[i]));
  }
  return second <= growth_of_repetition * first && turns_of_eta(look) >= turns_of_repetition;
}

bool equal_steps_do(const LookAhead& look) {
  return (!look.knows_step() || gain_of_following(look) < worth_following) && nearly_equal_steps(look).has_value();
}

std::optional<StepPotential> nearly_equal_steps(const LookAhead& look) {
  const double terms = look.energy_size;
  const double off = look.off(look.largest_eta(), look.step), most = most_stiff_part * terms;
  const bool has_look = look.eta.size() > 1;
  const double least =
      terms * std::max(has_look ? stiff_part : stiff_part_of_first, least_strength_by_tolerance * look.tolerance);
  const bool is_lost = look.first_size > 0.0 && least > most_of_terms * look.first_size;
  if (has_look && (least_stiff_margin * off > most || is_lost)) {
    return std::nullopt;
  }
  const double size = has_look ? std::min(stiff_margin * off, most) : stiff_margin_of_first * off;
  return StepPotential{.strength = rounded_strength(std::copysign(std::max(least, size), look.eta.front())),
                       .length = look.step,
                       .exponent = 4.0 * look.order};
}

bool is_short_run(int order, double first_step, double run_length) {
  return order >= order_with_zeros && run_length < short_run * least_stretch * std::abs(first_step);
}

}  // namespace rubato
