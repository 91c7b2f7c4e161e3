#pragma once

#include <cmath>

namespace rubato {

/// A running sum with its rounding error carried along (Neumaier's variant of Kahan's algorithm): the value is
/// high + low, with an error of one rounding of the result plus O(n ε²) of the terms.
struct CompensatedSum {
  double high = 0.0;
  double low = 0.0;

  constexpr CompensatedSum() = default;
  constexpr explicit CompensatedSum(double value, double rest = 0.0) : high(value), low(rest) {}

  void add(double term) {
    const double sum = high + term;
    low += std::abs(high) >= std::abs(term) ? (high - sum) + term : (term - sum) + high;
    high = sum;
  }

  void add(const CompensatedSum& other) {
    add(other.high);
    low += other.low;
  }

  /// Moves what the low part can give into the high part, so that `high` is the rounded value of the sum.
  void normalize() {
    const double sum = high + low;
    low -= sum - high;
    high = sum;
  }

  /// An infinity, or NaN, where terms or partial sums are not finite.
  [[nodiscard]] double value() const { return std::isfinite(high) ? high + low : high; }
};

}  // namespace rubato
