#pragma once

#include <cmath>

namespace audit {

/// Half the distance of neighbouring doubles at 1: the relative error of one operation in double.
inline constexpr long double unit_roundoff = 0x1p-53L;

/// A number in extended precision together with a bound of the error that the same computation makes in double: every
/// operation adds one rounding of its result and passes on the errors of its operands to first order. The rounding of
/// the extended arithmetic itself, 2048 times smaller, is left out.
struct Bounded {
  long double value = 0.0L;
  long double error = 0.0L;

  Bounded() = default;
  Bounded(long double exact) : value(exact) {}  // NOLINT: a constant, exact as written
  Bounded(long double v, long double e) : value(v), error(e) {}

  /// A number that was rounded to double when it was stored.
  static Bounded stored(double x) { return {x, unit_roundoff * std::abs(static_cast<long double>(x))}; }
  static Bounded rounded(long double value, long double error) {
    return {value, error + unit_roundoff * std::abs(value)};
  }

  Bounded operator-() const { return {-value, error}; }
  Bounded& operator+=(const Bounded& other) { return *this = *this + other; }

  friend Bounded operator+(const Bounded& a, const Bounded& b) { return rounded(a.value + b.value, a.error + b.error); }
  friend Bounded operator-(const Bounded& a, const Bounded& b) { return a + (-b); }
  friend Bounded operator*(const Bounded& a, const Bounded& b) {
    return rounded(a.value * b.value, std::abs(a.value) * b.error + std::abs(b.value) * a.error);
  }
  friend Bounded operator/(const Bounded& a, const Bounded& b) {
    const long double quotient = a.value / b.value;
    return rounded(quotient, (a.error + std::abs(quotient) * b.error) / std::abs(b.value));
  }
};

inline long double magnitude(const Bounded& x) {
  return std::abs(x.value);
}

// Elementary functions of a C library are good to two units in the last place or better.
inline Bounded sin(const Bounded& x) {
  const long double s = std::sin(x.value);
  return {s, std::abs(std::cos(x.value)) * x.error + 2 * unit_roundoff * std::abs(s)};
}
inline Bounded cos(const Bounded& x) {
  const long double c = std::cos(x.value);
  return {c, std::abs(std::sin(x.value)) * x.error + 2 * unit_roundoff * std::abs(c)};
}
inline Bounded exp(const Bounded& x) {
  const long double e = std::exp(x.value);
  return {e, e * (x.error + 2 * unit_roundoff)};
}
inline Bounded log(const Bounded& x) {
  const long double l = std::log(x.value);
  return {l, x.error / std::abs(x.value) + 2 * unit_roundoff * std::abs(l)};
}
/// x^a, x > 0
inline Bounded power(const Bounded& x, long double a) {
  const long double p = std::pow(x.value, a);
  return {p, std::abs(p) * (std::abs(a) * x.error / std::abs(x.value) + 2 * unit_roundoff)};
}

}  // namespace audit
