#include <rubato/grids/short_transform.hpp>

#include <cmath>
#include <numbers>

namespace rubato::grids {

namespace {

/// e^{-2πi k/n}.
std::complex<double> root_of_unity(int k, int n) {
  const double angle = -2.0 * std::numbers::pi * static_cast<double>(k % n) / static_cast<double>(n);
  return {std::cos(angle), std::sin(angle)};
}

constexpr std::array radices = {8, 7, 5, 4, 3, 2};

}  // namespace

bool has_small_factors(std::size_t n) {
  for (const std::size_t prime : {2U, 3U, 5U, 7U}) {
    while (n > 1 && n % prime == 0) {
      n /= prime;
    }
  }
  return n == 1;
}

bool ShortTransform::is_made_for(std::size_t n) {
  return n % lanes == 0 && n >= least_nodes && n <= most_nodes && has_small_factors(n);
}

bool ShortTransform::serves(std::size_t n) {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx512f") && is_made_for(n);
#else
  static_cast<void>(n);
  return false;
#endif
}

ShortTransform::ShortTransform(std::size_t n) {
  Tables& t = tables_;
  t.n = static_cast<int>(n);
  t.L = t.n / 8;
  const bool even = t.L % 2 == 0;
  t.length = even ? t.L / 2 : t.L;
  t.rows = even ? t.L / 2 : (t.L + 1) / 2;
  for (int rest = t.length, stride = 1; rest > 1;) {
    int radix = 0;
    for (const int one : radices) {
      if (rest % one == 0 && !(one == 8 && rest == 16)) {  // 4 and 4 are fewer than 8 and 2
        radix = one;
        break;
      }
    }
    const int m = rest / radix;
    t.passes.push_back({radix, m, stride, t.factors.size()});
    for (int q = 0; q < m; ++q) {
      for (int j = 1; j < radix; ++j) {
        t.factors.push_back(root_of_unity(j * q, rest));
      }
    }
    rest = m;
    stride *= radix;
  }
  for (int c = 0; 2 * c <= t.L; ++c) {
    t.of_row.push_back(root_of_unity(c, t.L));
  }
  for (int c = 0; c < t.rows; ++c) {
    for (const bool imaginary : {false, true}) {
      for (int b = 0; b < 8; ++b) {
        const std::complex<double> factor = root_of_unity(b * c, t.n);
        t.forward.push_back(imaginary ? factor.imag() : factor.real());
        t.inverse.push_back((imaginary ? -factor.imag() : factor.real()) / t.n);
      }
    }
  }
  for (std::size_t b = 0; b < 8; ++b) {
    for (std::size_t d = 0; d < 4; ++d) {
      const std::complex<double> factor = root_of_unity(static_cast<int>(b * (2 * d + 1)), 16);
      t.middle[b][d] = t.middle_by_d[d][b] = factor.real();
      t.middle[b][4 + d] = t.middle_by_d[4 + d][b] = factor.imag();
    }
  }
}

void ShortTransform::forward(const double* values, double* re, double* im) const {
#if defined(__x86_64__)
  short_transform::forward_avx512(tables_, values, re, im);
#else
  static_cast<void>(values), static_cast<void>(re), static_cast<void>(im);
#endif
}

void ShortTransform::inverse(const double* re, const double* im, double* values) const {
#if defined(__x86_64__)
  short_transform::inverse_avx512(tables_, re, im, values);
#else
  static_cast<void>(values), static_cast<void>(re), static_cast<void>(im);
#endif
}

}  // namespace rubato::grids
