#pragma once

#include <cstddef>
#include <span>

#include <rubato/formula/bytecode.hpp>

/// Between BatchEvaluator and its vector kernels; of no use elsewhere.
///
/// The same source is compiled once per instruction set. All variants do the same roundings in the same order (none
/// contracts a product and a sum), so they give the same bits; the tests compare them.
namespace rubato::formula::batch {

inline constexpr std::size_t block_points = 256;
inline constexpr std::size_t widest_vector = 8;  ///< doubles in the widest vector of any kernel

/// One block of points. Reading and writing go through one pointer per register, so that inputs and outputs may stand
/// where the caller has them. Every pointer has `points` doubles behind it, a multiple of `widest_vector`.
struct Block {
  std::size_t points;
  const Instruction* begin;
  const Instruction* end;
  const double* const* read;
  double* const* write;
};

using Kernel = void (*)(const Block&);

void run_pair(const Block& block);
#if defined(__x86_64__)
void run_avx2(const Block& block);
void run_avx512(const Block& block);
#endif

struct NamedKernel {
  const char* name;
  int lanes;
  Kernel run;
  bool supported;  ///< by this machine
};
/// All kernels, narrowest first.
[[nodiscard]] std::span<const NamedKernel> kernels();

}  // namespace rubato::formula::batch
