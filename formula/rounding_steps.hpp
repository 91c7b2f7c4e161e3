#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <type_traits>
#include <utility>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/operations.hpp>
#include <rubato/formula/special.hpp>

/// What each operation makes of a value and of the bound of its error: the steps of RoundingEvaluator, for one number
/// or, of those that loops over several consist of, for as many.
namespace rubato::formula {

/// A value, and the bound of its error in units of u.
struct Rounded {
  double value = 0.0, bound = 0.0;
};

namespace rounding_steps {

inline constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
/// Of functions that are not rounded correctly, in units of u·|result|.
inline constexpr double function_error = 2.0;
/// Of Bessel and elliptic functions, in units of their size and slope: near a zero the error is that of the argument.
inline constexpr double special_error = 16.0;

/// Error of an argument by the derivative there; no error is none, however steep the function. Not `careful`, it is NaN
/// where the function is infinitely steep, and so is what becomes of it.
template <bool careful = true>
inline double carried(double derivative, double error) {
  return careful && error == 0.0 ? 0.0 : std::abs(derivative) * error;
}

inline double slope_of(OpCode function, double parameter, double x) {
  std::array<double, 2> coefficients{};
  scaled_derivatives(function, parameter, x, coefficients);
  return coefficients[1];
}

/// Of √a = v. Where a is not known better than its size the derivative says nothing: |√(a + δ) - √a| ≤ √δ.
inline double of_square_root(double v, double da) {
  return (da == 0.0 ? 0.0 : std::min(0.5 / v * da, std::sqrt(da / unit))) + v;
}
inline double of_cube_root(double v, double a, double da) {
  return (da == 0.0 ? 0.0 : std::min(std::abs(v / (3.0 * a)) * da, 2.0 * std::cbrt(da * unit) / unit)) +
         2.0 * std::abs(v);
}

/// A value with this derivative, and an error of its own in units of u·|value|.
template <bool careful = true>
inline Rounded of_one(double value, double derivative, const Rounded& a, double own) {
  return {value, carried<careful>(derivative, a.bound) + own * std::abs(value)};
}
inline Rounded sum(double value, const Rounded& a, const Rounded& b) {
  return {value, a.bound + b.bound + std::abs(value)};
}
template <bool careful>
inline Rounded fused(double value, double product, const Rounded& a, const Rounded& b, const Rounded& c) {
  return {value, carried<careful>(b.value, a.bound) + carried<careful>(a.value, b.bound) + std::abs(product) + c.bound +
                     std::abs(value)};
}

template <int operands>
using Operands = std::integral_constant<int, operands>;

/// use(Operands<n>, operation) with the operation of an instruction of which is_arithmetic(), of n operands; else false
/// is returned and nothing done.
template <bool careful, typename Use>
[[gnu::always_inline]] inline bool with_arithmetic(const Instruction& step, Use&& use) {
  switch (step.code) {
    case OpCode::add:
      use(Operands<2>(), [](const Rounded& a, const Rounded& b) { return sum(a.value + b.value, a, b); });
      return true;
    case OpCode::subtract:
      use(Operands<2>(), [](const Rounded& a, const Rounded& b) { return sum(a.value - b.value, a, b); });
      return true;
    case OpCode::multiply:
      use(Operands<2>(), [](const Rounded& a, const Rounded& b) {
        const double v = a.value * b.value;
        return Rounded{v, carried<careful>(b.value, a.bound) + carried<careful>(a.value, b.bound) + std::abs(v)};
      });
      return true;
    case OpCode::divide:
      use(Operands<2>(), [](const Rounded& a, const Rounded& b) {
        const double v = a.value / b.value;
        return Rounded{v,
                       carried<careful>(1.0 / b.value, a.bound) + carried<careful>(v / b.value, b.bound) + std::abs(v)};
      });
      return true;
    case OpCode::negate:
      use(Operands<1>(), [](const Rounded& a) { return of_one<careful>(-a.value, 1.0, a, 0.0); });
      return true;
    case OpCode::multiply_add:
      use(Operands<3>(), [](const Rounded& a, const Rounded& b, const Rounded& c) {
        const double product = a.value * b.value;
        return fused<careful>(product + c.value, product, a, b, c);
      });
      return true;
    case OpCode::multiply_subtract:
      use(Operands<3>(), [](const Rounded& a, const Rounded& b, const Rounded& c) {
        const double product = a.value * b.value;
        return fused<careful>(product - c.value, product, a, b, c);
      });
      return true;
    case OpCode::negative_multiply_add:
      use(Operands<3>(), [](const Rounded& a, const Rounded& b, const Rounded& c) {
        const double product = a.value * b.value;
        return fused<careful>(c.value - product, product, a, b, c);
      });
      return true;
    case OpCode::square:
      use(Operands<1>(), [](const Rounded& a) { return of_one<careful>(a.value * a.value, 2.0 * a.value, a, 1.0); });
      return true;
    case OpCode::integer_power:
      use(Operands<1>(), [n = std::bit_cast<std::int32_t>(step.b)](const Rounded& a) {
        return of_one<careful>(integer_power(a.value, n), n * integer_power(a.value, n - 1), a,
                               std::abs(static_cast<double>(n)));
      });
      return true;
    case OpCode::abs:
      use(Operands<1>(), [](const Rounded& a) { return of_one<careful>(std::abs(a.value), 1.0, a, 0.0); });
      return true;
    case OpCode::sqrt:
      use(Operands<1>(), [](const Rounded& a) {
        const double v = std::sqrt(a.value);
        return Rounded{v, of_square_root(v, a.bound)};
      });
      return true;
    default: return false;
  }
}

/// The result of a function of one number or two, as operations.inc has its value and the error of that.
template <typename Read>
[[gnu::noinline]] Rounded of_function(OpCode code, const Rounded& first, Read&& second) {
  const double a = first.value, da = first.bound;
  [[maybe_unused]] double b = 0.0, db = 0.0;
  double v = 0.0, e = 0.0;
  const auto by = [&](double in_a, double own) { return carried(in_a, da) + own * std::abs(v); };
  const auto by_both = [&](double in_a, double in_b, double own) {
    return carried(in_a, da) + carried(in_b, db) + own * std::abs(v);
  };
  const auto of_bessel = [&](double n, double x, double dx) {
    const double slope = slope_of(code, n, x);
    return carried(slope, dx) + special_error * (std::abs(v) + std::abs(slope));
  };
  const auto of_jacobi = [&](double m, double u, double du) {
    const double slope = slope_of(code, m, u);
    return carried(slope, du) + special_error * (std::abs(v) + std::abs(u * slope));
  };
  switch (code) {
#define RUBATO_FUNCTION(id, name, form, is, symmetry, f, error, ...) \
  case OpCode::id:                                                   \
    if constexpr (arity_of(Form::form) == 2) {                       \
      const Rounded other = second();                                \
      b = other.value;                                               \
      db = other.bound;                                              \
    }                                                                \
    v = f;                                                           \
    e = error;                                                       \
    break;
#include <rubato/formula/operations.inc>
    default: break;
  }
  return {v, e};
}

/// of(0) + of(1) + …, so many: eight sums, of every eighth, which go side by side, and then of these in turn.
template <typename Number, typename Term>
[[gnu::always_inline]] inline Number sum_in_eights(std::size_t terms, const Number& zero, const Term& of) {
  std::array<Number, 8> sums;
  sums.fill(zero);
  std::size_t i = 0;
  for (; i + sums.size() <= terms; i += sums.size()) {
    for (std::size_t k = 0; k < sums.size(); ++k) {
      sums[k] = sums[k] + of(i + k);
    }
  }
  for (std::size_t k = 0; i < terms; ++i, ++k) {
    sums[k] = sums[k] + of(i);
  }
  for (std::size_t k = 1; k < sums.size(); ++k) {
    sums[0] = sums[0] + sums[k];
  }
  return sums[0];
}

}  // namespace rounding_steps

/// What an instruction makes of the numbers in its registers, and of their bounds.
[[gnu::always_inline]] inline void take_rounded_step(const Instruction& step, double* values, double* bounds) {
  namespace of = rounding_steps;
  const auto read = [&](std::uint32_t at) { return Rounded{values[at], bounds[at]}; };
  const auto write = [&](std::uint32_t at, const Rounded& result) {
    values[at] = result.value;
    bounds[at] = result.bound;
  };
  const Rounded a = read(step.a);
  const bool done = of::with_arithmetic<true>(step, [&]<int operands>(of::Operands<operands>, auto operation) {
    if constexpr (operands == 1) {
      write(step.target, operation(a));
    } else if constexpr (operands == 2) {
      write(step.target, operation(a, read(step.b)));
    } else {
      write(step.target, operation(a, read(step.b), read(step.c)));
    }
  });
  if (done) {
    return;
  }
  switch (step.code) {
    case OpCode::power: {
      const Rounded b = read(step.b);
      const double v = std::pow(a.value, b.value);
      write(step.target,
            {v, of::carried(b.value * std::pow(a.value, b.value - 1.0), a.bound) +
                    of::carried(v * std::log(std::abs(a.value)), b.bound) + of::function_error * std::abs(v)});
      break;
    }
    case OpCode::sincos: {
      const double sine = std::sin(a.value), cosine = std::cos(a.value);
      write(step.b, of::of_one(cosine, sine, a, of::function_error));
      write(step.target, of::of_one(sine, cosine, a, of::function_error));
      break;
    }
    case OpCode::where_positive: {
      const Rounded b = read(step.b);
      write(step.target, {where_positive(a.value, b.value), where_positive(a.value, b.bound)});
      break;
    }
    case OpCode::where_negative: {
      const Rounded b = read(step.b);
      write(step.target, {where_negative(a.value, b.value), where_negative(a.value, b.bound)});
      break;
    }
    default: write(step.target, of::of_function(step.code, a, [&] { return read(step.b); })); break;
  }
}

}  // namespace rubato::formula
