#include <rubato/formula/rounding.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/special.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato::formula {

namespace {

constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();

/// Terms that cancel by more than this make a sum that is small by accident.
constexpr double least_part = 0.03;

/// Of functions that are not rounded correctly, in units of u·|result|.
constexpr double function_error = 2.0;
constexpr double hyperbolic_error = 4.0;

/// Of Bessel and elliptic functions, in units of their size and slope: near a zero the error is that of the argument.
constexpr double special_error = 16.0;

/// The value of such a function, and its derivative.
std::array<double, 2> with_slope(OpCode function, double parameter, double x) {
  std::array<double, 2> coefficients{};
  scaled_derivatives(function, parameter, x, coefficients);
  return coefficients;
}

/// Error of an argument by the derivative there; no error is none, however steep the function.
double carried(double derivative, double error) {
  return error == 0.0 ? 0.0 : std::abs(derivative) * error;
}

}  // namespace

RoundingEvaluator::RoundingEvaluator(const Bytecode& code)
    : code_(code), values_(code.register_count(), 0.0), bounds_(code.register_count(), 0.0) {
  std::ranges::copy(code_.constants(), values_.begin() + static_cast<std::ptrdiff_t>(code_.input_count()));
}

void RoundingEvaluator::run(std::span<const double> inputs, std::span<const double> errors) {
  assert(inputs.size() == code_.input_count() && errors.size() == code_.input_count());
  double* const value = values_.data();
  double* const bound = bounds_.data();
  std::ranges::copy(inputs, value);
  std::ranges::copy(errors, bound);
  for (const Instruction& step : code_.instructions()) {
    const double a = value[step.a];
    const double da = bound[step.a];
    double v = 0.0;
    double e = 0.0;
    // One argument: v = f(a), its derivative there, and the error of f itself in units of u·|v|.
    const auto set = [&](double result, double derivative, double own) {
      v = result;
      e = carried(derivative, da) + own * std::abs(v);
    };
    switch (step.code) {
      case OpCode::add:
        v = a + value[step.b];
        e = da + bound[step.b] + std::abs(v);
        break;
      case OpCode::subtract:
        v = a - value[step.b];
        e = da + bound[step.b] + std::abs(v);
        break;
      case OpCode::multiply:
        v = a * value[step.b];
        e = carried(value[step.b], da) + carried(a, bound[step.b]) + std::abs(v);
        break;
      case OpCode::divide:
        v = a / value[step.b];
        e = carried(1.0 / value[step.b], da) + carried(v / value[step.b], bound[step.b]) + std::abs(v);
        break;
      case OpCode::negate: set(-a, 1.0, 0.0); break;
      case OpCode::multiply_add:
      case OpCode::multiply_subtract:
      case OpCode::negative_multiply_add: {
        const double product = a * value[step.b];
        const double c = value[step.c];
        v = step.code == OpCode::multiply_add        ? product + c
            : step.code == OpCode::multiply_subtract ? product - c
                                                     : c - product;
        e = carried(value[step.b], da) + carried(a, bound[step.b]) + std::abs(product) + bound[step.c] + std::abs(v);
        break;
      }
      case OpCode::square: set(a * a, 2.0 * a, 1.0); break;
      case OpCode::integer_power: {
        const auto n = std::bit_cast<std::int32_t>(step.b);
        set(integer_power(a, n), n * integer_power(a, n - 1), std::abs(static_cast<double>(n)));
        break;
      }
      case OpCode::power: {
        const double exponent = value[step.b];
        v = std::pow(a, exponent);
        e = carried(exponent * std::pow(a, exponent - 1.0), da) + carried(v * std::log(std::abs(a)), bound[step.b]) +
            function_error * std::abs(v);
        break;
      }
      case OpCode::sin: set(std::sin(a), std::cos(a), function_error); break;
      case OpCode::cos: set(std::cos(a), std::sin(a), function_error); break;
      case OpCode::sincos: {
        const double sine = std::sin(a);
        const double cosine = std::cos(a);
        value[step.b] = cosine;
        bound[step.b] = carried(sine, da) + function_error * std::abs(cosine);
        set(sine, cosine, function_error);
        break;
      }
      case OpCode::tan: {
        const double tangent = std::tan(a);
        set(tangent, 1.0 + tangent * tangent, hyperbolic_error);
        break;
      }
      case OpCode::asin: set(std::asin(a), 1.0 / std::sqrt(1.0 - a * a), function_error); break;
      case OpCode::acos: set(std::acos(a), 1.0 / std::sqrt(1.0 - a * a), function_error); break;
      case OpCode::atan: set(std::atan(a), 1.0 / (1.0 + a * a), function_error); break;
      case OpCode::atan2: {
        const double b = value[step.b];
        const double square = a * a + b * b;
        v = std::atan2(a, b);
        e = carried(b / square, da) + carried(a / square, bound[step.b]) + function_error * std::abs(v);
        break;
      }
      case OpCode::sinh: set(std::sinh(a), std::cosh(a), hyperbolic_error); break;
      case OpCode::cosh: set(std::cosh(a), std::sinh(a), hyperbolic_error); break;
      case OpCode::tanh: {
        const double tangent = std::tanh(a);
        set(tangent, 1.0 - tangent * tangent, hyperbolic_error);
        break;
      }
      case OpCode::asinh: set(std::asinh(a), 1.0 / std::sqrt(1.0 + a * a), hyperbolic_error); break;
      case OpCode::acosh: set(std::acosh(a), 1.0 / std::sqrt(a * a - 1.0), hyperbolic_error); break;
      case OpCode::atanh: set(std::atanh(a), 1.0 / (1.0 - a * a), hyperbolic_error); break;
      case OpCode::exp: {
        const double power = std::exp(a);
        set(power, power, function_error);
        break;
      }
      case OpCode::log: set(std::log(a), 1.0 / a, function_error); break;
      case OpCode::sqrt: {
        v = std::sqrt(a);
        // Where a is not known better than its size the derivative says nothing: |√(a + δ) - √a| ≤ √δ.
        e = da == 0.0 ? 0.0 : std::min(0.5 / v * da, std::sqrt(da / unit));
        e += v;
        break;
      }
      case OpCode::cbrt: {
        v = std::cbrt(a);
        e = da == 0.0 ? 0.0 : std::min(std::abs(v / (3.0 * a)) * da, 2.0 * std::cbrt(da * unit) / unit);
        e += function_error * std::abs(v);
        break;
      }
      case OpCode::abs: set(std::abs(a), 1.0, 0.0); break;
      case OpCode::sech: {
        const double secant = sech(a);
        set(secant, secant * std::tanh(a), hyperbolic_error);
        break;
      }
      case OpCode::csch: {
        const double cosecant = csch(a);
        set(cosecant, cosecant / std::tanh(a), hyperbolic_error);
        break;
      }
      case OpCode::sign: set(sign(a), 0.0, 0.0); break;
      case OpCode::min:
        v = minimum(a, value[step.b]);
        e = std::max(da, bound[step.b]);
        break;
      case OpCode::max:
        v = maximum(a, value[step.b]);
        e = std::max(da, bound[step.b]);
        break;
      case OpCode::erf: set(std::erf(a), 2.0 * std::numbers::inv_sqrtpi * std::exp(-a * a), function_error); break;
      case OpCode::bessel_j:
      case OpCode::bessel_y:
      case OpCode::bessel_i:
      case OpCode::bessel_k: {
        const auto [f, slope] = with_slope(step.code, a, value[step.b]);
        v = f;
        e = carried(slope, bound[step.b]) + special_error * (std::abs(v) + std::abs(slope));
        break;
      }
      case OpCode::jacobi_sn:
      case OpCode::jacobi_cn:
      case OpCode::jacobi_dn: {
        const auto [f, slope] = with_slope(step.code, value[step.b], a);
        v = f;
        e = carried(slope, da) + special_error * (std::abs(v) + std::abs(a * slope));
        break;
      }
      case OpCode::where_positive:
        v = where_positive(a, value[step.b]);
        e = where_positive(a, bound[step.b]);
        break;
      case OpCode::where_negative:
        v = where_negative(a, value[step.b]);
        e = where_negative(a, bound[step.b]);
        break;
    }
    value[step.target] = v;
    bound[step.target] = e;
  }
}

Bytecode sum_size_code(Expression sum, std::span<const Expression> inputs) {
  std::vector<Expression> outputs = {sum};
  std::ranges::copy(terms_of(sum), std::back_inserter(outputs));
  return {outputs, inputs};
}

SumSizeEvaluator::SumSizeEvaluator(const Bytecode& code) : evaluator_(code), errors_(code.input_count(), 0.0) {}

SumSize SumSizeEvaluator::operator()(std::span<const double> inputs, std::span<const double> errors) {
  evaluator_.run(inputs, errors);
  double terms = 0.0;
  for (std::size_t i = 1; i < evaluator_.output_count(); ++i) {
    terms += std::abs(evaluator_.value(i));
  }
  SumSize size;
  size.terms = std::max(std::abs(evaluator_.value(0)), least_part * terms);
  const double bound = evaluator_.bound(0);
  size.rounding = unit * (std::isfinite(bound) ? bound : terms);
  return size;
}

SumSize SumSizeEvaluator::operator()(std::span<const double> inputs) {
  std::ranges::transform(inputs, errors_.begin(), [](double x) { return 2.0 * std::abs(x); });
  return (*this)(inputs, errors_);
}

}  // namespace rubato::formula
