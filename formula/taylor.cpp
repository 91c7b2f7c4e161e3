#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>

#include <fmt/format.h>

#include <rubato/formula/taylor.hpp>

namespace rubato::formula {

namespace {

constexpr double nothing = -0.0;  // adding it changes no number, not even -0

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
    case OpCode::sin:
    case OpCode::sincos: return "sin";
    case OpCode::cos: return "cos";
    case OpCode::tan: return "tan";
    case OpCode::asin: return "asin";
    case OpCode::acos: return "acos";
    case OpCode::atan: return "atan";
    case OpCode::atan2: return "atan2";
    case OpCode::sinh: return "sinh";
    case OpCode::cosh: return "cosh";
    case OpCode::tanh: return "tanh";
    case OpCode::asinh: return "asinh";
    case OpCode::acosh: return "acosh";
    case OpCode::atanh: return "atanh";
    case OpCode::exp: return "exp";
    case OpCode::log: return "log";
    case OpCode::sqrt: return "sqrt";
    case OpCode::cbrt: return "cbrt";
    case OpCode::abs: return "abs";
    case OpCode::sech: return "sech";
    case OpCode::csch: return "csch";
    case OpCode::sign: return "sign";
    case OpCode::min: return "min";
    case OpCode::max: return "max";
  }
  return "?";
}

/// Each register written at most once, and no input or constant overwritten.
bool reuses_registers(const Bytecode& code) {
  std::vector<bool> written(code.register_count(), false);
  std::fill_n(written.begin(), code.input_count() + code.constants().size(), true);
  const auto write = [&](std::uint32_t r) {
    const bool again = written[r];
    written[r] = true;
    return again;
  };
  return std::any_of(code.instructions().begin(), code.instructions().end(),
                     [&](const Instruction& i) { return write(i.target) || (i.code == OpCode::sincos && write(i.b)); });
}

}  // namespace

template <typename Grading>
BasicTaylorEvaluator<Grading>::BasicTaylorEvaluator(const Bytecode& code, int order)
    : order_(order),
      input_count_(code.input_count()),
      series_count_(code.register_count()),
      outputs_(code.outputs().begin(), code.outputs().end()) {
  if (order < 0)
    throw std::invalid_argument(fmt::format("the order of a Taylor expansion must not be negative ({} given)", order));
  if (reuses_registers(code))
    throw std::invalid_argument("Taylor arithmetic needs code compiled without reuse of registers");
  stride_ = Grading::offset(order + 1);
  for (const Instruction& instruction : code.instructions())
    lower(instruction, code);
  series_.assign(series_count_ * stride_, 0.0);
  const auto constants = code.constants();
  for (std::size_t c = 0; c < constants.size(); ++c)
    at(input_count_ + c)[0] = constants[c];
}

template <typename Grading>
std::uint32_t BasicTaylorEvaluator<Grading>::new_series() {
  return static_cast<std::uint32_t>(series_count_++);
}

