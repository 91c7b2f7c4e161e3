#include <rubato/formula/rounding.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <numbers>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/loop.hpp>
#include <rubato/formula/loop_evaluator.hpp>
#include <rubato/formula/operations.hpp>
#include <rubato/formula/special.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato::formula {

namespace {

constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();
/// Of functions that are not rounded correctly, in units of u·|result|.
constexpr double function_error = 2.0;
/// Of Bessel and elliptic functions, in units of their size and slope: near a zero the error is that of the argument.
constexpr double special_error = 16.0;

/// A value, and the bound of its error in units of u.
struct Rounded {
  double value = 0.0, bound = 0.0;
};

/// Error of an argument by the derivative there; no error is none, however steep the function.
double carried(double derivative, double error) {
  return error == 0.0 ? 0.0 : std::abs(derivative) * error;
}

double slope_of(OpCode function, double parameter, double x) {
  std::array<double, 2> coefficients{};
  scaled_derivatives(function, parameter, x, coefficients);
  return coefficients[1];
}

/// Of √a = v. Where a is not known better than its size the derivative says nothing: |√(a + δ) - √a| ≤ √δ.
double of_square_root(double v, double da) {
  return (da == 0.0 ? 0.0 : std::min(0.5 / v * da, std::sqrt(da / unit))) + v;
}
double of_cube_root(double v, double a, double da) {
  return (da == 0.0 ? 0.0 : std::min(std::abs(v / (3.0 * a)) * da, 2.0 * std::cbrt(da * unit) / unit)) +
         2.0 * std::abs(v);
}

/// A value with this derivative, and an error of its own in units of u·|value|.
Rounded of_one(double value, double derivative, const Rounded& a, double own) {
  return {value, carried(derivative, a.bound) + own * std::abs(value)};
}
Rounded sum(double value, const Rounded& a, const Rounded& b) {
  return {value, a.bound + b.bound + std::abs(value)};
}
Rounded product(const Rounded& a, const Rounded& b) {
  const double v = a.value * b.value;
  return {v, carried(b.value, a.bound) + carried(a.value, b.bound) + std::abs(v)};
}

/// The result of a function of one number or two, as operations.inc has its value and the error of that.
[[gnu::noinline]] Rounded of_function(OpCode code, const Rounded& first, const Rounded* second) {
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
      b = second->value;                                             \
      db = second->bound;                                            \
    }                                                                \
    v = f;                                                           \
    e = error;                                                       \
    break;
#include <rubato/formula/operations.inc>
    default: break;
  }
  return {v, e};
}

}  // namespace

RoundingEvaluator::RoundingEvaluator(const Bytecode& code)
    : code_(code), values_(code.register_count(), 0.0), bounds_(code.register_count(), 0.0) {
  std::ranges::copy(code_.constants(), values_.begin() + static_cast<std::ptrdiff_t>(code_.input_count()));
  if (code_.loops() != nullptr) {
    loops_ = Copied(LoopRounding(code_.loops()));
  }
}

