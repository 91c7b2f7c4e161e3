#include <rubato/pde/wave_loops.hpp>

#include <cstring>

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

/// turn_pair() of the waves from w on that V has room for.
template <bool kicks, bool sums, typename V>
[[gnu::always_inline]] inline void turn_some(const PairMatrices& matrices, const PairMatrices& rests,
                                             const BeforeTurn& before, const RowPair& rows, std::size_t w, V& sum) {
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
    V of_x, of_y;
    load(before.of_x + w, of_x);
    load(before.of_y + w, of_y);
    sum += of_x * (u * u + u_im * u_im) + of_y * (v * v + v_im * v_im);
  }
  V a, b, a_rest, b_rest;
  load(matrices.a + w, a);
  load(matrices.b + w, b);
  load(rests.a + w, a_rest);
  load(rests.b + w, b_rest);
  store<V>((a * u + b * v) + (a_rest * u + b_rest * v), rows.x_re + w);
  store<V>((a * u_im + b * v_im) + (a_rest * u_im + b_rest * v_im), rows.x_im + w);
  load(matrices.c + w, a);
  load(matrices.d + w, b);
  load(rests.c + w, a_rest);
  load(rests.d + w, b_rest);
  store<V>((a * u + b * v) + (a_rest * u + b_rest * v), rows.y_re + w);
  store<V>((a * u_im + b * v_im) + (a_rest * u_im + b_rest * v_im), rows.y_im + w);
}

template <bool kicks, bool sums>
[[gnu::always_inline]] inline double turn_all(const PairMatrices& matrices, const PairMatrices& rests,
                                              const BeforeTurn& before, std::size_t count, const RowPair& rows) {
  constexpr std::size_t lanes = 8;
  EightLanes sum = {};
  std::size_t w = 0;
  for (; w + lanes <= count; w += lanes) {
    turn_some<kicks, sums>(matrices, rests, before, rows, w, sum);
  }
  double rest = 0.0;
  for (; w < count; ++w) {
    turn_some<kicks, sums>(matrices, rests, before, rows, w, rest);
  }
  return sums ? sum_of_lanes(sum) + rest : 0.0;
}

}  // namespace

RUBATO_WIDE_VECTORS double turn_pair(const PairMatrices& matrices, const PairMatrices& rests, const BeforeTurn& before,
                                     std::size_t count, const RowPair& rows) {
  // Copies: what is stored through the rows cannot change them.
  const PairMatrices own = matrices, own_rests = rests;
  const BeforeTurn own_before = before;
  const RowPair own_rows = rows;
  if (before.re != nullptr) {
    return before.of_x != nullptr ? turn_all<true, true>(own, own_rests, own_before, count, own_rows)
                                  : turn_all<true, false>(own, own_rests, own_before, count, own_rows);
  }
  return before.of_x != nullptr ? turn_all<false, true>(own, own_rests, own_before, count, own_rows)
                                : turn_all<false, false>(own, own_rests, own_before, count, own_rows);
}

namespace {

/// The first `53 - bits` bits of a value (Veltkamp).
inline double leading(double value, double two_to_bits_and_one) {
  const double scaled = value * two_to_bits_and_one;
  return scaled - (scaled - value);
}
constexpr double in_half = 0x1p27 + 1.0, to_twelve = 0x1p41 + 1.0;

/// What rounding took from the product (Dekker).
inline double product_error(double left, double right, double product) {
  const double l = leading(left, in_half), r = leading(right, in_half);
  const double left_low = left - l, right_low = right - r;
  return ((l * r - product) + l * right_low + left_low * r) + left_low * right_low;
}

/// Half of 1 - ad + bc, p = ad and q = -bc rounded; 0 where the matrix does not turn.
inline double half_of_missing(double a, double b, double c, double d, double p, double q) {
  const double larger = p > q ? p : q, smaller = p > q ? q : p;
  // One of p and q is at least a half, and then both differences are exact.
  const double missing = ((1.0 - larger) - smaller) - product_error(a, d, p) + product_error(b, c, -q);
  return smaller >= 0.0 ? 0.5 * missing : 0.0;
}

}  // namespace