template <typename Grading>
void BasicTaylorEvaluator<Grading>::lower(const Instruction& instruction, const Bytecode& code) {
  const auto constant = [&](std::uint32_t r) -> const double* {
    const std::size_t c = r - code.input_count();
    return r >= code.input_count() && c < code.constants().size() ? &code.constants()[c] : nullptr;
  };
  Step base;
  base.code = instruction.code;
  base.target = instruction.target;
  base.a = instruction.a;
  base.b = instruction.b;
  base.culprit = instruction.code == OpCode::divide ? instruction.b : instruction.a;
  const auto emit = [&](Kind kind, std::uint32_t target, std::uint32_t a, std::uint32_t b = 0) -> Step& {
    Step step = base;
    step.kind = kind;
    step.target = target;
    step.a = a;
    step.b = b;
    return steps_.emplace_back(step);
  };
  const auto affine = [&](std::uint32_t target, double value, double factor, std::uint32_t a) {
    Step& step = emit(Kind::affine, target, a);
    step.value = value;
    step.factor = factor;
  };
  const auto product = [&](std::uint32_t target, std::uint32_t a, std::uint32_t b) {
    if (constant(a))
      affine(target, nothing, *constant(a), b);
    else if (constant(b))
      affine(target, nothing, *constant(b), a);
    else if (a == b)
      emit(Kind::square, target, a);
    else
      emit(Kind::multiply, target, a, b);
  };
  // The series value + factor·a².
  const auto quadratic = [&](double value, double factor) {
    const std::uint32_t square = new_series();
    emit(Kind::square, square, base.a);
    const std::uint32_t result = new_series();
    affine(result, value, factor, square);
    return result;
  };
  const auto root_of = [&](std::uint32_t a) {
    const std::uint32_t root = new_series();
    emit(Kind::square_root, root, a);
    return root;
  };
  const auto integral = [&](double factor, std::uint32_t denominator) {
    emit(Kind::quotient_integral, base.target, base.a, denominator).factor = factor;
  };

  switch (instruction.code) {
    case OpCode::add: emit(Kind::add, base.target, base.a, base.b); return;
    case OpCode::subtract: emit(Kind::subtract, base.target, base.a, base.b); return;
    case OpCode::multiply: product(base.target, base.a, base.b); return;
    case OpCode::divide:
      if (const double* divisor = constant(base.b))
        emit(Kind::divide_by_number, base.target, base.a).value = *divisor;
      else
        emit(Kind::divide, base.target, base.a, base.b);
      return;
    case OpCode::negate: affine(base.target, nothing, -1.0, base.a); return;
    case OpCode::multiply_add:
    case OpCode::multiply_subtract:
    case OpCode::negative_multiply_add: {
      const std::uint32_t rounded = new_series();
      product(rounded, base.a, base.b);
      if (instruction.code == OpCode::multiply_add)
        emit(Kind::add, base.target, rounded, instruction.c);
      else if (instruction.code == OpCode::multiply_subtract)
        emit(Kind::subtract, base.target, rounded, instruction.c);
      else
        emit(Kind::subtract, base.target, instruction.c, rounded);
      return;
    }
    case OpCode::square: emit(Kind::square, base.target, base.a); return;
    case OpCode::integer_power: lower_power(base, static_cast<std::int32_t>(instruction.b)); return;
    case OpCode::power:
      if (const double* exponent = constant(base.b)) {
        if (*exponent == std::nearbyint(*exponent) && std::abs(*exponent) <= std::numeric_limits<std::int32_t>::max()) {
          lower_power(base, static_cast<std::int64_t>(*exponent));
          return;
        }
        emit(Kind::power, base.target, base.a).value = *exponent;
      } else {
        const std::uint32_t logarithm = new_series();
        emit(Kind::quotient_integral, logarithm, base.a, base.a).factor = 1.0;
        const std::uint32_t exponent_of_e = new_series();
        product(exponent_of_e, logarithm, base.b);
        emit(Kind::exponential, base.target, exponent_of_e);
      }
      return;
    case OpCode::sin: emit(Kind::circular, base.target, base.a, new_series()); return;
    case OpCode::cos: emit(Kind::circular, new_series(), base.a, base.target); return;
    case OpCode::sincos: emit(Kind::circular, base.target, base.a, base.b); return;
    case OpCode::sinh: emit(Kind::hyperbolic, base.target, base.a, new_series()); return;
    case OpCode::cosh: emit(Kind::hyperbolic, new_series(), base.a, base.target); return;
    case OpCode::tan: emit(Kind::tangent, base.target, base.a, new_series()).factor = 1.0; return;
    case OpCode::tanh: emit(Kind::tangent, base.target, base.a, new_series()).factor = -1.0; return;
    case OpCode::sech:
    case OpCode::csch: {
      Step& step = emit(Kind::secant, base.target, base.a, new_series());
      step.factor = instruction.code == OpCode::sech ? 1.0 : -1.0;
      step.c = new_series();
      step.d = new_series();
      return;
    }
    case OpCode::asin: integral(1.0, root_of(quadratic(1.0, -1.0))); return;
    case OpCode::acos: integral(-1.0, root_of(quadratic(1.0, -1.0))); return;
    case OpCode::atan: integral(1.0, quadratic(1.0, 1.0)); return;
    case OpCode::asinh: integral(1.0, root_of(quadratic(1.0, 1.0))); return;
    case OpCode::acosh: integral(1.0, root_of(quadratic(-1.0, 1.0))); return;
    case OpCode::atanh: integral(1.0, quadratic(1.0, -1.0)); return;
    case OpCode::atan2: emit(Kind::argument, base.target, base.a, base.b).c = new_series(); return;
    case OpCode::exp: emit(Kind::exponential, base.target, base.a); return;
    case OpCode::log: integral(1.0, base.a); return;
    case OpCode::sqrt: emit(Kind::square_root, base.target, base.a); return;
    case OpCode::cbrt: emit(Kind::power, base.target, base.a).value = 1.0 / 3.0; return;
    case OpCode::abs: emit(Kind::absolute, base.target, base.a); return;
    case OpCode::sign: emit(Kind::sign, base.target, base.a); return;
    case OpCode::min: emit(Kind::minimum, base.target, base.a, base.b); return;
    case OpCode::max: emit(Kind::maximum, base.target, base.a, base.b); return;
  }
}

