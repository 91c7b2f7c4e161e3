#include <cmath>

#include <rubato/solve/chunk_elimination_code.hpp>

namespace rubato::solve::chunks {
namespace {

struct TwoLanes {
  using V = double __attribute__((vector_size(16)));
  static constexpr int lanes = 2;
  static V sqrt(V v) { return V{std::sqrt(v[0]), std::sqrt(v[1])}; }
};

}  // namespace

Kernels kernels_portable(int d) {
  return choose_kernels<TwoLanes>(d);
}

Kernels kernels(int d) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f")) {
    return kernels_avx512(d);
  }
  if (__builtin_cpu_supports("avx2")) {
    return kernels_avx2(d);
  }
#endif
  return kernels_portable(d);
}

}  // namespace rubato::solve::chunks
