#include <rubato/formula/taylor.hpp>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>

#include <rubato/base/lanes.hpp>
#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/scalar_functions.hpp>
#include <rubato/formula/special.hpp>
#include <rubato/formula/taylor_kernel.hpp>

namespace rubato::formula {

namespace {

using taylor::Kind;
using taylor::Step;

/// How a user knows an operation of the code.
std::string_view name_of(OpCode code) {
  switch (code) {
    case OpCode::add: return "+";
    case OpCode::subtract: return "-";
    case OpCode::multiply:
    case OpCode::multiply_add:
    case OpCode::multiply_subtract:
    case OpCode::negative_multiply_add: return "*";
    case OpCode::divide: return "division";
    case OpCode::negate: return "unary minus";
    case OpCode::square:
    case OpCode::integer_power:
    case OpCode::power: return "^";
    case OpCode::sincos:
      return "sin";
// clang-format off
#define RUBATO_FUNCTION(id, name, ...) case OpCode::id: return #name;
#include <rubato/formula/operations.inc>
      // clang-format on
    case OpCode::where_positive: return "where";
    case OpCode::where_negative: return "where";
  }
  return "?";
}

/// f(a_0) of the functions with D f(a) = ±(D a)/b; a general power has a logarithm in it.
double leading_value(OpCode code, double a) {
  return code == OpCode::power ? std::log(a) : scalar_function(code)(a, 0.0);
}

/// x^p; the powers of roots and quotients are formed from them.
double leading_power(const Step& step, double x) {
  if (step.code == OpCode::cbrt) {
    return std::cbrt(x);
  }
  const double doubled = 2.0 * step.value;
  if (std::abs(doubled) <= 16.0 && doubled == std::nearbyint(doubled)) {
    return integer_power(step.positive ? std::sqrt(x) : x,
                         static_cast<std::int32_t>(step.positive ? doubled : step.value));
  }
  return std::pow(x, step.value);
}

bool has_kink(Kind kind) {
  return kind == Kind::absolute || kind == Kind::sign || kind == Kind::minimum || kind == Kind::maximum ||
         kind == Kind::choice;
}

const taylor::Kernel& kernel() {
  static const taylor::Kernel best = [] {
#if defined(__x86_64__)
    if (vector_lanes() > 2) {
      return taylor::kernel_avx2();
    }
#endif
    return taylor::kernel_pair();
  }();
  return best;
}

/// 1, 2 or a multiple of 4.
std::size_t padded(int lanes) {
  if (lanes < 1) {
    throw std::invalid_argument(fmt::format("a Taylor expansion needs at least one lane ({} given)", lanes));
  }
  return lanes <= 2 ? static_cast<std::size_t>(lanes) : (static_cast<std::size_t>(lanes) + 3) / 4 * 4;
}

}  // namespace

TaylorEvaluator::TaylorEvaluator(const Bytecode& code, int order, int lanes)
    : order_(order),
      lanes_(static_cast<std::size_t>(lanes)),
      width_(padded(lanes)),
      series_stride_((static_cast<std::size_t>(std::max(order, 0)) + 1) * width_),
      program_(taylor::lower(code, std::max(order, 0))),
      kinks_(std::ranges::any_of(program_.steps, [](const Step& step) { return has_kink(step.kind); })) {
  if (order < 0) {
    throw std::invalid_argument(fmt::format("the order of a Taylor expansion must not be negative ({} given)", order));
  }
  series_.assign((program_.series_count * series_stride_ + line - 1) / line, CacheLine{});
  for (std::size_t c = 0; c < program_.constants.size(); ++c) {
    std::fill_n(at(program_.input_count + c), width_, program_.constants[c]);
  }
  weights_.assign(static_cast<std::size_t>(order) + 1, 0.0);
}

void TaylorEvaluator::restart() {
  next_ = 0;
  fed_ = false;
  failure_ = Failure::none;
}

taylor::Work TaylorEvaluator::work() {
  return {at(0), series_stride_, width_, weights_.data()};
}

/// Pads the inputs' coefficients; false if one is not finite.
bool TaylorEvaluator::take_inputs() {
  uniform_ = next_ == 0;
  for (std::size_t m = 0; m < program_.input_count; ++m) {
    double* const values = at(m, next_);
    std::fill(values + lanes_, values + width_, values[lanes_ - 1]);
    uniform_ = uniform_ && std::all_of(values, values + lanes_, [&](double x) { return x == values[0]; });
    double test = 0.0;  // or NaN
    for (std::size_t lane = 0; lane < lanes_; ++lane) {
      test += values[lane] - values[lane];
    }
    if (test != 0.0) {
      failure_ = Failure::input;
      failed_argument_ = static_cast<double>(m);
      return false;
    }
  }
  return true;
}

/// Order 0, where lanes that begin at one point are computed once.
bool TaylorEvaluator::start() {
  const std::size_t own = uniform_ ? 1 : lanes_;
  for (std::size_t lane = 0; lane < own; ++lane) {
    if (!start_lane(lane)) {
      return !std::ranges::any_of(program_.steps, [&](const Step& step) { return fails(step, own); });
    }
  }
  if (own < width_) {
    for (std::size_t s = program_.input_count + program_.constants.size(); s < program_.series_count; ++s) {
      double* const values = at(s);
      std::fill(values + own, values + width_, values[own - 1]);
    }
  }
  return true;
}

Status TaylorEvaluator::advance() {
  assert(next_ <= order_);
  if (failure_ != Failure::none || !(fed_ || take_inputs())) {
    return Status::undefined;
  }
  fed_ = false;
  if (next_ == 0) {
    if (!start()) {
      return Status::undefined;
    }
  } else {
    kernel().extend(work(), program_.scheduled.data(), program_.groups.data(),
                    program_.groups.data() + program_.groups.size(), next_);
    // What is not finite spreads to an output, unless it stops at a kink.
    if ((kinks_ || !kernel().finite(work(), program_.outputs.data(), program_.outputs.size(), next_)) &&
        std::ranges::any_of(program_.steps, [&](const Step& step) { return fails(step, lanes_); })) {
      return Status::undefined;
    }
  }
  ++next_;
  return Status::success;
}

Status TaylorEvaluator::operator()() {
  restart();
  while (next_ <= order_) {
    if (const Status status = advance(); status != Status::success) {
      return status;
    }
  }
  return Status::success;
}

bool TaylorEvaluator::fails(const Step& step, std::size_t lanes) {
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    if (!has_expansion(step, lane)) {
      failure_ = Failure::no_expansion;
    } else if (!std::isfinite(at(step.target, next_)[lane])) {
      failure_ = Failure::not_finite;
    }
    if (failure_ != Failure::none) {
      failed_code_ = step.code;
      failed_argument_ = at(step.culprit)[lane];
      return true;
    }
  }
  return false;
}

