// Compiled for vectors of two doubles, which every machine has; the flags are set in cmake/FormulaKernels.cmake.
#include <rubato/formula/vector_pair.hpp>

#define RUBATO_XSIMD_NAMESPACE rubato_xsimd_pair
#define RUBATO_XSIMD_ARCH RUBATO_XSIMD_PAIR
#include <rubato/formula/taylor_kernel.ipp>

namespace rubato::formula::taylor {

Kernel kernel_pair() {
  return {extend, feed_back, finite};
}

}  // namespace rubato::formula::taylor
