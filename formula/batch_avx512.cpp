// Compiled for avx512; the flags are set in cmake/FormulaKernels.cmake.
#if defined(__x86_64__)
#define RUBATO_XSIMD_NAMESPACE rubato_xsimd_avx512
#define RUBATO_XSIMD_ARCH avx512bw
#include <rubato/formula/batch_kernel.ipp>

namespace rubato::formula::batch {

void run_avx512(const Block& block) {
  run(block);
}

}  // namespace rubato::formula::batch

#endif
