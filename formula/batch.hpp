#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include <rubato/formula/bytecode.hpp>

namespace rubato::formula {

/// Evaluates code at many points, in blocks of at most 256 held in registers, with SIMD chosen once at run time for the machine
/// (the widest of SSE2, AVX2+FMA, AVX-512 that it has). A point's result does not depend on its place in the batch nor
/// on how a range is split between threads: remainders go through the same vector code, padded.
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
  std::vector<double> registers_;  ///< blocks of 256 per register, aligned inside
};

/// "sse2", "avx2" or "avx512": what the batches of this process use.
[[nodiscard]] std::string_view simd_name();

}  // namespace rubato::formula
