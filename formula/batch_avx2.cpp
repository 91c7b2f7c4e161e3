// Compiled for avx2; the flags are set in cmake/FormulaKernels.cmake.
#if defined(__x86_64__)
#define RUBATO_XSIMD_NAMESPACE rubato_xsimd_avx2
#define RUBATO_XSIMD_ARCH avx2
#include <rubato/formula/batch_kernel.ipp>

namespace rubato::formula::batch {

void run_avx2(const Block& block) {
  run(block);
}

}  // namespace rubato::formula::batch

#endif
