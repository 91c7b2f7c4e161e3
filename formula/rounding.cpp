#include <rubato/formula/rounding.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include <rubato/formula/arithmetic.hpp>
#include <rubato/formula/operations.hpp>
#include <rubato/formula/special.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato::formula {

namespace {

constexpr double unit = 0.5 * std::numeric_limits<double>::epsilon();

/// Terms that cancel by more than this make a sum that is small by accident.
constexpr double least_part = 0.03;

/// Of Bessel and elliptic functions, in units of their size and slope: near a zero the error is that of the argument.
constexpr double special_error = 16.0;

double slope_of(OpCode function, double parameter, double x) {
  std::array<double, 2> coefficients{};
  scaled_derivatives(function, parameter, x, coefficients);
  return coefficients[1];
}

/// Of functions that are not rounded correctly, in units of u·|result|.
constexpr double function_error = 2.0;

/// Error of an argument by the derivative there; no error is none, however steep the function.
double carried(double derivative, double error) {
  return error == 0.0 ? 0.0 : std::abs(derivative) * error;
}

/// Of √a = v. Where a is not known better than its size the derivative says nothing: |√(a + δ) - √a| ≤ √δ.
double of_square_root(double v, double da) {
  return (da == 0.0 ? 0.0 : std::min(0.5 / v * da, std::sqrt(da / unit))) + v;
}
double of_cube_root(double v, double a, double da) {
  return (da == 0.0 ? 0.0 : std::min(std::abs(v / (3.0 * a)) * da, 2.0 * std::cbrt(da * unit) / unit)) +
         2.0 * std::abs(v);
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
    // The errors that operations.inc names: of a value v with these slopes, in its two arguments or in one.
    const auto by_both = [&](double in_a, double in_b, double own) {
      return carried(in_a, da) + carried(in_b, bound[step.b]) + own * std::abs(v);
    };
    const auto by = [&](double in_a, double own) { return carried(in_a, da) + own * std::abs(v); };
    const auto of_bessel = [&](double n, double x, double dx) {
      const double slope = slope_of(step.code, n, x);
      return carried(slope, dx) + special_error * (std::abs(v) + std::abs(slope));
    };
    const auto of_jacobi = [&](double m, double u, double du) {
      const double slope = slope_of(step.code, m, u);
      return carried(slope, du) + special_error * (std::abs(v) + std::abs(u * slope));
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
      case OpCode::sincos: {
        const double sine = std::sin(a);
        const double cosine = std::cos(a);
        value[step.b] = cosine;
        bound[step.b] = carried(sine, da) + function_error * std::abs(cosine);
        set(sine, cosine, function_error);
        break;
      }
#define RUBATO_FUNCTION(id, name, form, is, symmetry, f, error, ...) \
  case OpCode::id: {                                                 \
    constexpr bool of_two = arity_of(Form::form) == 2;               \
    [[maybe_unused]] const double b = of_two ? value[step.b] : 0.0;  \
    [[maybe_unused]] const double db = of_two ? bound[step.b] : 0.0; \
    v = f;                                                           \
    e = error;                                                       \
    break;                                                           \
  }
#include <rubato/formula/operations.inc>
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

namespace {

/// A value, and its bound unless that is 0 for certain.
struct Rounded {
  Expression value;
  std::optional<Expression> bound = {};
};

/// The operations of RoundingEvaluator::run() as formulas.
class RoundingFormula {
public:
  /// The result of an instruction, of a sincos the sine; none of those that are not foreseen.
  std::optional<Rounded> operator()(const Instruction& step, std::span<const Rounded> registers) {
    const Rounded& a = registers[step.a];
    const auto b = [&]() -> const Rounded& { return registers[step.b]; };
    switch (step.code) {
      case OpCode::add: return sum(a.value + b().value, a, b());
      case OpCode::subtract: return sum(a.value - b().value, a, b());
      case OpCode::multiply: {
        const Expression v = a.value * b().value;
        return Rounded{v, plus(plus(carried(b().value, a), carried(a.value, b())), abs(v))};
      }
      case OpCode::divide: {
        const Expression v = a.value / b().value;
        return Rounded{v, plus(plus(carried(1.0 / b().value, a), carried(v / b().value, b())), abs(v))};
      }
      case OpCode::negate: return Rounded{-a.value, a.bound};
      case OpCode::multiply_add:
      case OpCode::multiply_subtract:
      case OpCode::negative_multiply_add: {
        const Rounded& c = registers[step.c];
        const Expression product = a.value * b().value;
        const Expression v = step.code == OpCode::multiply_add        ? product + c.value
                             : step.code == OpCode::multiply_subtract ? product - c.value
                                                                      : c.value - product;
        return Rounded{
            v, plus(plus(plus(plus(carried(b().value, a), carried(a.value, b())), abs(product)), c.bound), abs(v))};
      }
      case OpCode::square: return of_one(a.value * a.value, 2.0 * a.value, a, 1.0);
      case OpCode::integer_power: {
        const auto n = std::bit_cast<std::int32_t>(step.b);
        return of_one(pow(a.value, n), n * pow(a.value, n - 1), a, std::abs(static_cast<double>(n)));
      }
      case OpCode::abs: return Rounded{abs(a.value), a.bound};
      case OpCode::sqrt: {
        const Expression v = sqrt(a.value);
        return Rounded{v,
                       plus(a.bound ? std::optional(min(0.5 / v * *a.bound, sqrt(*a.bound / unit))) : std::nullopt, v)};
      }
      case OpCode::sincos:
      case OpCode::sin: return of_one(sin(a.value), cos(a.value), a, function_error);
      case OpCode::cos: return of_one(cos(a.value), sin(a.value), a, function_error);
      case OpCode::exp: return of_one(exp(a.value), exp(a.value), a, function_error);
      case OpCode::log: return of_one(log(a.value), 1.0 / a.value, a, function_error);
      default: return std::nullopt;
    }
  }
  Rounded cosine(const Rounded& a) { return of_one(cos(a.value), sin(a.value), a, function_error); }

private:
  static std::optional<Expression> plus(const std::optional<Expression>& a, const std::optional<Expression>& b) {
    return a && b ? std::optional(*a + *b) : a ? a : b;
  }
  static std::optional<Expression> carried(Expression derivative, const Rounded& a) {
    return a.bound ? std::optional(abs(derivative) * *a.bound) : std::nullopt;
  }
  static Rounded sum(Expression v, const Rounded& a, const Rounded& b) {
    return {v, plus(plus(a.bound, b.bound), abs(v))};
  }
  static Rounded of_one(Expression v, Expression derivative, const Rounded& a, double own) {
    return {v, plus(carried(derivative, a), own * abs(v))};
  }
};

/// Instructions of formulas whose machine code is made at once, and of those for which it is made at all.
constexpr std::size_t short_formula = 1000, longest_with_formula = 100'000;
/// It takes about as long as so many evaluations by the interpreter, of which it leaves hardly any time: 40 ms for the
/// 20 000 instructions of a chain of 1023 masses, of which one evaluation takes 14 µs.
constexpr std::size_t evaluations_worth_code = 3000;

}  // namespace

std::optional<Bytecode> rounding_code(const Bytecode& code) {
  Graph graph;
  RoundingFormula rounding;
  std::vector<Rounded> registers(code.register_count());
  std::vector<Expression> inputs;
  for (const char* const name : {"x{}", "e{}"}) {
    for (std::size_t i = 0; i < code.input_count(); ++i) {
      inputs.push_back(graph.variable(fmt::format(fmt::runtime(name), i)));
    }
  }
  for (std::size_t i = 0; i < code.input_count(); ++i) {
    registers[i] = {inputs[i], inputs[code.input_count() + i]};
  }
  for (std::size_t k = 0; k < code.constants().size(); ++k) {
    registers[code.input_count() + k] = {graph.constant(code.constants()[k])};
  }
  for (const Instruction& step : code.instructions()) {
    const std::optional<Rounded> result = rounding(step, registers);
    if (!result) {
      return std::nullopt;
    }
    if (step.code == OpCode::sincos) {
      registers[step.b] = rounding.cosine(registers[step.a]);
    }
    registers[step.target] = *result;
  }
  const auto outputs = code.outputs();
  Expression terms = graph.constant(0.0);
  for (std::size_t i = 1; i < outputs.size(); ++i) {
    terms += abs(registers[outputs[i]].value);
  }
  const Rounded& first = registers[outputs[0]];
  const std::array all{first.value, terms, first.bound ? *first.bound : graph.constant(0.0)};
  return Bytecode(all, inputs);
}

SumSizeEvaluator::SumSizeEvaluator(const Bytecode& code) : evaluator_(code), errors_(code.input_count(), 0.0) {}

void SumSizeEvaluator::prepare() {
  const std::size_t length = evaluator_.code().instructions().size();
  if (formula_ || length > longest_with_formula) {
    return;
  }
  if (length <= short_formula) {
    make_formula();
  } else {
    until_formula_ = evaluations_worth_code;
  }
}

void SumSizeEvaluator::make_formula() {
  if (const std::optional<Bytecode> code = rounding_code(evaluator_.code())) {
    formula_.emplace(*code);
  }
}

SumSize SumSizeEvaluator::operator()(std::span<const double> inputs, std::span<const double> errors) {
  const auto size_of = [](double sum, double terms, double bound) {
    return SumSize{.terms = std::max(std::abs(sum), least_part * terms),
                   .rounding = unit * (std::isfinite(bound) ? bound : terms)};
  };
  if (until_formula_ > 0 && --until_formula_ == 0) {
    make_formula();
  }
  if (formula_) {
    std::ranges::copy(errors, std::ranges::copy(inputs, formula_->inputs().begin()).out);
    formula_->run();
    // An error of 0 times an infinite derivative is the evaluator's to judge.
    if (std::isfinite(formula_->output(2))) {
      return size_of(formula_->output(0), formula_->output(1), formula_->output(2));
    }
  }
  evaluator_.run(inputs, errors);
  double terms = 0.0;
  for (std::size_t i = 1; i < evaluator_.output_count(); ++i) {
    terms += std::abs(evaluator_.value(i));
  }
  return size_of(evaluator_.value(0), terms, evaluator_.bound(0));
}

SumSize SumSizeEvaluator::operator()(std::span<const double> inputs) {
  std::ranges::transform(inputs, errors_.begin(), [](double x) { return 2.0 * std::abs(x); });
  return (*this)(inputs, errors_);
}

}  // namespace rubato::formula
