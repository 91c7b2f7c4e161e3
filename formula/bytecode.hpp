#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// What an instruction does: the operations of the graph, strength-reduced and fused.
enum class OpCode : std::uint8_t {
  add,                    ///< r[target] = r[a] + r[b]
  subtract,               ///< r[a] - r[b]
  multiply,               ///< r[a] * r[b]
  divide,                 ///< r[a] / r[b]
  negate,                 ///< -r[a]
  multiply_add,           ///< r[a]*r[b] + r[c], product rounded (not contracted)
  multiply_subtract,      ///< r[a]*r[b] - r[c]
  negative_multiply_add,  ///< r[c] - r[a]*r[b]
  square,                 ///< r[a]*r[a]
  integer_power,          ///< r[a]^immediate, by repeated squaring; the immediate is `b` read as std::int32_t
  power,                  ///< pow(r[a], r[b])
  sin,
  cos,
  sincos,  ///< r[target] = sin r[a], r[b] = cos r[a]: `b` is a second target
  tan,
  asin,
  acos,
  atan,
  atan2,
  sinh,
  cosh,
  tanh,
  asinh,
  acosh,
  atanh,
  exp,
  log,
  sqrt,
  cbrt,
  abs,
  sech,
  csch,
  sign,
  min,  ///< NaN if either argument is
  max,
  erf,
  bessel_j,  ///< of the order r[a], a constant, at r[b]
  bessel_y,
  bessel_i,
  bessel_k,
  jacobi_sn,  ///< of r[a], with the parameter r[b], a constant
  jacobi_cn,
  jacobi_dn,
  where_positive,  ///< r[b] if r[a] > 0, else 0; NaN if r[a] is
  where_negative,  ///< r[b] if r[a] <= 0, else 0; NaN if r[a] is
};

/// How many of a, b, c are registers that an instruction reads: 1, 2 or 3 (integer_power and sincos: only a).
[[nodiscard]] int operand_count(OpCode code);

struct Instruction {
  OpCode code;
  std::uint32_t target = 0, a = 0, b = 0, c = 0;  ///< registers
};

/// Straight-line code for several formulas over the same inputs. Immutable; evaluation from many threads is safe, each
/// with its own workspace.
///
/// Registers are numbered: inputs first, then constants, then temporaries (reused when `reuse_registers`; Taylor
/// arithmetic needs every intermediate series and compiles without reuse). With reuse, a target may be the register of
/// an operand of the same instruction; inputs and constants are never written.
class Bytecode {
public:
  /// Code that computes `outputs` from `inputs` (variables of the same graph). Every variable the outputs depend on
  /// must be an input. \throws std::invalid_argument naming the first variable that is not
  Bytecode(std::span<const Expression> outputs, std::span<const Expression> inputs, bool reuse_registers = true);
  Bytecode() = default;

  [[nodiscard]] std::size_t input_count() const { return input_count_; }
  [[nodiscard]] std::size_t output_count() const { return outputs_.size(); }
  [[nodiscard]] std::size_t register_count() const { return register_count_; }
  [[nodiscard]] std::span<const double> constants() const { return constants_; }
  [[nodiscard]] std::span<const Instruction> instructions() const { return instructions_; }
  [[nodiscard]] std::span<const std::uint32_t> outputs() const { return outputs_; }  ///< register of each output

private:
  std::size_t input_count_ = 0;
  std::size_t register_count_ = 0;
  std::vector<double> constants_;
  std::vector<Instruction> instructions_;
  std::vector<std::uint32_t> outputs_;
};

/// Evaluates code at one point. Holds the registers (constants loaded once); no allocation in operator().
///
/// The instructions are put into another order than the code's, in which those of one kind that do not wait for each
/// other stand together: each such group is one tight loop, and its results fill consecutive registers. Every result is
/// the same double as in the order of the code.
class ScalarEvaluator {
public:
  explicit ScalarEvaluator(const Bytecode& code);  ///< copies the code
  ScalarEvaluator() = default;

  /// Writes all outputs. `inputs.size() == input_count()`, `outputs.size() == output_count()` (checked by assert).
  void operator()(std::span<const double> inputs, std::span<double> outputs);

  /// The same without copying: write the inputs here, run(), read outputs through output(i).
  [[nodiscard]] std::span<double> inputs() { return {registers_.data(), code_.input_count()}; }
  void run();
  [[nodiscard]] double output(std::size_t i) const { return registers_[output_registers_[i]]; }
  [[nodiscard]] const Bytecode& code() const { return code_; }

private:
  struct Fill {  ///< outputs first … first + count - 1 are one constant
    std::uint32_t first, count;
    double value;
  };
  struct Copy {
    std::uint32_t output, source;
  };
  void schedule();
  void plan_outputs();

  Bytecode code_;
  std::vector<std::uint32_t> stream_;  ///< groups in their new order: kind, length, operands
  std::vector<double> registers_;      ///< inputs, constants, then one for each result
  std::vector<std::uint32_t> output_registers_;
  std::vector<Fill> fills_;
  std::vector<Copy> copies_;
};

}  // namespace rubato::formula
