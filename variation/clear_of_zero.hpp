#pragma once

#include <algorithm>
#include <cmath>

namespace rubato {

/// True if a function with these values at both ends of a step, and these rates by the fraction of it, is one that
/// CrossingSearch neither finds a zero of there nor looks at in between: of one sign, and clear of zero by more than a
/// fourth of how much its cubic varies. Of that cubic no value is farther from the line between the ends than
///
///     d = 4/27 (|rate_0 - change| + |rate_1 - change|),
///
/// s(1 - s)² being 4/27 at most: it does not come to zero nearer than min|g| - d, and varies by |change| + 2d at most.
/// Rates that are no numbers say no.
[[nodiscard]] inline bool is_clear_of_zero(double from, double rate_0, double to, double rate_1) {
  const double change = to - from;
  const double off = 4.0 / 27.0 * (std::abs(rate_0 - change) + std::abs(rate_1 - change));
  // min|g| - d > (|change| + 2d)/4, with room for rounding.
  return from * to > 0.0 && std::min(std::abs(from), std::abs(to)) > 0.26 * std::abs(change) + 1.6 * off;
}

}  // namespace rubato
