#if defined(__x86_64__)

#include <immintrin.h>

#include <algorithm>
#include <cmath>

#include <rubato/solve/block_qr_reduction.hpp>

// From here to the end of the file, templates instantiated there included. Fused multiply-add is not switched on, so
// that every instruction set gives the same results.
#pragma GCC target("avx512f")

#include <rubato/solve/block_qr_reduction_code.hpp>

namespace rubato::solve::chunks {
namespace {

struct EightLanes {
  using V = double __attribute__((vector_size(64)));
  static constexpr int lanes = 8;
  // (the plain form draws a false warning from GCC 12)
  static V sqrt(V v) { return _mm512_maskz_sqrt_pd(0xff, v); }
};

}  // namespace

Kernels kernels_avx512(int d) {
  return choose_kernels<EightLanes>(d);
}

}  // namespace rubato::solve::chunks

#endif
