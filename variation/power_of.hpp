#pragma once

#include <cmath>

namespace rubato {

/// x^n, n ≥ 0, by products: n - 1 roundings at most.
[[nodiscard]] inline double power_of(double x, int n) {
  double result = 1.0;
  for (; n > 0; n /= 2, x *= x) {
    result *= n % 2 != 0 ? x : 1.0;
  }
  return result;
}

/// x^p, x ≥ 0, likewise where p is whole, as it nearly always is: pow() would take a quarter of the time of a step.
[[nodiscard]] inline double power_of(double x, double p) {
  constexpr double most = 64.0;
  const int whole = p >= 0.0 && p <= most ? static_cast<int>(p) : -1;
  return whole == p ? power_of(x, whole) : std::pow(x, p);
}

}  // namespace rubato
