#pragma once

namespace rubato {

/// The Legendre polynomial P_n at a point x of (-1, 1), n at least 1, by its recurrence.
struct Legendre {
  using Real = long double;

  Legendre(int degree, Real at) : n(degree), x(at), value(at) {
    for (int k = 2; k <= n; ++k) {
      const Real next = ((2 * k - 1) * x * value - (k - 1) * before) / k;
      before = value;
      value = next;
    }
  }
  /// P'_n; it cancels beside ±1.
  [[nodiscard]] Real slope() const { return n * (x * value - before) / (x * x - 1.0L); }

  int n;
  Real x, value;       ///< P_n(x)
  Real before = 1.0L;  ///< P_{n-1}(x)
};

}  // namespace rubato
