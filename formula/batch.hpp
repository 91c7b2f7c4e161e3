#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include <rubato/formula/bytecode.hpp>

namespace rubato::formula {

/// Evaluates code at many points, in blocks of at most 256 held in registers, with SIMD chosen once at run time for the
/// machine (the widest of SSE2, AVX2, AVX-512 that it has). A point's result does not depend on its place in the batch,
/// on its neighbours, nor on how a range is split between threads: remainders go through the same vector code, padded.
/// It does not depend on the instruction set either, except through the C library for the arguments listed below.
///
/// Arithmetic, square, integer powers, sqrt, abs, sign, min and max are the scalar evaluator's bit for bit. The largest
/// difference from it, in units in the last place, of the others: asin, acos, asinh, acosh, atanh, exp, log 2; sin,
/// cos, atan, sinh, cosh, tanh, cbrt 3; tan, sech, csch 4. Angles beyond 1e5, exponentials beyond 708, subnormal
/// arguments of log and cbrt, and all of pow and atan2 go through the C library one by one (5 to 20 ns each) and agree
/// bit for bit.
class BatchEvaluator {
public:
  explicit BatchEvaluator(const Bytecode& code);
  BatchEvaluator() = default;

  /// Structure of arrays: output j at point i is outputs[j][i], from inputs[m][i], for i in [0, points).
  /// Inputs and outputs may not overlap. No allocation. One evaluator per thread.
  void operator()(std::size_t points, std::span<const double* const> inputs, std::span<double* const> outputs);

  [[nodiscard]] const Bytecode& code() const { return code_; }

private:
  Bytecode code_;
  std::vector<double> registers_;    ///< blocks of 256 per register, aligned inside
  std::vector<const double*> read_;  ///< where each register is read and written during a block
  std::vector<double*> write_;
  std::vector<unsigned char> in_place_;  ///< whether output j can be computed where the caller wants it
};

/// "sse2", "avx2" or "avx512": what the batches of this process use.
[[nodiscard]] std::string_view simd_name();

}  // namespace rubato::formula
