// Compiled for avx2; the flags are set in cmake/FormulaKernels.cmake.
#if defined(__x86_64__)
#define RUBATO_XSIMD_NAMESPACE rubato_xsimd_avx2
#define RUBATO_XSIMD_ARCH avx2
#include <rubato/formula/taylor_kernel.ipp>

namespace rubato::formula::taylor {

Kernel kernel_avx2() {
  return {extend, feed_back, finite};
}

}  // namespace rubato::formula::taylor

#endif
