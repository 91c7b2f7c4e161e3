#include <rubato/pde/wave_loops.hpp>

#include <cstdint>
#include <cstring>
#include <type_traits>

#include <rubato/base/wide_vectors.hpp>

namespace rubato {

RUBATO_WIDE_VECTORS void add(std::complex<double> value, const double* re, const double* im, std::size_t count,
                             double* __restrict out_re, double* __restrict out_im) {
  const double a = value.real(), b = value.imag();
  for (std::size_t w = 0; w < count; ++w) {
    out_re[w] += a * re[w] - b * im[w];
    out_im[w] += a * im[w] + b * re[w];
  }
}
RUBATO_WIDE_VECTORS void add(double value, const double* re, const double* im, std::size_t count,
                             double* __restrict out_re, double* __restrict out_im) {
  for (std::size_t w = 0; w < count; ++w) {
    out_re[w] += value * re[w];
    out_im[w] += value * im[w];
  }
}
RUBATO_WIDE_VECTORS void add_derivative(double value, const double* k, const double* re, const double* im,
                                        std::size_t count, double* __restrict out_re, double* __restrict out_im) {
  for (std::size_t w = 0; w < count; ++w) {
    const double factor = value * k[w];
    out_re[w] -= factor * im[w];
    out_im[w] += factor * re[w];
  }
}

namespace {

inline double sum_of_lanes(const EightLanes& sums) {
  return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
}

template <typename V>
[[gnu::always_inline]] inline void load(const double* from, V& value) {
  std::memcpy(&value, from, sizeof value);
}
template <typename V>
[[gnu::always_inline]] inline void store(const V& value, double* to) {
  std::memcpy(to, &value, sizeof value);
}

using EightIntegers [[gnu::vector_size(64)]] = std::uint64_t;

/// Takes the first 12 bits of each value apart from the rest.
template <typename V>
[[gnu::always_inline]] inline void split(const V& value, V& brief, V& rest) {
  using Bits = std::conditional_t<sizeof(V) == sizeof(double), std::uint64_t, EightIntegers>;
  constexpr std::uint64_t first = ~((std::uint64_t{1} << 41) - 1);
  Bits bits;
  std::memcpy(&bits, &value, sizeof bits);
  bits &= first;
  std::memcpy(&brief, &bits, sizeof brief);
  rest = value - brief;
}

/// turn_pair() of the waves from w on that V has room for.
template <bool kicks, bool sums, typename V>
[[gnu::always_inline]] inline void turn_some(const PairMatrices& matrices, const BeforeTurn& before,
                                             const RowPair& rows, std::size_t w, V& sum) {
  V u, u_im, v, v_im;
  load(rows.x_re + w, u);
  load(rows.x_im + w, u_im);
  load(rows.y_re + w, v);
  load(rows.y_im + w, v_im);
  if constexpr (kicks) {
    V re, im;
    load(before.re + w, re);
    load(before.im + w, im);
    v += before.kick * re;
    v_im += before.kick * im;
  }
  if constexpr (sums) {
    V of_x, of_y, weight;
    load(before.of_x + w, of_x);
    load(before.of_y + w, of_y);
    load(before.weights + w, weight);
    sum += weight * (of_x * (u * u + u_im * u_im) + of_y * (v * v + v_im * v_im));
  }
  V mend;
  load(matrices.mend + w, mend);
  const auto turn = [&](const double* of_u, const double* of_v, double* to_re, double* to_im) {
    V a, b, a_brief, b_brief, a_rest, b_rest;
    load(of_u + w, a);
    load(of_v + w, b);
    split(a, a_brief, a_rest);
    split(b, b_brief, b_rest);
    const V re = a_brief * u + b_brief * v, im = a_brief * u_im + b_brief * v_im;
    store<V>(re + ((a_rest * u + b_rest * v) + mend * re), to_re + w);
    store<V>(im + ((a_rest * u_im + b_rest * v_im) + mend * im), to_im + w);
  };
  turn(matrices.a, matrices.b, rows.x_re, rows.x_im);
  turn(matrices.c, matrices.d, rows.y_re, rows.y_im);
}

template <bool kicks, bool sums>
[[gnu::always_inline]] inline double turn_all(const PairMatrices& matrices, const BeforeTurn& before, std::size_t count,
                                              const RowPair& rows) {
  constexpr std::size_t lanes = 8;
  EightLanes sum = {};
  std::size_t w = 0;
  for (; w + lanes <= count; w += lanes) {
    turn_some<kicks, sums>(matrices, before, rows, w, sum);
  }
  double rest = 0.0;
  for (; w < count; ++w) {
    turn_some<kicks, sums>(matrices, before, rows, w, rest);
  }
  return sums ? sum_of_lanes(sum) + rest : 0.0;
}

}  // namespace

RUBATO_WIDE_VECTORS double turn_pair(const PairMatrices& matrices, const BeforeTurn& before, std::size_t count,
                                     const RowPair& rows) {
  // Copies: what is stored through the rows cannot change them.
  const PairMatrices own = matrices;
  const BeforeTurn own_before = before;
  const RowPair own_rows = rows;
  if (before.re != nullptr) {
    return before.of_x != nullptr ? turn_all<true, true>(own, own_before, count, own_rows)
                                  : turn_all<true, false>(own, own_before, count, own_rows);
  }
  return before.of_x != nullptr ? turn_all<false, true>(own, own_before, count, own_rows)
                                : turn_all<false, false>(own, own_before, count, own_rows);
}

namespace {

/// The first 26 bits of a value (Veltkamp).
inline double first_half(double value) {
  const double scaled = value * (0x1p27 + 1.0);
  return scaled - (scaled - value);
}

/// What rounding took from the product (Dekker).
inline double product_error(double left, double right, double product) {
  const double l = first_half(left), r = first_half(right);
  const double left_low = left - l, right_low = right - r;
  return ((l * r - product) + l * right_low + left_low * r) + left_low * right_low;
}

/// Half of 1 - ad + bc, 0 where the matrix does not turn.
inline double half_of_missing(double a, double b, double c, double d) {
  const double p = a * d, q = -(b * c);
  const double larger = p > q ? p : q, smaller = p > q ? q : p;
  // One of p and q is at least a half, and then both differences are exact.
  const double missing = ((1.0 - larger) - smaller) - product_error(a, d, p) + product_error(b, c, -q);
  return smaller >= 0.0 ? 0.5 * missing : 0.0;
}

}  // namespace

RUBATO_WIDE_VECTORS void mend_turns(std::size_t count, const PairMatrices& matrices) {
  const double *const a = matrices.a, *const b = matrices.b, *const c = matrices.c, *const d = matrices.d;
  double* const mend = matrices.mend;
#pragma GCC ivdep
  for (std::size_t w = 0; w < count; ++w) {
    mend[w] = half_of_missing(a[w], b[w], c[w], d[w]);
  }
}
RUBATO_WIDE_VECTORS void make_turns(double tau, const double* frequencies, const double* cosines, const double* sines,
                                    const double* up, const double* down, std::size_t count,
                                    const PairMatrices& matrices) {
  double *const a = matrices.a, *const b = matrices.b, *const c = matrices.c, *const mend = matrices.mend;
#pragma GCC ivdep
  for (std::size_t w = 0; w < count; ++w) {
    const double sine = frequencies[w] == 0.0 ? tau : sines[w];
    a[w] = cosines[w];
    b[w] = sine * up[w];
    c[w] = sine * down[w];
    mend[w] = half_of_missing(a[w], b[w], c[w], a[w]);
  }
}
RUBATO_WIDE_VECTORS void multiply(double value, const double* in, std::size_t count, double* __restrict out) {
  for (std::size_t w = 0; w < count; ++w) {
    out[w] = value * in[w];
  }
}
RUBATO_WIDE_VECTORS void add_product(const double* x_re, const double* x_im, const double* y_re, const double* y_im,
                                     std::size_t count, double* __restrict out_re, double* __restrict out_im) {
  for (std::size_t w = 0; w < count; ++w) {
    out_re[w] += x_re[w] * y_re[w] - x_im[w] * y_im[w];
    out_im[w] += x_re[w] * y_im[w] + x_im[w] * y_re[w];
  }
}

RUBATO_WIDE_VECTORS void add_products(int terms, std::size_t stride, const double* x_re, const double* x_im,
                                      const double* y_re, const double* y_im, std::size_t count,
                                      double* __restrict out_re, double* __restrict out_im) {
  constexpr std::size_t piece = 16;  // waves that stay in registers over the terms
  std::size_t w = 0;
  for (; w + piece <= count; w += piece) {
    double re[piece], im[piece];
    for (std::size_t l = 0; l < piece; ++l) {
      re[l] = out_re[w + l];
      im[l] = out_im[w + l];
    }
    for (int j = 0; j < terms; ++j) {
      const std::size_t at = static_cast<std::size_t>(j) * stride + w;
      for (std::size_t l = 0; l < piece; ++l) {
        re[l] += x_re[at + l] * y_re[at + l] - x_im[at + l] * y_im[at + l];
        im[l] += x_re[at + l] * y_im[at + l] + x_im[at + l] * y_re[at + l];
      }
    }
    for (std::size_t l = 0; l < piece; ++l) {
      out_re[w + l] = re[l];
      out_im[w + l] = im[l];
    }
  }
  for (int j = 0; j < terms; ++j) {
    const std::size_t row = static_cast<std::size_t>(j) * stride;
    for (std::size_t i = w; i < count; ++i) {
      out_re[i] += x_re[row + i] * y_re[row + i] - x_im[row + i] * y_im[row + i];
      out_im[i] += x_re[row + i] * y_im[row + i] + x_im[row + i] * y_re[row + i];
    }
  }
}

RUBATO_WIDE_VECTORS void fill(double value, std::size_t count, double* out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = value;
  }
}
RUBATO_WIDE_VECTORS void add_dot(double value, const double* l_re, const double* l_im, const double* r_re,
                                 const double* r_im, std::size_t count, double* __restrict out) {
  for (std::size_t w = 0; w < count; ++w) {
    out[w] += value * (l_re[w] * r_re[w] + l_im[w] * r_im[w]);
  }
}
RUBATO_WIDE_VECTORS void add_cross(double value, const double* k, const double* l_re, const double* l_im,
                                   const double* r_re, const double* r_im, std::size_t count, double* __restrict out) {
  for (std::size_t w = 0; w < count; ++w) {
    out[w] += value * k[w] * (l_re[w] * r_im[w] - l_im[w] * r_re[w]);
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

RUBATO_WIDE_VECTORS double sum_form(const double* weights, const double* g, const double* l_re, const double* l_im,
                                    const double* r_re, const double* r_im, std::size_t count) {
  constexpr std::size_t lanes = 8;
  EightLanes sums = {}, weight, factor, a, b, c, d;
  std::size_t w = 0;
  for (; w + lanes <= count; w += lanes) {
    std::memcpy(&weight, weights + w, sizeof weight);
    std::memcpy(&factor, g + w, sizeof factor);
    std::memcpy(&a, l_re + w, sizeof a);
    std::memcpy(&b, r_re + w, sizeof b);
    std::memcpy(&c, l_im + w, sizeof c);
    std::memcpy(&d, r_im + w, sizeof d);
    sums += weight * (factor * (a * b + c * d));
  }
  for (std::size_t l = 0; w + l < count; ++l) {
    sums[l] += weights[w + l] * (g[w + l] * (l_re[w + l] * r_re[w + l] + l_im[w + l] * r_im[w + l]));
  }
  return sum_of_lanes(sums);
}

RUBATO_WIDE_VECTORS void interleave(const double* re, const double* im, std::size_t count, double* __restrict pairs) {
  for (std::size_t w = 0; w < count; ++w) {
    pairs[2 * w] = re[w];
    pairs[2 * w + 1] = im[w];
  }
}
RUBATO_WIDE_VECTORS void separate(const double* pairs, std::size_t count, double* __restrict re,
                                  double* __restrict im) {
  for (std::size_t w = 0; w < count; ++w) {
    re[w] = pairs[2 * w];
    im[w] = pairs[2 * w + 1];
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
