#include <rubato/pde/wave_loops.hpp>

#include <rubato/grids/wide_vectors.hpp>

namespace rubato {

RUBATO_WIDE_VECTORS void add(std::complex<double> value, const double* re, const double* im, std::size_t count,
                             double* __restrict out_re, double* __restrict out_im) {
  const double a = value.real(), b = value.imag();
  for (std::size_t w = 0; w < count; ++w) {
    out_re[w] += a * re[w] - b * im[w];
    out_im[w] += a * im[w] + b * re[w];
  }
}
RUBATO_WIDE_VECTORS void add_product(const double* x_re, const double* x_im, const double* y_re, const double* y_im,
                                     std::size_t count, double* __restrict out_re, double* __restrict out_im) {
  for (std::size_t w = 0; w < count; ++w) {
    out_re[w] += x_re[w] * y_re[w] - x_im[w] * y_im[w];
    out_im[w] += x_re[w] * y_im[w] + x_im[w] * y_re[w];
  }
}

RUBATO_WIDE_VECTORS void horner(std::complex<double> x, const double* a, const double* b, std::size_t count,
                                double* __restrict re, double* im) {
  const double x_re = x.real(), x_im = x.imag();
  for (std::size_t w = 0; w < count; ++w) {
    const double next = re[w] * x_re - im[w] * x_im + a[w];
    im[w] = re[w] * x_im + im[w] * x_re + b[w];
    re[w] = next;
  }
}
RUBATO_WIDE_VECTORS void multiply(const double* a, const double* b, std::size_t count, double* __restrict re,
                                  double* __restrict im) {
  for (std::size_t w = 0; w < count; ++w) {
    const double next = re[w] * a[w] - im[w] * b[w];
    im[w] = re[w] * b[w] + im[w] * a[w];
    re[w] = next;
  }
}
RUBATO_WIDE_VECTORS void invert(std::size_t count, double* __restrict re, double* __restrict im) {
  for (std::size_t w = 0; w < count; ++w) {
    const double size = re[w] * re[w] + im[w] * im[w];
    re[w] = re[w] / size;
    im[w] = -im[w] / size;
  }
}

RUBATO_WIDE_VECTORS void add_form(const double* g_re, const double* g_im, const double* l_re, const double* l_im,
                                  const double* r_re, const double* r_im, std::size_t count, double* __restrict out) {
  for (std::size_t w = 0; w < count; ++w) {
    const double re = g_re[w] * r_re[w] - g_im[w] * r_im[w], im = g_re[w] * r_im[w] + g_im[w] * r_re[w];
    out[w] += 0.5 * (l_re[w] * re + l_im[w] * im);
  }
}

RUBATO_WIDE_VECTORS double weighted_sum(const double* weights, const double* values, std::size_t count) {
  constexpr std::size_t lanes = 8;
  double sums[lanes] = {};
  std::size_t w = 0;
  for (; w + lanes <= count; w += lanes) {
    for (std::size_t l = 0; l < lanes; ++l) {
      sums[l] += weights[w + l] * values[w + l];
    }
  }
  for (std::size_t l = 0; w + l < count; ++l) {
    sums[l] += weights[w + l] * values[w + l];
  }
  return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
}

}  // namespace rubato
