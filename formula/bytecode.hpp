#pragma once

#include <cassert>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <rubato/base/copied.hpp>
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
  sincos,                 ///< r[target] = sin r[a], r[b] = cos r[a]: `b` is a second target
#define RUBATO_FUNCTION(id, ...) id,
#include <rubato/formula/operations.inc>  // of r[a], or of r[a] and r[b]
  where_positive,                         ///< r[b] if r[a] > 0, else 0; NaN if r[a] is
  where_negative,                         ///< r[b] if r[a] <= 0, else 0; NaN if r[a] is
};

/// How many of a, b, c are registers that an instruction reads: 1, 2 or 3 (integer_power and sincos: only a).
[[nodiscard]] int operand_count(OpCode code);

struct Instruction {
  OpCode code;
  std::uint32_t target = 0, a = 0, b = 0, c = 0;  ///< registers
};

class MachineCode;
class LazyMachineCode;
class LoopEvaluator;
struct LoopProgram;

/// Code for several formulas over the same inputs, straight-line unless the formulas have loops (loop.hpp). Immutable;
/// evaluation from many threads is safe, each with its own workspace.
///
/// Code with loops is a LoopProgram, and has no instructions of its own. Without reuse of registers loops are unrolled.
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

  /// The same for this machine (machine_code.hpp), made when it is first asked for and shared by all copies; none where
  /// there is none to be had. Lives as long as any copy.
  [[nodiscard]] const MachineCode* machine_code() const;
  [[nodiscard]] LazyMachineCode* lazy_machine_code() const { return machine_code_.get(); }
  [[nodiscard]] const std::shared_ptr<const LoopProgram>& loops() const { return loops_; }  ///< none: straight-line

private:
  void compile(std::span<const Expression> outputs, std::span<const Expression> inputs, bool reuse_registers);

  std::size_t input_count_ = 0;
  std::size_t register_count_ = 0;
  std::vector<double> constants_;
  std::vector<Instruction> instructions_;
  std::vector<std::uint32_t> outputs_;
  std::shared_ptr<LazyMachineCode> machine_code_;
  std::shared_ptr<const LoopProgram> loops_;
};

/// What evaluates code: the machine itself where it can, or the interpreter alone. Both give the same doubles.
enum class Engine : std::uint8_t { automatic, interpreter };

/// Evaluates code at one point, by machine code where there is some, else by an interpreter; every result is the same
/// double. Holds its work space: one evaluator per thread. No allocation after construction.
///
/// The interpreter puts the instructions into another order than the code's, in which those of one kind that do not
/// wait for each other stand together: each such group is one tight loop, and its results fill consecutive registers.
class ScalarEvaluator {
public:
  explicit ScalarEvaluator(const Bytecode& code, Engine engine = Engine::automatic);  ///< copies the code
  ScalarEvaluator() = default;

  /// Writes all outputs. `inputs.size() == input_count()`, `outputs.size() == output_count()` (checked by assert).
  void operator()(std::span<const double> inputs, std::span<double> outputs) {
    assert(inputs.size() == code_.input_count() && outputs.size() == code_.output_count());
    // What is written in place may be what is still to be read.
    const std::less<const double*> before;
    if (whole_ != nullptr && (!before(inputs.data(), outputs.data() + outputs.size()) ||
                              !before(outputs.data(), inputs.data() + inputs.size()))) {
      whole_(inputs.data(), outputs.data(), work_.data());
    } else {
      by_copy(inputs.data(), outputs);
    }
  }

  /// The same without copying: write the inputs here, run(), read outputs through output(i).
  [[nodiscard]] std::span<double> inputs() { return {memory_.data(), code_.input_count()}; }
  void run() { at(memory_.data()); }
  [[nodiscard]] double output(std::size_t i) const { return memory_[first_output_ + i]; }
  /// All outputs at a point of input_count() numbers, as they stand in this evaluator until it is used again.
  const double* at(const double* point) {
    double* const outputs = memory_.data() + first_output_;
    if (run_ != nullptr) {
      run_(point, outputs, work_.data());
    } else {
      interpret(point);
    }
    return outputs;
  }

  [[nodiscard]] const Bytecode& code() const { return code_; }
  [[nodiscard]] bool is_machine_code() const { return run_ != nullptr; }

private:
  struct Fill {  ///< outputs first … first + count - 1 are one constant
    std::uint32_t first, count;
    double value;
  };
  struct Copy {
    std::uint32_t output, source;
  };
  void schedule();
  void plan_outputs(std::span<const std::uint32_t> registers);
  void interpret(const double* point);
  void run_stream();
  void by_copy(const double* point, std::span<double> outputs);

  Bytecode code_;
  using Function = void (*)(const double* inputs, double* outputs, double* work);
  Function run_ = nullptr;    ///< machine code that leaves out constants
  Function whole_ = nullptr;  ///< and that does not
  std::size_t first_output_ = 0;
  std::vector<double> memory_;  ///< inputs, outputs: those that are constants were written once
  std::vector<double> work_;    ///< of machine code, or the interpreter's registers: inputs, constants, each result
  std::vector<std::uint32_t> stream_;  ///< the interpreter's groups in their new order: kind, length, operands
  std::vector<Fill> fills_;            ///< outputs that are constants
  std::vector<Copy> copies_;           ///< and all others
  Copied<LoopEvaluator> loops_;        ///< of code with loops
};

}  // namespace rubato::formula
