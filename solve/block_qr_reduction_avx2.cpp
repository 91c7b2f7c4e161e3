#if defined(__x86_64__)

#include <immintrin.h>

#include <algorithm>
#include <cmath>

#include <rubato/solve/block_qr_reduction.hpp>

// From here to the end of the file, templates instantiated there included. Fused multiply-add is not switched on, so
// that every instruction set gives the same results.
#pragma GCC target("avx2")

#include <rubato/solve/block_qr_reduction_code.hpp>

namespace rubato::solve::chunks {
namespace {

struct FourLanes {
  using V = double __attribute__((vector_size(32)));
  static constexpr int lanes = 4;
  static V sqrt(V v) { return _mm256_sqrt_pd(v); }
};

}  // namespace

Kernels kernels_avx2(int d) {
  return choose_kernels<FourLanes>(d);
}

}  // namespace rubato::solve::chunks

#endif
