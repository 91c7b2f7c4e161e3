#include <rubato/formula/operations.hpp>
#include <rubato/formula/taylor_program.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

namespace rubato::formula::taylor {

namespace {

constexpr double nothing = -0.0;  // adding it changes no number, not even -0

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

class Lowering {
public:
  Lowering(const Bytecode& code, int order)
      : code_(code),
        order_(static_cast<std::uint32_t>(order)),
        powers_(code.register_count()),
        readers_(code.register_count(), 0) {
    for (const Instruction& instruction : code.instructions()) {
      const std::uint32_t operands[] = {instruction.a, instruction.b, instruction.c};
      std::for_each_n(operands, operand_count(instruction.code), [&](std::uint32_t r) { ++readers_[r]; });
    }
    for (const std::uint32_t output : code.outputs()) {
      ++readers_[output];
    }
    program_.input_count = code.input_count();
    program_.series_count = code.register_count();
    program_.outputs.assign(code.outputs().begin(), code.outputs().end());
    program_.constants.assign(code.constants().begin(), code.constants().end());
  }

  Program run() {
    for (const Instruction& instruction : code_.instructions()) {
      base_ = Step{};
      base_.code = instruction.code;
      base_.target = instruction.target;
      base_.a = instruction.a;
      base_.b = instruction.b;
      base_.culprit = instruction.code == OpCode::divide ? instruction.b : instruction.a;
      if (const std::optional<Power> power = as_power(instruction)) {
        powers_[instruction.target] = power;
        if (!cheaper_from_operand(instruction) && emit_power(*power)) {
          continue;
        }
      }
      lower(instruction);
    }
    drop_unread();
    schedule();
    return std::move(program_);
  }

private:
  /// factor·base^exponent, and where the first root or quotient in it came from.
  struct Power {
    std::uint32_t base = 0;
    double exponent = 1.0, factor = 1.0;
    OpCode code{};
    bool positive = false;  ///< a root was taken of the base
  };

  [[nodiscard]] const double* constant(std::uint32_t r) const {
    const std::size_t c = r - code_.input_count();
    return r >= code_.input_count() && c < code_.constants().size() ? &code_.constants()[c] : nullptr;
  }
  std::uint32_t new_series() { return static_cast<std::uint32_t>(program_.series_count++); }
  Step& emit(Kind kind, std::uint32_t target, std::uint32_t a, std::uint32_t b = 0) {
    Step step = base_;
    step.kind = kind;
    step.target = target;
    step.a = a;
    step.b = b;
    return program_.steps.emplace_back(step);
  }
  void affine(std::uint32_t target, double value, double factor, std::uint32_t a) {
    Step& step = emit(Kind::affine, target, a);
    step.value = value;
    step.factor = factor;
  }

  /// As a power of `base`: what is known of r, or r itself.
  [[nodiscard]] std::optional<Power> in_terms_of(std::uint32_t base, std::uint32_t r) const {
    if (powers_[r] && powers_[r]->base == base) {
      return powers_[r];
    }
    return r == base ? std::optional(Power{base, 1.0, 1.0, {}, false}) : std::nullopt;
  }
  [[nodiscard]] static Power product(const Power& x, const Power& y, double sign) {
    Power result = x.code == OpCode{} ? y : x;  // its code and base
    result.exponent = x.exponent + sign * y.exponent;
    result.factor = sign > 0.0 ? x.factor * y.factor : x.factor / y.factor;
    result.positive = x.positive || y.positive;
    return result;
  }
  [[nodiscard]] static Power scaled(Power x, double factor) {
    x.factor *= factor;
    return x;
  }

