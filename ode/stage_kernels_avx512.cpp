#if defined(__x86_64__)

#include <rubato/ode/stage_kernels.hpp>

// From here to the end of the file. Fused multiply-add is not switched on, so that every instruction set gives the same
// results.
#pragma GCC target("avx512f")

#include <rubato/ode/stage_kernels_code.hpp>

namespace rubato::stages {

Kernels kernels_avx512(int stages) {
  return stage_kernels_of<8>(stages);
}

}  // namespace rubato::stages

#endif
