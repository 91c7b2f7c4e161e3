#include <rubato/formula/rounding.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include <rubato/formula/rounding_steps.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato::formula {

namespace {

using rounding_steps::function_error;
using rounding_steps::sum_in_eights;
using rounding_steps::unit;

/// Terms that cancel by more than this make a sum that is small by accident.
constexpr double least_part = 0.03;

}  // namespace

RoundingEvaluator::RoundingEvaluator(const Bytecode& code)
    : code_(code), values_(code.register_count(), 0.0), bounds_(code.register_count(), 0.0) {
  std::ranges::copy(code_.constants(), values_.begin() + static_cast<std::ptrdiff_t>(code_.input_count()));
}

void RoundingEvaluator::run(std::span<const double> inputs, std::span<const double> errors) {
  assert(inputs.size() == code_.input_count() && errors.size() == code_.input_count());
  std::ranges::copy(inputs, values_.begin());
  std::ranges::copy(errors, bounds_.begin());
  for (const Instruction& step : code_.instructions()) {
    take_rounded_step(step, values_.data(), bounds_.data());
  }
}

Bytecode sum_size_code(Expression sum, std::span<const Expression> inputs) {
  std::vector<Expression> outputs = {sum};
  std::ranges::copy(terms_of(sum), std::back_inserter(outputs));
  return {outputs, inputs};
}

namespace {

/// A value, and its bound unless that is 0 for certain.
struct RoundedExpression {
  Expression value;
  std::optional<Expression> bound = {};
};

/// The operations of RoundingEvaluator::run() as formulas.
class RoundingFormula {
public:
  /// The result of an instruction, of a sincos the sine; none of those that are not foreseen.
  std::optional<RoundedExpression> operator()(const Instruction& step, std::span<const RoundedExpression> registers) {
    const RoundedExpression& a = registers[step.a];
    const auto b = [&]() -> const RoundedExpression& { return registers[step.b]; };
    switch (step.code) {
      case OpCode::add: return sum(a.value + b().value, a, b());
      case OpCode::subtract: return sum(a.value - b().value, a, b());
      case OpCode::multiply: {
        const Expression v = a.value * b().value;
        return RoundedExpression{v, plus(plus(carried(b().value, a), carried(a.value, b())), abs(v))};
      }
      case OpCode::divide: {
        const Expression v = a.value / b().value;
        return RoundedExpression{v, plus(plus(carried(1.0 / b().value, a), carried(v / b().value, b())), abs(v))};
      }
      case OpCode::negate: return RoundedExpression{-a.value, a.bound};
      case OpCode::multiply_add:
      case OpCode::multiply_subtract:
      case OpCode::negative_multiply_add: {
        const RoundedExpression& c = registers[step.c];
        const Expression product = a.value * b().value;
        const Expression v = step.code == OpCode::multiply_add        ? product + c.value
                             : step.code == OpCode::multiply_subtract ? product - c.value
                                                                      : c.value - product;
        return RoundedExpression{
            v, plus(plus(plus(plus(carried(b().value, a), carried(a.value, b())), abs(product)), c.bound), abs(v))};
      }
      case OpCode::square: return of_one(a.value * a.value, 2.0 * a.value, a, 1.0);
      case OpCode::integer_power: {
        const auto n = std::bit_cast<std::int32_t>(step.b);
        return of_one(pow(a.value, n), n * pow(a.value, n - 1), a, std::abs(static_cast<double>(n)));
      }
      case OpCode::abs: return RoundedExpression{abs(a.value), a.bound};
      case OpCode::sqrt: {
        const Expression v = sqrt(a.value);
        return RoundedExpression{
            v, plus(a.bound ? std::optional(min(0.5 / v * *a.bound, sqrt(*a.bound / unit))) : std::nullopt, v)};
      }
      case OpCode::sincos:
      case OpCode::sin: return of_one(sin(a.value), cos(a.value), a, function_error);
      case OpCode::cos: return of_one(cos(a.value), sin(a.value), a, function_error);
      case OpCode::exp: return of_one(exp(a.value), exp(a.value), a, function_error);
      case OpCode::log: return of_one(log(a.value), 1.0 / a.value, a, function_error);
      default: return std::nullopt;
    }
  }
  RoundedExpression cosine(const RoundedExpression& a) { return of_one(cos(a.value), sin(a.value), a, function_error); }

private:
  static std::optional<Expression> plus(const std::optional<Expression>& a, const std::optional<Expression>& b) {
    return a && b ? std::optional(*a + *b) : a ? a : b;
  }
  static std::optional<Expression> carried(Expression derivative, const RoundedExpression& a) {
    return a.bound ? std::optional(abs(derivative) * *a.bound) : std::nullopt;
  }
  static RoundedExpression sum(Expression v, const RoundedExpression& a, const RoundedExpression& b) {
    return {v, plus(plus(a.bound, b.bound), abs(v))};
  }
  static RoundedExpression of_one(Expression v, Expression derivative, const RoundedExpression& a, double own) {
    return {v, plus(carried(derivative, a), own * abs(v))};
  }
};

/// Instructions of formulas whose machine code is made at once, and of those for which it is made at all.
constexpr std::size_t short_formula = 1000, longest_with_formula = 100'000;
/// It takes about as long as so many evaluations by the interpreter, of which it leaves hardly any time; and as so many
/// times what it saves beside rolled code, two thirds.
constexpr std::size_t evaluations_worth_code = 3000, rolled_evaluations_worth_code = 10'000;

}  // namespace

std::optional<Bytecode> rounding_code(const Bytecode& code) {
  Graph graph;
  RoundingFormula rounding;
  std::vector<RoundedExpression> registers(code.register_count());
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
    const std::optional<RoundedExpression> result = rounding(step, registers);
    if (!result) {
      return std::nullopt;
    }
    if (step.code == OpCode::sincos) {
      registers[step.b] = rounding.cosine(registers[step.a]);
    }
    registers[step.target] = *result;
  }
  const auto outputs = code.outputs();
  const Expression terms = sum_in_eights(outputs.size() - 1, graph.constant(0.0),
                                         [&](std::size_t i) { return abs(registers[outputs[1 + i]].value); });
  const RoundedExpression& first = registers[outputs[0]];
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
    return;
  }
  roll();
  if (until_formula_ == 0) {
    until_formula_ = rolled_ ? rolled_evaluations_worth_code : evaluations_worth_code;
  }
}

void SumSizeEvaluator::roll() {
  if (!rolled_) {
    rolled_ = RolledRounding::of(evaluator_.code());
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
  if (rolled_) {
    rolled_->run(inputs, errors);
    if (std::isfinite(rolled_->bound(0))) {
      return size_of(rolled_->value(0), rolled_->terms(), rolled_->bound(0));
    }
  }
  evaluator_.run(inputs, errors);
  const double terms = sum_in_eights(evaluator_.output_count() - 1, 0.0,
                                     [&](std::size_t i) { return std::abs(evaluator_.value(1 + i)); });
  return size_of(evaluator_.value(0), terms, evaluator_.bound(0));
}

SumSize SumSizeEvaluator::operator()(std::span<const double> inputs) {
  std::ranges::transform(inputs, errors_.begin(), [](double x) { return 2.0 * std::abs(x); });
  return (*this)(inputs, errors_);
}

}  // namespace rubato::formula
