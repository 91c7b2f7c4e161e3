#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include <rubato/formula/bytecode.hpp>

namespace rubato::formula {

class BatchProgram;

/// Which functions batches call: those of the vector kernels, or the scalar evaluator's, one point after the other.
/// With the latter every result is the scalar evaluator's, bit for bit.
enum class BatchFunctions : std::uint8_t { vector, scalar };

/// Evaluates code at many points, in blocks of at most 256 held in registers, with SIMD chosen once at run time for the
/// machine (the widest of SSE2, AVX2, AVX-512 that it has; base/lanes.hpp). A point's result does not depend on its
/// place in the batch, on its neighbours, nor on how a range is split between threads: remainders go through the same
/// vector code, padded. It does not depend on the instruction set either, except through the C library for the
/// arguments listed below.
///
/// Arithmetic, square, integer powers, sqrt, abs, sign, min and max are the scalar evaluator's bit for bit (products
/// are rounded before they are added). The largest difference from it found over 1e5 arguments of all sizes, in units
/// in the last place, of the others: asin, acos, asinh, acosh, exp, log 1; sin, cos, atan, sinh, cosh, tanh, sech,
/// atanh 2; tan, csch, cbrt 3. Angles beyond 1e5, exponentials beyond 708, subnormal arguments of log and cbrt,
/// arguments outside the domain, and all of pow and atan2 go through the C library one by one (5 to 20 ns each) and
/// agree bit for bit. Which NaN a result is, if it is one, is left open. Fastest when the arrays are aligned to 64
/// bytes.
///
/// Arithmetic is done by machine code where there is some (batch_program.hpp), all else, and everything elsewhere, one
/// instruction after the other over the block, with the same results bit for bit.
class BatchEvaluator {
public:
  explicit BatchEvaluator(const Bytecode& code, Engine engine = Engine::automatic,
                          BatchFunctions functions = BatchFunctions::vector);
  BatchEvaluator() = default;

  /// Structure of arrays: output j at point i is outputs[j][i], from inputs[m][i], for i in [0, points).
  /// Inputs and outputs may not overlap. No allocation. One evaluator per thread.
  void operator()(std::size_t points, std::span<const double* const> inputs, std::span<double* const> outputs);

  /// The same for few points that stay where they are and are evaluated often: run() evaluates at the places that
  /// bind() was reported, of which nothing is looked up again. At most 256 points.
  ///@{
  void bind(std::size_t points, std::span<const double* const> inputs, std::span<double* const> outputs);
  void run();
  ///@}

  [[nodiscard]] const Bytecode& code() const { return code_; }
  [[nodiscard]] bool is_machine_code() const { return program_ != nullptr; }

private:
  /// True if so many points are evaluated where the caller has them, not in a copy padded to whole vectors.
  [[nodiscard]] bool in_place(std::size_t points) const;
  void find_registers();
  void run_bound();
  void run_loops(std::size_t points, std::span<const double* const> inputs, std::span<double* const> outputs);

  Bytecode code_;
  BatchFunctions functions_ = BatchFunctions::vector;
  std::shared_ptr<const BatchProgram> program_;
  struct alignas(64) Chunk {  ///< keeps the registers aligned to the widest vector when the evaluator is copied
    double values[8];
  };
  std::vector<Chunk> registers_;     ///< blocks of 256 points per register; the constants' are filled once
  std::vector<const double*> read_;  ///< where each register is read and written during a block
  std::vector<double*> write_;
  const double* base_ = nullptr;         ///< of the registers that the two point to
  std::vector<unsigned char> in_place_;  ///< whether output j can be computed where the caller wants it
  std::vector<Chunk> work_;              ///< of machine code
  Copied<ScalarEvaluator> loops_;        ///< of code with loops, which goes point by point

  /// What bind() was reported and found.
  struct Places {
    std::size_t points = 0;
    std::vector<const double*> inputs;
    std::vector<double*> outputs;
    struct Copy {
      const double* from;
      double* to;
    };
    std::vector<Copy> copies;  ///< outputs that cannot be computed where the caller wants them
    bool stand = false;        ///< true if read_ and write_ are these still
    void (*all)(double* const*, double*, std::size_t, std::size_t) = nullptr;  ///< machine code that does it in one go
  };
  Places bound_;
};

/// "sse2", "avx2", "avx512" or "neon64": what the batches of this process use.
[[nodiscard]] std::string_view simd_name();

}  // namespace rubato::formula
