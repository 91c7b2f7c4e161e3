#pragma once

#include <rubato/formula/bytecode.hpp>

/// The functions that machine code calls: those that the interpreter calls for the same instruction.
namespace rubato::formula {

/// Of one argument or of two: what takes one leaves the second alone.
using ScalarFunction = double (*)(double a, double b);
/// What an instruction calls; null where it is made of the machine's own instructions (and for sincos).
[[nodiscard]] ScalarFunction scalar_function(OpCode code);
[[nodiscard]] bool is_called(OpCode code);

/// sin a and cos a.
using SineAndCosine = void (*)(double a, double* sine, double* cosine);
[[nodiscard]] SineAndCosine sincos_function();

}  // namespace rubato::formula