/// By order 0, and for kinks by the next order.
bool TaylorEvaluator::has_expansion(const Step& step, std::size_t lane) const {
  const double a = at(step.a)[lane];
  const double b = at(step.b)[lane];
  switch (step.kind) {
    case Kind::divide_by_number: return step.value != 0.0;
    case Kind::divide: return b != 0.0;
    case Kind::reciprocal: return a != 0.0;
    case Kind::square_root: return a > 0.0;
    case Kind::power: return step.positive ? a > 0.0 : a != 0.0;
    case Kind::quotient_integral: return b > 0.0 && !std::isnan(at(step.target)[lane]);
    case Kind::secant: return step.factor > 0.0 || a != 0.0;
    case Kind::argument: return at(step.c)[lane] > 0.0;
    case Kind::absolute:
    case Kind::sign: return next_ == 0 || a != 0.0 || at(step.a, next_)[lane] == 0.0;
    case Kind::minimum:
    case Kind::maximum: return next_ == 0 || a != b || at(step.a, next_)[lane] == at(step.b, next_)[lane];
    case Kind::function: return std::isfinite(at(step.target)[lane]);
    case Kind::choice: return next_ == 0 || a != 0.0 || at(step.a, next_)[lane] == 0.0;
    default: return true;
  }
}

/// Order 0 of one lane; false if something in it has no expansion or is not finite.
bool TaylorEvaluator::start_lane(std::size_t lane) {
  double* const values = at(0) + lane;
  bool expandable = true;  // as far as the values are finite without an expansion
  double test = 0.0;       // or NaN, once a value has not been finite
  for (const Step& step : program_.scheduled) {
    double& target = values[step.target * series_stride_];
    const double a = values[step.a * series_stride_];
    double& second = values[step.b * series_stride_];
    const double b = second;
    switch (step.kind) {
      case Kind::fill: target = step.value; break;
      case Kind::add: target = a + b; break;
      case Kind::subtract: target = a - b; break;
      case Kind::affine: target = step.value + step.factor * a; break;
      case Kind::divide_by_number: target = a / step.value; break;
      case Kind::multiply: target = a * b; break;
      case Kind::square: target = a * a; break;
      case Kind::divide: target = a / b; break;
      case Kind::reciprocal: target = 1.0 / a; break;
      case Kind::square_root:
        target = std::sqrt(a);
        expandable = expandable && a > 0.0;
        break;
      case Kind::power:
        target = step.factor * leading_power(step, a);
        expandable = expandable && (step.positive ? a > 0.0 : a != 0.0);
        break;
      case Kind::exponential: target = std::exp(a); break;
      case Kind::quotient_integral:
        target = leading_value(step.code, a);
        expandable = expandable && b > 0.0;
        break;
      case Kind::circular:
        target = std::sin(a);
        second = std::cos(a);
        break;
      case Kind::hyperbolic:
        target = std::sinh(a);
        second = std::cosh(a);
        break;
      case Kind::tangent:
        target = std::tan(a);
        second = 1.0 + target * target;
        break;
      case Kind::secant:
        target = step.factor > 0.0 ? sech(a) : csch(a);
        second = step.factor > 0.0 ? std::tanh(a) : 1.0 / std::tanh(a);
        values[step.c * series_stride_] = target * second;
        values[step.d * series_stride_] = target * target;
        break;
      case Kind::argument:
        target = std::atan2(a, b);
        values[step.c * series_stride_] = a * a + b * b;
        expandable = expandable && a * a + b * b > 0.0;
        break;
      case Kind::absolute: target = std::abs(a); break;
      case Kind::sign: target = sign(a); break;
      case Kind::minimum: target = minimum(a, b); break;
      case Kind::maximum: target = maximum(a, b); break;
      case Kind::function:
        scaled_derivatives(step.code, step.factor, a, weights_);
        target = weights_[0];
        for (std::uint32_t k = 0; k < step.d; ++k) {
          values[(step.c + k) * series_stride_] = weights_[k + 1];
        }
        break;
      case Kind::choice: target = step.factor > 0.0 ? where_positive(a, b) : where_negative(a, b); break;
    }
    test += target - target;
  }
  return expandable && test == 0.0;
}

