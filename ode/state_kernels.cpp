#include <rubato/ode/state_kernels.hpp>

#include <bit>
#include <cstdint>
#include <limits>

#include <rubato/grids/wide_vectors.hpp>

namespace rubato {

namespace {

/// A number of two parts and what is added to it.
[[gnu::always_inline]] inline void add_one(double before, double low, double delta, double& to_high, double& to_low) {
  const double sum = before + delta;
  const double part = sum - before;
  const double rest = low + ((before - (sum - part)) + (delta - part));
  const double rounded = sum + rest;
  to_high = rounded;
  to_low = rest - (rounded - sum);
}

}  // namespace

RUBATO_WIDE_VECTORS void move_state(std::size_t n, double factor, const double* __restrict gradient,
                                    const double* __restrict high, const double* __restrict low,
                                    double* __restrict delta, double* __restrict point) {
  for (std::size_t i = 0; i < n; ++i) {
    const double changed = delta[i] + factor * gradient[i];
    delta[i] = changed;
    point[i] = high[i] + (low[i] + changed);
  }
}

RUBATO_WIDE_VECTORS void add_to_state(std::size_t n, const double* __restrict delta, double* __restrict high,
                                      double* __restrict low) {
  for (std::size_t i = 0; i < n; ++i) {
    add_one(high[i], low[i], delta[i], high[i], low[i]);
  }
}

RUBATO_WIDE_VECTORS void displace_state(std::size_t n, double factor, const double* gradient, const double* high,
                                        const double* low, double* to_high, double* to_low) {
#pragma GCC ivdep
  for (std::size_t i = 0; i < n; ++i) {
    add_one(high[i], low[i], factor * gradient[i], to_high[i], to_low[i]);
  }
}

RUBATO_WIDE_VECTORS bool all_finite(std::size_t n, const double* __restrict numbers) {
  std::uint64_t largest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::uint64_t magnitude = std::bit_cast<std::uint64_t>(numbers[i]) << 1U;
    largest = largest > magnitude ? largest : magnitude;
  }
  return largest < std::bit_cast<std::uint64_t>(std::numeric_limits<double>::infinity()) << 1U;
}

}  // namespace rubato
