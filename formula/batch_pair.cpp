// Compiled for vectors of two doubles, which every machine has; the flags are set in cmake/FormulaKernels.cmake.
#include <rubato/formula/vector_pair.hpp>

#define RUBATO_XSIMD_NAMESPACE rubato_xsimd_pair
#define RUBATO_XSIMD_ARCH RUBATO_XSIMD_PAIR
#include <rubato/formula/batch_kernel.ipp>

namespace rubato::formula::batch {

void run_pair(const Block& block) {
  run(block);
}

}  // namespace rubato::formula::batch
