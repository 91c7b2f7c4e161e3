#pragma once

#include <cmath>
#include <cstdint>

#include <rubato/formula/expression.hpp>

/// The functions of the formula language that the standard library lacks, and the meaning of each operation in doubles.
namespace rubato::formula {

/// sech x = 2 e^{-|x|} / (1 + e^{-2|x|}): underflows to 0, never to inf/inf.
inline double sech(double x) {
  const double decay = std::exp(-std::abs(x));
  return 2.0 * decay / (1.0 + decay * decay);
}

/// csch x = sign(x) 2 e^{-|x|} / (1 - e^{-2|x|}) for large |x|, and 1/sinh x where that form would cancel.
inline double csch(double x) {
  if (std::abs(x) < 1.0) {
    return 1.0 / std::sinh(x);
  }
  const double decay = std::exp(-std::abs(x));
  return std::copysign(2.0 * decay / (1.0 - decay * decay), x);
}

/// -1, 1, or x itself where it is 0 or NaN.
inline double sign(double x) {
  return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x;
}

/// The smaller argument; NaN if either is.
inline double minimum(double a, double b) {
  return a < b || std::isnan(a) ? a : b;
}
/// The larger argument; NaN if either is.
inline double maximum(double a, double b) {
  return a > b || std::isnan(a) ? a : b;
}

/// x where the condition is positive, else 0; NaN where it is NaN. And the other way round.
///@{
inline double where_positive(double condition, double x) {
  return condition > 0.0 ? x : condition <= 0.0 ? 0.0 : condition;
}
inline double where_negative(double condition, double x) {
  return condition <= 0.0 ? x : condition > 0.0 ? 0.0 : condition;
}
///@}

/// x^n by repeated squaring; for n < 0 the reciprocal of x^{-n}.
inline double integer_power(double x, std::int32_t n) {
  double result = 1.0;
  for (std::uint32_t rest = n < 0 ? 0U - static_cast<std::uint32_t>(n) : static_cast<std::uint32_t>(n); rest != 0;) {
    if (rest & 1U) {
      result *= x;
    }
    rest >>= 1U;
    if (rest != 0) {
      x *= x;
    }
  }
  return n < 0 ? 1.0 / result : result;
}

/// The value of `operation` at a (and b). For `constant` and `variable`, which compute nothing: NaN.
[[nodiscard]] double apply(Operation operation, double a, double b = 0.0);

}  // namespace rubato::formula
