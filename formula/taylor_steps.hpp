#pragma once

#include <utility>

#include <rubato/formula/taylor.hpp>

/// Cauchy products of graded series; shared by the parts of the Taylor arithmetic and of no use elsewhere.
namespace rubato::formula::taylor {

/// out += factor · (m numbers of a)·(n numbers of b), as polynomials.
inline void add_part_product(double* __restrict out, double factor, const double* a, std::size_t m, const double* b,
                             std::size_t n) {
  if (m > n) {  // the longer one inside
    std::swap(a, b);
    std::swap(m, n);
  }
  for (std::size_t i = 0; i < m; ++i) {
    const double x = factor * a[i];
    double* shifted = out + i;
    for (std::size_t l = 0; l < n; ++l)
      shifted[l] += x * b[l];
  }
}

/// Σ_{k=from..to} weight(k)·a_k·b_{d-k}, the part of order d of a product, added to out.
template <typename Weight>
void add_products(Univariate, double* out, const double* a, const double* b, int d, int from, int to, Weight weight) {
  // Two sums, so that an addition need not wait for the one before.
  double even = 0.0;
  double odd = 0.0;
  int k = from;
  for (; k < to; k += 2) {
    even += weight(k) * a[k] * b[d - k];
    odd += weight(k + 1) * a[k + 1] * b[d - k - 1];
  }
  if (k == to)
    even += weight(k) * a[k] * b[d - k];
  *out += even + odd;
}

template <typename Grading, typename Weight>
void add_products(Grading, double* out, const double* a, const double* b, int d, int from, int to, Weight weight) {
  for (int k = from; k <= to; ++k)
    add_part_product(out, weight(k), a + Grading::offset(k), Grading::size(k), b + Grading::offset(d - k),
                     Grading::size(d - k));
}

/// Σ_{k=from..d-from} a_k·a_{d-k} added to out, each pair once.
template <typename Grading>
void add_squares(Grading grading, double* out, const double* a, int d, int from) {
  add_products(grading, out, a, a, d, from, (d - 1) / 2, [](int) { return 2.0; });
  if (d % 2 == 0 && d / 2 >= from)
    add_products(grading, out, a, a, d, d / 2, d / 2, [](int) { return 1.0; });
}

}  // namespace rubato::formula::taylor