void RoundingEvaluator::run(std::span<const double> inputs, std::span<const double> errors) {
  assert(inputs.size() == code_.input_count() && errors.size() == code_.input_count());
  if (loops_) {
    (*loops_)(inputs, errors);
    for (std::size_t i = 0; i < output_count(); ++i) {
      values_[code_.outputs()[i]] = loops_->rest().value(i);
      bounds_[code_.outputs()[i]] = loops_->rest().bound(i);
    }
    return;
  }
  std::ranges::copy(inputs, values_.begin());
  std::ranges::copy(errors, bounds_.begin());
  const auto read = [this](std::uint32_t at) { return Rounded{values_[at], bounds_[at]}; };
  const auto write = [this](std::uint32_t at, const Rounded& result) {
    values_[at] = result.value;
    bounds_[at] = result.bound;
  };
  for (const Instruction& step : code_.instructions()) {
    const Rounded a = read(step.a);
    switch (step.code) {
      case OpCode::add: {
        const Rounded b = read(step.b);
        write(step.target, sum(a.value + b.value, a, b));
        break;
      }
      case OpCode::subtract: {
        const Rounded b = read(step.b);
        write(step.target, sum(a.value - b.value, a, b));
        break;
      }
      case OpCode::multiply: write(step.target, product(a, read(step.b))); break;
      case OpCode::divide: {
        const Rounded b = read(step.b);
        const double v = a.value / b.value;
        write(step.target, {v, carried(1.0 / b.value, a.bound) + carried(v / b.value, b.bound) + std::abs(v)});
        break;
      }
      case OpCode::negate: write(step.target, of_one(-a.value, 1.0, a, 0.0)); break;
      case OpCode::multiply_add: {
        const Rounded ab = product(a, read(step.b)), c = read(step.c);
        write(step.target, sum(ab.value + c.value, ab, c));
        break;
      }
      case OpCode::multiply_subtract: {
        const Rounded ab = product(a, read(step.b)), c = read(step.c);
        write(step.target, sum(ab.value - c.value, ab, c));
        break;
      }
      case OpCode::negative_multiply_add: {
        const Rounded ab = product(a, read(step.b)), c = read(step.c);
        write(step.target, sum(c.value - ab.value, ab, c));
        break;
      }
      case OpCode::square: write(step.target, of_one(a.value * a.value, 2.0 * a.value, a, 1.0)); break;
      case OpCode::integer_power: {
        const auto n = std::bit_cast<std::int32_t>(step.b);
        write(step.target, of_one(integer_power(a.value, n), n * integer_power(a.value, n - 1), a,
                                  std::abs(static_cast<double>(n))));
        break;
      }
      case OpCode::power: {
        const Rounded b = read(step.b);
        const double v = std::pow(a.value, b.value);
        write(step.target, {v, carried(b.value * std::pow(a.value, b.value - 1.0), a.bound) +
                                   carried(v * std::log(std::abs(a.value)), b.bound) + function_error * std::abs(v)});
        break;
      }
      case OpCode::sincos: {
        const double sine = std::sin(a.value), cosine = std::cos(a.value);
        write(step.b, of_one(cosine, sine, a, function_error));
        write(step.target, of_one(sine, cosine, a, function_error));
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
      default: {
        const Rounded b = operand_count(step.code) == 2 ? read(step.b) : Rounded{};
        write(step.target, of_function(step.code, a, &b));
      }
    }
  }
}

Bytecode sum_size_code(Expression sum, std::span<const Expression> inputs) {
  std::vector<Expression> outputs = {sum};
  std::ranges::copy(magnitudes_of_loops(terms_of(sum)), std::back_inserter(outputs));
  return {outputs, inputs};
}

SumSizeEvaluator::SumSizeEvaluator(const Bytecode& code) : evaluator_(code), errors_(code.input_count(), 0.0) {}

SumSize SumSizeEvaluator::operator()(std::span<const double> inputs, std::span<const double> errors) {
  evaluator_.run(inputs, errors);
  const double sum = evaluator_.value(0), bound = evaluator_.bound(0);
  double terms = 0.0;
  for (std::size_t i = 1; i < evaluator_.output_count(); ++i) {
    terms += std::abs(evaluator_.value(i));
  }
  return {.terms = std::max(std::abs(sum), part_that_counts * terms),
          .cancelled = part_that_counts * std::max(terms - std::abs(sum), 0.0),
          .rounding = unit * (std::isfinite(bound) ? bound : terms),
          .magnitudes = terms};
}

SumSize SumSizeEvaluator::operator()(std::span<const double> inputs) {
  std::ranges::transform(inputs, errors_.begin(), [](double x) { return 2.0 * std::abs(x); });
  return (*this)(inputs, errors_);
}

}  // namespace rubato::formula
