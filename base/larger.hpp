#pragma once

#include <cmath>

namespace rubato {

/// The larger of both, and undefined once one of them is: std::max would pass over a value that is not a number, so
/// that a quantity could look conserved where it was not even defined.
[[nodiscard]] inline double larger(double a, double b) {
  return std::isnan(a) || a >= b ? a : b;
}

}  // namespace rubato