  [[nodiscard]] std::optional<Power> as_power(const Instruction& i) const {
    const auto base_of = [&](std::uint32_t r) { return powers_[r] ? powers_[r]->base : r; };
    switch (i.code) {
      case OpCode::sqrt: return Power{i.a, 0.5, 1.0, i.code, true};
      case OpCode::negate: return powers_[i.a] ? std::optional(scaled(*powers_[i.a], -1.0)) : std::nullopt;
      case OpCode::square:
        return powers_[i.a] ? std::optional(product(*powers_[i.a], *powers_[i.a], 1.0)) : std::nullopt;
      case OpCode::multiply:
      case OpCode::divide: {
        const double sign = i.code == OpCode::multiply ? 1.0 : -1.0;
        if (const double* number = constant(i.b)) {
          return powers_[i.a] ? std::optional(scaled(*powers_[i.a], sign > 0.0 ? *number : 1.0 / *number))
                              : std::nullopt;
        }
        if (const double* number = constant(i.a)) {
          if (sign > 0.0) {
            return powers_[i.b] ? std::optional(scaled(*powers_[i.b], *number)) : std::nullopt;
          }
          Power divisor = powers_[i.b].value_or(Power{i.b, 1.0, 1.0, i.code, false});
          divisor.exponent = -divisor.exponent;
          divisor.factor = *number / divisor.factor;
          return divisor;
        }
        if (!powers_[i.a] && !powers_[i.b]) {
          return std::nullopt;
        }
        const std::uint32_t base = powers_[i.a] ? base_of(i.a) : base_of(i.b);
        const auto x = in_terms_of(base, i.a);
        const auto y = in_terms_of(base, i.b);
        return x && y ? std::optional(product(*x, *y, sign)) : std::nullopt;
      }
      default: return std::nullopt;
    }
  }

  /// Multiples and squares of what is there anyway.
  [[nodiscard]] bool cheaper_from_operand(const Instruction& i) const {
    switch (i.code) {
      case OpCode::negate:
      case OpCode::square: return readers_[i.a] > 1;
      case OpCode::multiply: return constant(i.a) ? readers_[i.b] > 1 : constant(i.b) && readers_[i.a] > 1;
      case OpCode::divide: return constant(i.b) && readers_[i.a] > 1;
      default: return false;
    }
  }

  /// One step from the base, except where there is a cheaper one or the power is a polynomial.
  bool emit_power(const Power& power) {
    if (!std::isfinite(power.factor) || power.factor == 0.0 ||
        (power.exponent >= 0.0 && power.exponent == std::nearbyint(power.exponent)) ||
        (power.exponent == 0.5 && power.factor == 1.0) || (power.exponent == -1.0 && !power.positive)) {
      return false;
    }
    base_.code = power.code;
    base_.culprit = power.base;
    Step& step = emit(Kind::power, base_.target, power.base);
    step.value = power.exponent;
    step.factor = power.factor;
    step.positive = power.positive;
    return true;
  }

  void product(std::uint32_t target, std::uint32_t a, std::uint32_t b) {
    if (constant(a)) {
      affine(target, nothing, *constant(a), b);
    } else if (constant(b)) {
      affine(target, nothing, *constant(b), a);
    } else if (a == b) {
      emit(Kind::square, target, a);
    } else {
      emit(Kind::multiply, target, a, b);
    }
  }
  /// The series value + factor·a².
  std::uint32_t quadratic(double value, double factor) {
    const std::uint32_t square = new_series();
    emit(Kind::square, square, base_.a);
    const std::uint32_t result = new_series();
    affine(result, value, factor, square);
    return result;
  }
  std::uint32_t root_of(std::uint32_t a) {
    const std::uint32_t root = new_series();
    emit(Kind::square_root, root, a);
    return root;
  }
  void with_derivative(Kind kind, std::uint32_t target, std::uint32_t partner) {
    emit(kind, target, base_.a, partner).c = new_series();
  }
  /// sech and tanh together (factor 1): by 1 - tanh² a slope would be lost where tanh is near 1. Csch and coth (-1).
  void secant(double factor, std::uint32_t target, std::uint32_t partner) {
    Step& step = emit(Kind::secant, target, base_.a, partner);
    step.factor = factor;
    step.c = new_series();
    step.d = new_series();
  }
  void integral(double factor, std::uint32_t denominator) {
    emit(Kind::quotient_integral, base_.target, base_.a, denominator).factor = factor;
  }

  /// By the Taylor coefficients of the function itself, which scaled_derivatives() knows.
  void by_coefficients(OpCode code) {
    switch (form_of(code)) {
      case Form::order: return function(base_.b, *constant(base_.a));
      case Form::parameter: return function(base_.a, *constant(base_.b));
      default: return function(base_.a, 0.0);
    }
  }
  void function(std::uint32_t argument, double parameter) {
    base_.culprit = argument;
    Step& step = emit(Kind::function, base_.target, argument);
    step.factor = parameter;
    step.c = static_cast<std::uint32_t>(program_.series_count);
    step.d = order_;
    program_.series_count += order_;
  }

  void lower(const Instruction& instruction);
  void lower_power(std::int64_t exponent);
  void drop_unread();
  void schedule();