TaylorEvaluator::LaneMap::LaneMap(const TaylorEvaluator& evaluator, std::span<const double> matrix)
    : columns_(evaluator.lanes_ * evaluator.width_) {
  const std::size_t lanes = evaluator.lanes_;
  assert(matrix.size() == lanes * lanes);
  for (std::size_t j = 0; j < lanes; ++j) {
    for (std::size_t i = 0; i < evaluator.width_; ++i) {
      columns_[j * evaluator.width_ + i] = matrix[j * lanes + std::min(i, lanes - 1)];
    }
  }
}

void TaylorEvaluator::feed_back(const LaneMap& map) {
  assert(program_.outputs.size() == program_.input_count && next_ > 0 && next_ <= order_);
  fed_ = true;
  kernel().feed_back(work(), map.columns_.data(), lanes_, program_.outputs.data(), program_.input_count, next_ - 1);
}

std::string TaylorEvaluator::failure() const {
  switch (failure_) {
    case Failure::none: return {};
    case Failure::input:
      return fmt::format("coefficient of order {} of input {} is not finite", next_, failed_argument_);
    case Failure::not_finite:
      return fmt::format("{} overflows at {} (coefficient of order {})", name_of(failed_code_), failed_argument_,
                         next_);
    case Failure::no_expansion: break;
  }
  if (failed_code_ == OpCode::min || failed_code_ == OpCode::max)
    return fmt::format("{} has no Taylor expansion at equal arguments ({})", name_of(failed_code_), failed_argument_);
  if (failed_code_ == OpCode::atan2)
    return "atan2 has no Taylor expansion at (0, 0)";
  return fmt::format("{} has no Taylor expansion at {}", name_of(failed_code_), failed_argument_);
}

}  // namespace rubato::formula
