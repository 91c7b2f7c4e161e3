#include <array>

#include <rubato/base/lanes.hpp>
#include <rubato/ode/stage_kernels_code.hpp>

namespace rubato::stages {

Kernels kernels_portable(int stages) {
  return stage_kernels_of<2>(stages);
}

std::span<const NamedKernels> all_kernels() {
#if defined(__x86_64__)
  static const std::array<NamedKernels, 3> all{{{"portable", kernels_portable, true},
                                                {"avx2", kernels_avx2, __builtin_cpu_supports("avx2") != 0},
                                                {"avx512", kernels_avx512, __builtin_cpu_supports("avx512f") != 0}}};
#else
  static const std::array<NamedKernels, 1> all{{{"portable", kernels_portable, true}}};
#endif
  return all;
}

Kernels kernels(int stages) {
#if defined(__x86_64__)
  const int lanes = lanes_asked_for();
  if ((lanes == 0 || lanes == 8) && __builtin_cpu_supports("avx512f")) {
    return kernels_avx512(stages);
  }
  if (lanes != 2 && __builtin_cpu_supports("avx2")) {
    return kernels_avx2(stages);
  }
#endif
  return kernels_portable(stages);
}

}  // namespace rubato::stages
