#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

namespace rubato {

/// How far an exact solution is from a run where they have to agree: at the start, and in their first increments, whose
/// difference is the residual of the exact solution in the equation, but for the error of one step.
///@{

/// Below so many roundings of a value an increment has no digits to compare.
constexpr double least_increment = 1e-8;

/// |value - exact| over the scale, if that is larger than `worst`.
inline void compare_exact(double value, double exact, double scale, double& worst) {
  const double relative = value == exact ? 0.0 : std::abs(value - exact) / scale;
  if (std::isfinite(relative) && !(relative <= worst)) {
    worst = relative;
  }
}

/// The same of the increments of arrays, over the largest increment. A formula that does not change in time states
/// values for some later time, as those after a period, and is not compared.
/// \param exact_after a step later, of a scheme of order 1, else empty: half of the second difference is the error of
/// a step, so that a wave that starts from rest faster than it should is not found
inline void compare_increments(std::span<const double> now, std::span<const double> before,
                               std::span<const double> exact, std::span<const double> exact_before,
                               std::span<const double> exact_after, double& worst) {
  double increment = 0.0, size = 0.0, error = 0.0;
  if (std::ranges::equal(exact, exact_before)) {
    return;
  }
  for (std::size_t i = 0; i < now.size(); ++i) {
    const double moved = now[i] - before[i], should = exact[i] - exact_before[i];
    increment = std::max({increment, std::abs(moved), std::abs(should)});
    size = std::max({size, std::abs(now[i]), std::abs(exact[i])});
    const double expected = exact_after.empty() ? 0.0 : 0.5 * std::abs(exact_after[i] - exact[i] - should);
    error = std::max(error, std::abs(moved - should) - expected);
  }
  if (increment > least_increment * size) {
    compare_exact(error, 0.0, increment, worst);
  }
}
inline void compare_increments(double now, double before, double exact, double exact_before, double& worst) {
  compare_increments(std::span(&now, 1), std::span(&before, 1), std::span(&exact, 1), std::span(&exact_before, 1), {},
                     worst);
}
///@}

}  // namespace rubato
