#pragma once

#include <cstddef>
#include <memory>
#include <utility>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/executable_memory.hpp>

namespace rubato::formula {

/// A Bytecode as one function for this machine, values in registers, in loops over several numbers at a time where it
/// does the same again and again (rolled_code.hpp). It does the operations of the code in the order of the code, as far
/// as they wait for each other, each rounded by itself, and calls the functions that the interpreter calls: its results
/// are the interpreter's, bit for bit (which NaN a result is, if it is one, is left open).
class MachineCode {
public:
  /// `outputs` overlaps nothing; `work` has work_size() numbers of room.
  using Function = void (*)(const double* inputs, double* outputs, double* work);

  struct Layout {
    std::size_t bytes, entry;
    bool writes_constants;
    std::size_t work_size;
    bool in_loops;
  };
  MachineCode(ExecutableMemory memory, const Layout& layout) : memory_(std::move(memory)), layout_(layout) {}

  /// None where the processor is no x86-64 with AVX, the library was built without asmjit, the code is too long to gain
  /// by it (longest_machine_code, most_machine_code_outputs), or the system gives no executable pages.
  [[nodiscard]] static std::unique_ptr<const MachineCode> compile(const Bytecode& code);

  /// Writes every output that is no constant.
  [[nodiscard]] Function function() const;
  /// Writes every output; none where the constants among them are too many.
  [[nodiscard]] Function whole() const;
  [[nodiscard]] std::size_t work_size() const { return layout_.work_size; }
  /// True if most of it goes in loops over several numbers at a time (rolled_code.hpp).
  [[nodiscard]] bool in_loops() const { return layout_.in_loops; }
  [[nodiscard]] std::size_t bytes() const { return layout_.bytes; }  ///< of code and constants

private:
  ExecutableMemory memory_;
  Layout layout_;
};

/// True if the environment lets formulas be compiled to machine code: RUBATO_JIT=0 says no, RUBATO_JIT=1 or nothing
/// yes. \throws std::invalid_argument if it says something else
[[nodiscard]] bool machine_code_wanted();

/// Instructions beyond which code is interpreted: it would no longer fit the caches of the processor.
inline constexpr std::size_t longest_machine_code = 200'000;
/// Outputs beyond which it is, too: those of a Hessian that is nearly all zeros, which take longer to hand over.
inline constexpr std::size_t most_machine_code_outputs = 1'000'000;

}  // namespace rubato::formula
