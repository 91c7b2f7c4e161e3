#pragma once

#include <rubato/formula/bytecode.hpp>

/// The functions that machine code calls: those that the interpreter calls for the same instruction.
namespace rubato::formula {

/// Whether an instruction is a call, of one or two doubles (sincos is another).
[[nodiscard]] bool is_called(OpCode code);
/// double (*)(double) or double (*)(double, double), by operand_count(code).
[[nodiscard]] const void* scalar_function(OpCode code);
/// void (*)(double, double* sine, double* cosine).
[[nodiscard]] const void* sincos_function();

}  // namespace rubato::formula