RUBATO_WIDE_VECTORS void split_turns(std::size_t count, const PairMatrices& matrices, const PairMatrices& rests) {
  double *const first[] = {matrices.a, matrices.b, matrices.c, matrices.d}, *const rest[] = {rests.a, rests.b, rests.c,
                                                                                             rests.d};
  // No two of the eight overlap, which the compiler would have to find out in every call.
#pragma GCC ivdep
  for (std::size_t w = 0; w < count; ++w) {
    const double a = first[0][w], b = first[1][w], c = first[2][w], d = first[3][w];
    const double mend = half_of_missing(a, b, c, d, a * d, -(b * c));
    const double brief[] = {leading(a, to_twelve), leading(b, to_twelve), leading(c, to_twelve), leading(d, to_twelve)};
    rest[0][w] = (a - brief[0]) + mend * a;
    rest[1][w] = (b - brief[1]) + mend * b;
    rest[2][w] = (c - brief[2]) + mend * c;
    rest[3][w] = (d - brief[3]) + mend * d;
    first[0][w] = brief[0];
    first[1][w] = brief[1];
    first[2][w] = brief[2];
    first[3][w] = brief[3];
  }
}
RUBATO_WIDE_VECTORS void make_turns(double tau, const double* frequencies, const double* cosines, const double* sines,
                                    const double* up, const double* down, std::size_t count,
                                    const PairMatrices& matrices, const PairMatrices& rests) {
  double *const a_first = matrices.a, *const b_first = matrices.b, *const c_first = matrices.c;
  double *const a_rest = rests.a, *const b_rest = rests.b, *const c_rest = rests.c;
#pragma GCC ivdep
  for (std::size_t w = 0; w < count; ++w) {
    const double sine = frequencies[w] == 0.0 ? tau : sines[w];
    const double a = cosines[w], b = sine * up[w], c = sine * down[w];
    const double p = a * a, q = -(b * c);
    const double mend = half_of_missing(a, b, c, a, p, q);
    const double brief_a = leading(a, to_twelve), brief_b = leading(b, to_twelve), brief_c = leading(c, to_twelve);
    a_rest[w] = (a - brief_a) + mend * a;
    b_rest[w] = (b - brief_b) + mend * b;
    c_rest[w] = (c - brief_c) + mend * c;
    a_first[w] = brief_a;
    b_first[w] = brief_b;
    c_first[w] = brief_c;
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
RUBATO_WIDE_VECTORS void add_pair(const double* a, const double* b, std::size_t count, double* __restrict out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = a[i] + b[i];
  }
}
RUBATO_WIDE_VECTORS void add_two(const double* a, const double* b, const double* c, std::size_t count,
                                 double* __restrict out) {
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = a[i] + (b[i] + c[i]);
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

RUBATO_WIDE_VECTORS double sum_form(const double* g, const double* l_re, const double* l_im, const double* r_re,
                                    const double* r_im, std::size_t count) {
  constexpr std::size_t lanes = 8;
  EightLanes sums = {}, weight, a, b, c, d;
  std::size_t w = 0;
  for (; w + lanes <= count; w += lanes) {
    std::memcpy(&weight, g + w, sizeof weight);
    std::memcpy(&a, l_re + w, sizeof a);
    std::memcpy(&b, r_re + w, sizeof b);
    std::memcpy(&c, l_im + w, sizeof c);
    std::memcpy(&d, r_im + w, sizeof d);
    sums += weight * (a * b + c * d);
  }
  for (std::size_t l = 0; w + l < count; ++l) {
    sums[l] += g[w + l] * (l_re[w + l] * r_re[w + l] + l_im[w + l] * r_im[w + l]);
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

RUBATO_WIDE_VECTORS double sum_of_values(const double* values, std::size_t count) {
  constexpr std::size_t lanes = 8;
  EightLanes even = {}, odd = {}, term;
  std::size_t i = 0;
  for (; i + 2 * lanes <= count; i += 2 * lanes) {
    load(values + i, term);
    even += term;
    load(values + i + lanes, term);
    odd += term;
  }
  if (i + lanes <= count) {
    load(values + i, term);
    even += term;
    i += lanes;
  }
  even += odd;
  double rest = 0.0;
  for (; i < count; ++i) {
    rest += values[i];
  }
  return sum_of_lanes(even) + rest;
}

}  // namespace rubato
