// Compiled for sse2; the flags are set in cmake/FormulaKernels.cmake.
#define RUBATO_XSIMD_NAMESPACE rubato_xsimd_sse2
#define RUBATO_XSIMD_ARCH sse2
#include <rubato/formula/batch_kernel.ipp>

namespace rubato::formula::batch {

void run_sse2(const Block& block) {
  run(block);
}

}  // namespace rubato::formula::batch
