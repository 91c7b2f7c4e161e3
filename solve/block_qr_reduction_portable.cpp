#include <array>
#include <cmath>

#include <rubato/base/lanes.hpp>
#include <rubato/solve/block_qr_reduction_code.hpp>

namespace rubato::solve::chunks {
namespace {

using Two = double __attribute__((vector_size(16)));
using Four = double __attribute__((vector_size(32)));
using Eight = double __attribute__((vector_size(64)));

template <typename Vector>
struct PortableLanes {
  using V = Vector;
  static constexpr int lanes = sizeof(V) / sizeof(double);
  static V sqrt(V v) {
    for (int l = 0; l < lanes; ++l) {
      v[l] = std::sqrt(v[l]);
    }
    return v;
  }
};

}  // namespace

Kernels kernels_portable(int d) {
  return choose_kernels<PortableLanes<Two>>(d);
}

// For tests alone, hence without code for the common sizes.
Kernels kernels_portable_4(int /*d*/) {
  return kernels_with<PortableLanes<Four>, 0>();
}
Kernels kernels_portable_8(int /*d*/) {
  return kernels_with<PortableLanes<Eight>, 0>();
}

std::span<const NamedKernels> all_kernels() {
#if defined(__x86_64__)
  static const std::array<NamedKernels, 5> all{{{"2 lanes", kernels_portable, true},
                                                {"4 lanes", kernels_portable_4, true},
                                                {"8 lanes", kernels_portable_8, true},
                                                {"avx2", kernels_avx2, __builtin_cpu_supports("avx2") != 0},
                                                {"avx512", kernels_avx512, __builtin_cpu_supports("avx512f") != 0}}};
#else
  static const std::array<NamedKernels, 3> all{{{"2 lanes", kernels_portable, true},
                                                {"4 lanes", kernels_portable_4, true},
                                                {"8 lanes", kernels_portable_8, true}}};
#endif
  return all;
}

Kernels kernels(int d) {
  const int lanes = lanes_asked_for();
#if defined(__x86_64__)
  if ((lanes == 0 || lanes == 8) && __builtin_cpu_supports("avx512f")) {
    return kernels_avx512(d);
  }
  if ((lanes == 0 || lanes == 4) && __builtin_cpu_supports("avx2")) {
    return kernels_avx2(d);
  }
#endif
  switch (lanes) {
    case 4: return kernels_portable_4(d);
    case 8: return kernels_portable_8(d);
    default: return kernels_portable(d);
  }
}

}  // namespace rubato::solve::chunks
