#include <rubato/ode/state_kernels.hpp>

#include <bit>
#include <cstdint>
#include <limits>

#include <rubato/base/lanes.hpp>

namespace rubato {

namespace {

[[gnu::always_inline]] inline void move_all(std::size_t n, double factor, const double* __restrict gradient,
                                            const double* __restrict high, const double* __restrict low,
                                            double* __restrict delta, double* __restrict point) {
  for (std::size_t i = 0; i < n; ++i) {
    const double changed = delta[i] + factor * gradient[i];
    delta[i] = changed;
    point[i] = high[i] + (low[i] + changed);
  }
}

/// A number of two parts and what is added to it.
[[gnu::always_inline]] inline void add_one(double before, double low, double delta, double& to_high, double& to_low) {
  const double sum = before + delta;
  const double part = sum - before;
  const double rest = low + ((before - (sum - part)) + (delta - part));
  const double rounded = sum + rest;
  to_high = rounded;
  to_low = rest - (rounded - sum);
}

[[gnu::always_inline]] inline void add_all(std::size_t n, const double* __restrict delta, double* __restrict high,
                                           double* __restrict low) {
  for (std::size_t i = 0; i < n; ++i) {
    add_one(high[i], low[i], delta[i], high[i], low[i]);
  }
}

[[gnu::always_inline]] inline void displace_all(std::size_t n, double factor, const double* gradient,
                                                const double* high, const double* low, double* to_high,
                                                double* to_low) {
#pragma GCC ivdep
  for (std::size_t i = 0; i < n; ++i) {
    add_one(high[i], low[i], factor * gradient[i], to_high[i], to_low[i]);
  }
}

[[gnu::always_inline]] inline bool all_finite(std::size_t n, const double* __restrict numbers) {
  std::uint64_t largest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint64_t magnitude = std::bit_cast<std::uint64_t>(numbers[i]) << 1U;
    largest = largest > magnitude ? largest : magnitude;
  }
  return largest < std::bit_cast<std::uint64_t>(std::numeric_limits<double>::infinity()) << 1U;
}

void move_portable(std::size_t n, double factor, const double* gradient, const double* high, const double* low,
                   double* delta, double* point) {
  move_all(n, factor, gradient, high, low, delta, point);
}
void add_portable(std::size_t n, const double* delta, double* high, double* low) {
  add_all(n, delta, high, low);
}

void displace_portable(std::size_t n, double factor, const double* gradient, const double* high, const double* low,
                       double* to_high, double* to_low) {
  displace_all(n, factor, gradient, high, low, to_high, to_low);
}
bool finite_portable(std::size_t n, const double* numbers) {
  return all_finite(n, numbers);
}

#if defined(__x86_64__)
[[gnu::target("avx2")]] void displace_avx2(std::size_t n, double factor, const double* gradient, const double* high,
                                           const double* low, double* to_high, double* to_low) {
  displace_all(n, factor, gradient, high, low, to_high, to_low);
}
[[gnu::target("avx2")]] bool finite_avx2(std::size_t n, const double* numbers) {
  return all_finite(n, numbers);
}
[[gnu::target("avx512f,prefer-vector-width=512")]] void displace_avx512(std::size_t n, double factor,
                                                                        const double* gradient, const double* high,
                                                                        const double* low, double* to_high,
                                                                        double* to_low) {
  displace_all(n, factor, gradient, high, low, to_high, to_low);
}
[[gnu::target("avx512f,prefer-vector-width=512")]] bool finite_avx512(std::size_t n, const double* numbers) {
  return all_finite(n, numbers);
}
[[gnu::target("avx2")]] void move_avx2(std::size_t n, double factor, const double* gradient, const double* high,
                                       const double* low, double* delta, double* point) {
  move_all(n, factor, gradient, high, low, delta, point);
}
[[gnu::target("avx2")]] void add_avx2(std::size_t n, const double* delta, double* high, double* low) {
  add_all(n, delta, high, low);
}
[[gnu::target("avx512f,prefer-vector-width=512")]] void move_avx512(std::size_t n, double factor,
                                                                    const double* gradient, const double* high,
                                                                    const double* low, double* delta, double* point) {
  move_all(n, factor, gradient, high, low, delta, point);
}
[[gnu::target("avx512f,prefer-vector-width=512")]] void add_avx512(std::size_t n, const double* delta, double* high,
                                                                   double* low) {
  add_all(n, delta, high, low);
}
#endif

StateKernels widest() {
#if defined(__x86_64__)
  const int lanes = lanes_asked_for();
  if ((lanes == 0 || lanes == 8) && __builtin_cpu_supports("avx512f") != 0) {
    return {move_avx512, add_avx512, displace_avx512, finite_avx512};
  }
  if (lanes != 2 && __builtin_cpu_supports("avx2") != 0) {
    return {move_avx2, add_avx2, displace_avx2, finite_avx2};
  }
#endif
  return {move_portable, add_portable, displace_portable, finite_portable};
}

}  // namespace

const StateKernels& state_kernels() {
  static const StateKernels kernels = widest();
  return kernels;
}

}  // namespace rubato