  const Bytecode& code_;
  std::uint32_t order_;
  Program program_;
  Step base_;
  std::vector<std::optional<Power>> powers_;  ///< of the code's registers
  std::vector<std::size_t> readers_;          ///< how many read each register
};

void Lowering::lower(const Instruction& instruction) {
  switch (instruction.code) {
    case OpCode::add: emit(Kind::add, base_.target, base_.a, base_.b); return;
    case OpCode::subtract: emit(Kind::subtract, base_.target, base_.a, base_.b); return;
    case OpCode::multiply: product(base_.target, base_.a, base_.b); return;
    case OpCode::divide:
      if (const double* divisor = constant(base_.b)) {
        emit(Kind::divide_by_number, base_.target, base_.a).value = *divisor;
      } else {
        emit(Kind::divide, base_.target, base_.a, base_.b);
      }
      return;
    case OpCode::negate: affine(base_.target, nothing, -1.0, base_.a); return;
    case OpCode::multiply_add:
    case OpCode::multiply_subtract:
    case OpCode::negative_multiply_add: {
      const std::uint32_t rounded = new_series();
      product(rounded, base_.a, base_.b);
      if (instruction.code == OpCode::multiply_add) {
        emit(Kind::add, base_.target, rounded, instruction.c);
      } else if (instruction.code == OpCode::multiply_subtract) {
        emit(Kind::subtract, base_.target, rounded, instruction.c);
      } else {
        emit(Kind::subtract, base_.target, instruction.c, rounded);
      }
      return;
    }
    case OpCode::square: emit(Kind::square, base_.target, base_.a); return;
    case OpCode::integer_power: lower_power(static_cast<std::int32_t>(instruction.b)); return;
    case OpCode::power:
      if (const double* exponent = constant(base_.b)) {
        if (*exponent == std::nearbyint(*exponent) && std::abs(*exponent) <= std::numeric_limits<std::int32_t>::max()) {
          lower_power(static_cast<std::int64_t>(*exponent));
          return;
        }
        Step& step = emit(Kind::power, base_.target, base_.a);
        step.value = *exponent;
        step.positive = true;
      } else {
        const std::uint32_t logarithm = new_series();
        emit(Kind::quotient_integral, logarithm, base_.a, base_.a);
        const std::uint32_t exponent_of_e = new_series();
        product(exponent_of_e, logarithm, base_.b);
        emit(Kind::exponential, base_.target, exponent_of_e).c = new_series();
      }
      return;
    case OpCode::sin: with_derivative(Kind::circular, base_.target, new_series()); return;
    case OpCode::cos: with_derivative(Kind::circular, new_series(), base_.target); return;
    case OpCode::sincos: with_derivative(Kind::circular, base_.target, base_.b); return;
    case OpCode::sinh: with_derivative(Kind::hyperbolic, base_.target, new_series()); return;
    case OpCode::cosh: with_derivative(Kind::hyperbolic, new_series(), base_.target); return;
    case OpCode::tan: emit(Kind::tangent, base_.target, base_.a, new_series()); return;
    case OpCode::tanh: secant(1.0, new_series(), base_.target); return;
    case OpCode::sech: secant(1.0, base_.target, new_series()); return;
    case OpCode::csch: secant(-1.0, base_.target, new_series()); return;
    case OpCode::asin: integral(1.0, root_of(quadratic(1.0, -1.0))); return;
    case OpCode::acos: integral(-1.0, root_of(quadratic(1.0, -1.0))); return;
    case OpCode::atan: integral(1.0, quadratic(1.0, 1.0)); return;
    case OpCode::asinh: integral(1.0, root_of(quadratic(1.0, 1.0))); return;
    case OpCode::acosh: integral(1.0, root_of(quadratic(-1.0, 1.0))); return;
    case OpCode::atanh: integral(1.0, quadratic(1.0, -1.0)); return;
    case OpCode::atan2: emit(Kind::argument, base_.target, base_.a, base_.b).c = new_series(); return;
    case OpCode::exp: with_derivative(Kind::exponential, base_.target, 0); return;
    case OpCode::log: integral(1.0, base_.a); return;
    case OpCode::sqrt: emit(Kind::square_root, base_.target, base_.a); return;
    case OpCode::cbrt: emit(Kind::power, base_.target, base_.a).value = 1.0 / 3.0; return;
    case OpCode::abs: emit(Kind::absolute, base_.target, base_.a); return;
    case OpCode::sign: emit(Kind::sign, base_.target, base_.a); return;
    case OpCode::min: emit(Kind::minimum, base_.target, base_.a, base_.b); return;
    case OpCode::max: emit(Kind::maximum, base_.target, base_.a, base_.b); return;
    case OpCode::where_positive: emit(Kind::choice, base_.target, base_.a, base_.b); return;
    case OpCode::where_negative: emit(Kind::choice, base_.target, base_.a, base_.b).factor = -1.0; return;
    default: by_coefficients(instruction.code); return;
  }
}

/// Repeated squaring of the series, which needs no division by its leading part and so also works where that is 0.
void Lowering::lower_power(std::int64_t exponent) {
  if (exponent == 0) {
    emit(Kind::fill, base_.target, base_.a).value = 1.0;
    return;
  }
  std::uint32_t power = base_.a;
  std::uint32_t result = base_.a;
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
  if (exponent < 0) {
    emit(Kind::reciprocal, base_.target, result);
  } else if (result == base_.a) {
    affine(base_.target, nothing, 1.0, base_.a);
  } else {
    program_.steps.back().target = base_.target;  // the product or square just made is the result
  }
}

void Lowering::drop_unread() {
  std::vector<bool> read(program_.series_count, false);
  for (const std::uint32_t output : program_.outputs) {
    read[output] = true;
  }
  std::vector<Step> kept;
  for (auto step = program_.steps.rbegin(); step != program_.steps.rend(); ++step) {
    const Series made = made_by(*step);
    if (std::any_of(made.index, made.index + made.count, [&](std::uint32_t s) { return read[s]; })) {
      const Series sources = read_by(*step);
      std::for_each_n(sources.index, sources.count, [&](std::uint32_t s) { read[s] = true; });
      kept.push_back(*step);
    }
  }
  std::ranges::reverse(kept);
  program_.steps = std::move(kept);
}

/// Greedily the kind of which most are ready.
void Lowering::schedule() {
  const std::vector<Step>& steps = program_.steps;
  constexpr auto none = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> maker(program_.series_count, none);
  std::vector<std::size_t> missing(steps.size(), 0);
  std::vector<std::vector<std::size_t>> waiters(steps.size());
  std::array<std::vector<std::size_t>, kind_count> ready;
  const auto is_ready = [&](std::size_t i) { ready[static_cast<std::size_t>(steps[i].kind)].push_back(i); };
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const Series sources = read_by(steps[i]);
    for (std::size_t k = 0; k < sources.count; ++k) {
      if (const std::size_t made = maker[sources.index[k]]; made != none) {
        waiters[made].push_back(i);
        ++missing[i];
      }
    }
    const Series made = made_by(steps[i]);
    std::for_each_n(made.index, made.count, [&](std::uint32_t s) { maker[s] = i; });
    if (missing[i] == 0) {
      is_ready(i);
    }
  }
  while (program_.scheduled.size() < steps.size()) {
    auto& most = *std::ranges::max_element(ready, {}, [](const auto& group) { return group.size(); });
    const std::vector<std::size_t> group = std::exchange(most, {});
    program_.groups.push_back({steps[group.front()].kind, static_cast<std::uint32_t>(program_.scheduled.size()),
                               static_cast<std::uint32_t>(group.size())});
    for (const std::size_t i : group) {
      program_.scheduled.push_back(steps[i]);
      for (const std::size_t waiter : waiters[i]) {
        if (--missing[waiter] == 0) {
          is_ready(waiter);
        }
      }
    }
  }
}

}  // namespace

Series read_by(const Step& step) {
  switch (step.kind) {
    case Kind::fill: return {{}, 0};
    case Kind::add:
    case Kind::subtract:
    case Kind::multiply:
    case Kind::divide:
    case Kind::quotient_integral:
    case Kind::argument:
    case Kind::minimum:
    case Kind::maximum:
    case Kind::choice: return {{step.a, step.b}, 2};
    default: return {{step.a}, 1};
  }
}

Series made_by(const Step& step) {
  switch (step.kind) {
    case Kind::exponential: return {{step.target, step.c}, 2};
    case Kind::circular:
    case Kind::hyperbolic: return {{step.target, step.b, step.c}, 3};
    case Kind::tangent: return {{step.target, step.b}, 2};
    case Kind::secant: return {{step.target, step.b, step.c, step.d}, 4};
    case Kind::argument: return {{step.target, step.c}, 2};
    default: return {{step.target}, 1};
  }
}

Program lower(const Bytecode& code, int order) {
  if (reuses_registers(code)) {
    throw std::invalid_argument("Taylor arithmetic needs code compiled without reuse of registers");
  }
  return Lowering(code, order).run();
}

}  // namespace rubato::formula::taylor
