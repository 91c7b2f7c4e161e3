#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "systems.hpp"

namespace orbits {

/// One step of Gragg's modified midpoint rule with 2, 4, … 12 parts, extrapolated to order 12 (Hairer, Nørsett and
/// Wanner, Solving Ordinary Differential Equations I, section II.9): explicit, not symplectic, and unlike all that is
/// compared.
template <typename System, typename T>
void extrapolate(std::vector<T>& q, std::vector<T>& p, T step) {
  constexpr std::size_t n = System::n;
  constexpr int columns = 6;
  thread_local std::vector<T> work;
  work.resize(8 * n);
  T* const old_q = work.data();
  T *const old_p = old_q + n, *const mid_q = old_p + n, *const mid_p = mid_q + n, *const v = mid_p + n,
           *const f = v + n, *const dq = f + n, *const dp = dq + n;
  for (std::size_t i = 0; i < n; ++i) {
    dq[i] = dp[i] = 0;
  }
  for (int k = 1; k <= columns; ++k) {
    // Of extrapolation in the square of the step, as a weighted sum: Π_{j≠k} n_k²/(n_k² - n_j²), which sum to one.
    T weight = 1;
    for (int j = 1; j <= columns; ++j) {
      if (j != k) {
        weight *= T(k * k) / T(k * k - j * j);
      }
    }
    const int parts = 2 * k;
    const T h = step / parts;
    field<System>(q.data(), p.data(), v, f);
    for (std::size_t i = 0; i < n; ++i) {  // increments from the start, which are small
      old_q[i] = old_p[i] = 0;
      mid_q[i] = h * v[i];
      mid_p[i] = h * f[i];
    }
    thread_local std::vector<T> at;
    at.resize(2 * n);
    for (int part = 1; part < parts; ++part) {
      for (std::size_t i = 0; i < n; ++i) {
        at[i] = q[i] + mid_q[i];
        at[n + i] = p[i] + mid_p[i];
      }
      field<System>(at.data(), at.data() + n, v, f);
      for (std::size_t i = 0; i < n; ++i) {
        const T next_q = old_q[i] + 2 * h * v[i], next_p = old_p[i] + 2 * h * f[i];
        old_q[i] = mid_q[i];
        old_p[i] = mid_p[i];
        mid_q[i] = next_q;
        mid_p[i] = next_p;
      }
    }
    for (std::size_t i = 0; i < n; ++i) {
      dq[i] += weight * mid_q[i];
      dp[i] += weight * mid_p[i];
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    q[i] += dq[i];
    p[i] += dp[i];
  }
}

}  // namespace orbits
