// Compiled for sse2; the flags are set in cmake/FormulaKernels.cmake.
#define RUBATO_XSIMD_NAMESPACE rubato_xsimd_sse2
#define RUBATO_XSIMD_ARCH sse2
#include <rubato/formula/taylor_kernel.ipp>

namespace rubato::formula::taylor {

Kernel kernel_sse2() {
  return {"sse2", extend, feed_back, finite};
}

}  // namespace rubato::formula::taylor