/// Repeated squaring of the series, which needs no division by its leading part and so also works where that is 0.
template <typename Grading>
void BasicTaylorEvaluator<Grading>::lower_power(const Step& base, std::int64_t exponent) {
  const auto emit = [&](Kind kind, std::uint32_t target, std::uint32_t a, std::uint32_t b = 0) {
    Step step = base;
    step.kind = kind;
    step.target = target;
    step.a = a;
    step.b = b;
    step.value = step.factor = 1.0;
    steps_.push_back(step);
  };
  if (exponent == 0)
    return emit(Kind::fill, base.target, base.a);
  std::uint32_t power = base.a;
  std::uint32_t result = base.a;
  bool first = true;
  for (std::int64_t rest = std::abs(exponent); rest != 0; rest >>= 1) {
    if (rest & 1) {
      if (first) {
        result = power;
      } else {
        const std::uint32_t next = new_series();
        emit(Kind::multiply, next, result, power);
        result = next;
      }
      first = false;
    }
    if (rest > 1) {
      const std::uint32_t next = new_series();
      emit(Kind::square, next, power);
      power = next;
    }
  }
  if (exponent < 0)
    return emit(Kind::reciprocal, base.target, result);
  if (result == base.a) {
    emit(Kind::affine, base.target, base.a);
    steps_.back().value = nothing;
  } else {
    steps_.back().target = base.target;  // the product or square just made is the result
  }
}

template <typename Grading>
void BasicTaylorEvaluator<Grading>::restart() {
  next_ = 0;
  failure_ = Failure::none;
}

template <typename Grading>
bool BasicTaylorEvaluator<Grading>::inputs_finite(int d) {
  for (std::size_t m = 0; m < input_count_; ++m)
    for (const double x : part(m, d))
      if (!std::isfinite(x)) {
        failure_ = Failure::input;
        failed_argument_ = static_cast<double>(m);
        return false;
      }
  return true;
}

template <typename Grading>
Status BasicTaylorEvaluator<Grading>::advance() {
  assert(next_ <= order_);
  if (failure_ != Failure::none || !inputs_finite(next_))
    return Status::undefined;
  for (const Step& step : steps_) {
    const bool expandable = next_ == 0 ? start(step) : extend(step, next_);
    if (!expandable) {
      failure_ = Failure::no_expansion;
    } else {
      const auto result = part(step.target, next_);
      if (!std::all_of(result.begin(), result.end(), [](double x) { return std::isfinite(x); }))
        failure_ = Failure::not_finite;
    }
    if (failure_ != Failure::none) {
      failed_code_ = step.code;
      failed_argument_ = at(step.culprit)[0];
      return Status::undefined;
    }
  }
  ++next_;
  return Status::success;
}

template <typename Grading>
Status BasicTaylorEvaluator<Grading>::operator()() {
  restart();
  while (next_ <= order_)
    if (const Status status = advance(); status != Status::success)
      return status;
  return Status::success;
}

template <typename Grading>
std::string BasicTaylorEvaluator<Grading>::failure() const {
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

template class BasicTaylorEvaluator<Univariate>;
template class BasicTaylorEvaluator<Bivariate>;
template class BasicTaylorEvaluator<EvenBivariate>;

}  // namespace rubato::formula
