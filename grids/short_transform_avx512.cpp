#if defined(__x86_64__)

#include <cstring>
#include <utility>

#include <rubato/grids/short_transform.hpp>

// From here to the end of the file. Fused multiply-add is not switched on.
#pragma GCC target("avx512f")
#pragma GCC diagnostic ignored "-Wpsabi"  // nothing but what is inlined takes vectors

#define RUBATO_INLINED [[gnu::always_inline]] inline

namespace rubato::grids::short_transform {

namespace {

using Tables = ShortTransform::Tables;
using Pass = ShortTransform::Pass;

using V [[gnu::vector_size(64)]] = double;
using Mask [[gnu::vector_size(64)]] = long long;

/// Eight complex numbers.
struct C {
  V re, im;
};

RUBATO_INLINED V all(double x) {
  return V{x, x, x, x, x, x, x, x};
}
RUBATO_INLINED V load(const double* from) {
  V v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
RUBATO_INLINED void store(double* to, V v) {
  std::memcpy(to, &v, sizeof v);
}
RUBATO_INLINED V reversed(V x) {
  return __builtin_shufflevector(x, x, 7, 6, 5, 4, 3, 2, 1, 0);
}
RUBATO_INLINED C operator+(C a, C b) {
  return {a.re + b.re, a.im + b.im};
}
RUBATO_INLINED C operator-(C a, C b) {
  return {a.re - b.re, a.im - b.im};
}
RUBATO_INLINED C product(C a, V re, V im) {
  return {a.re * re - a.im * im, a.re * im + a.im * re};
}
RUBATO_INLINED C product(C a, std::complex<double> b) {
  return product(a, all(b.real()), all(b.imag()));
}
/// -i a.
RUBATO_INLINED C turned(C a) {
  return {a.im, -a.re};
}

// Transforms of length R in place, Σ_j a_j e^{-2πi jk/R}, with the real and imaginary parts of the roots of unity that
// the symmetry k → R - k leaves.
template <int R>
RUBATO_INLINED void transform(C* a);

template <>
RUBATO_INLINED void transform<2>(C* a) {
  const C difference = a[0] - a[1];
  a[0] = a[0] + a[1];
  a[1] = difference;
}
template <>
RUBATO_INLINED void transform<4>(C* a) {
  const C even = a[0] + a[2], even_off = a[0] - a[2], odd = a[1] + a[3], odd_off = turned(a[1] - a[3]);
  a[0] = even + odd;
  a[1] = even_off + odd_off;
  a[2] = even - odd;
  a[3] = even_off - odd_off;
}
template <>
RUBATO_INLINED void transform<8>(C* a) {
  constexpr double root = 0.70710678118654752440;
  C even[4] = {a[0], a[2], a[4], a[6]}, odd[4] = {a[1], a[3], a[5], a[7]};
  transform<4>(even);
  transform<4>(odd);
  odd[1] = {root * (odd[1].re + odd[1].im), root * (odd[1].im - odd[1].re)};
  odd[2] = turned(odd[2]);
  odd[3] = {root * (odd[3].im - odd[3].re), -root * (odd[3].re + odd[3].im)};
  for (int k = 0; k < 4; ++k) {
    a[k] = even[k] + odd[k];
    a[k + 4] = even[k] - odd[k];
  }
}
/// a[k] and a[R - k] from the sums with cosines and those with sines.
RUBATO_INLINED void join(C cosines, C sines, C& low, C& high) {
  const C off = turned(sines);
  low = cosines + off;
  high = cosines - off;
}
template <>
RUBATO_INLINED void transform<3>(C* a) {
  constexpr double s = 0.86602540378443864676;
  const C sum = a[1] + a[2], difference = a[1] - a[2];
  const C cosines = {a[0].re - 0.5 * sum.re, a[0].im - 0.5 * sum.im};
  a[0] = a[0] + sum;
  join(cosines, {s * difference.re, s * difference.im}, a[1], a[2]);
}
template <>
RUBATO_INLINED void transform<5>(C* a) {
  constexpr double c1 = 0.30901699437494742410, c2 = -0.80901699437494742410, s1 = 0.95105651629515357212,
                   s2 = 0.58778525229247312917;
  const C p = a[1] + a[4], p_off = a[1] - a[4], q = a[2] + a[3], q_off = a[2] - a[3];
  const C cosines_1 = {a[0].re + (c1 * p.re + c2 * q.re), a[0].im + (c1 * p.im + c2 * q.im)};
  const C cosines_2 = {a[0].re + (c2 * p.re + c1 * q.re), a[0].im + (c2 * p.im + c1 * q.im)};
  a[0] = a[0] + (p + q);
  join(cosines_1, {s1 * p_off.re + s2 * q_off.re, s1 * p_off.im + s2 * q_off.im}, a[1], a[4]);
  join(cosines_2, {s2 * p_off.re - s1 * q_off.re, s2 * p_off.im - s1 * q_off.im}, a[2], a[3]);
}
RUBATO_INLINED V sum_of(double x, V a, double y, V b, double z, V c) {
  return (x * a + y * b) + z * c;
}
template <>
RUBATO_INLINED void transform<7>(C* a) {
  constexpr double c1 = 0.62348980185873353053, c2 = -0.22252093395631440429, c3 = -0.90096886790241912624,
                   s1 = 0.78183148246802980871, s2 = 0.97492791218182360702, s3 = 0.43388373911755812048;
  const C first = a[0];
  const C p = a[1] + a[6], p_off = a[1] - a[6], q = a[2] + a[5], q_off = a[2] - a[5], r = a[3] + a[4],
          r_off = a[3] - a[4];
  const auto cosines = [&](double x, double y, double z) {
    return C{first.re + sum_of(x, p.re, y, q.re, z, r.re), first.im + sum_of(x, p.im, y, q.im, z, r.im)};
  };
  const auto sines = [&](double x, double y, double z) {
    return C{sum_of(x, p_off.re, y, q_off.re, z, r_off.re), sum_of(x, p_off.im, y, q_off.im, z, r_off.im)};
  };
  a[0] = first + (p + (q + r));
  join(cosines(c1, c2, c3), sines(s1, s2, s3), a[1], a[6]);
  join(cosines(c2, c3, c1), sines(s2, -s3, -s1), a[2], a[5]);
  join(cosines(c3, c1, c2), sines(s3, -s1, s2), a[3], a[4]);
}

/// Elements of eight lanes, at re + f·step and im + f·step.
struct Source {
  const double *re, *im;
  std::ptrdiff_t step;
};
struct Target {
  double *re, *im;
  std::ptrdiff_t step;
};

template <int R>
RUBATO_INLINED void go(const Pass& pass, const std::complex<double>* factors, Source from, Target to) {
  for (int q = 0; q < pass.m; ++q) {
    const std::complex<double>* own = factors + static_cast<std::ptrdiff_t>(q) * (R - 1);
    for (int k = 0; k < pass.stride; ++k) {
      C a[R];
      for (int j = 0; j < R; ++j) {
        const std::ptrdiff_t at = (k + pass.stride * (q + pass.m * j)) * from.step;
        a[j] = {load(from.re + at), load(from.im + at)};
      }
      transform<R>(a);
      for (int j = 0; j < R; ++j) {
        const C value = j == 0 || q == 0 ? a[j] : product(a[j], own[j - 1]);
        const std::ptrdiff_t at = (k + pass.stride * (R * q + j)) * to.step;
        store(to.re + at, value.re);
        store(to.im + at, value.im);
      }
    }
  }
}

constexpr std::size_t room = ShortTransform::most_nodes + 64;

struct Work {
  alignas(64) double re[room];
  alignas(64) double im[room];
  [[nodiscard]] Target whole() { return {re, im, 8}; }
};

/// Stockham's order of passes: none needs its elements sorted.
RUBATO_INLINED void within_lanes(const Tables& t, Source from, Work& one, Work& other, Target end) {
  Target next = one.whole(), after = other.whole();
  for (std::size_t i = 0; i < t.passes.size(); ++i) {
    const Pass& pass = t.passes[i];
    const std::complex<double>* factors = t.factors.data() + pass.factors;
    const Target to = i + 1 == t.passes.size() ? end : next;
    switch (pass.radix) {
      case 2: go<2>(pass, factors, from, to); break;
      case 3: go<3>(pass, factors, from, to); break;
      case 4: go<4>(pass, factors, from, to); break;
      case 5: go<5>(pass, factors, from, to); break;
      case 7: go<7>(pass, factors, from, to); break;
      default: go<8>(pass, factors, from, to); break;
    }
    from = {to.re, to.im, to.step};
    std::swap(next, after);
  }
}

/// Rows and columns of eight vectors exchanged.
RUBATO_INLINED void transpose(V* x) {
  V a[8], b[8];
  for (int i = 0; i < 8; i += 2) {
    a[i] = __builtin_shufflevector(x[i], x[i + 1], 0, 8, 2, 10, 4, 12, 6, 14);
    a[i + 1] = __builtin_shufflevector(x[i], x[i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
  }
  for (int i = 0; i < 8; i += 4) {
    for (int j = i; j < i + 2; ++j) {
      b[j] = __builtin_shufflevector(a[j], a[j + 2], 0, 1, 8, 9, 4, 5, 12, 13);
      b[j + 2] = __builtin_shufflevector(a[j], a[j + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  }
  for (int j = 0; j < 4; ++j) {
    x[j] = __builtin_shufflevector(b[j], b[j + 4], 0, 1, 2, 3, 8, 9, 10, 11);
    x[j + 4] = __builtin_shufflevector(b[j], b[j + 4], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

}  // namespace

// What rows beyond t.rows become goes where waves are written later.
void forward_avx512(const Tables& t, const double* values, double* re, double* im) {
  Work one, other, z;
  const bool even = t.L % 2 == 0;
  if (even) {  // two real transforms as one: u_{16a + b} + i u_{16a + 8 + b}
    within_lanes(t, {values, values + 8, 16}, one, other, z.whole());
  } else {
    for (int a = 0; a < t.L; ++a) {
      store(other.im + 8 * a, all(0.0));
    }
    within_lanes(t, {values, other.im, 8}, one, other, z.whole());
  }
  const auto row = [&](int c) { return C{load(z.re + 8 * c), load(z.im + 8 * c)}; };
  const auto set_row = [&](int c, C value) {
    const C turned_by = product(value, load(t.forward.data() + 16 * c), load(t.forward.data() + 16 * c + 8));
    store(z.re + 8 * c, turned_by.re);
    store(z.im + 8 * c, turned_by.im);
  };
  V middle = all(0.0);
  if (even) {
    const C first = row(0);
    const V difference = first.re - first.im;
    store(z.re, first.re + first.im);
    store(z.im, all(0.0));
    for (int b = 0; b < 8; ++b) {
      middle += difference[b] * load(t.middle[static_cast<std::size_t>(b)].data());
    }
    for (int c = 1; 2 * c <= t.length; ++c) {
      const int mirror = t.length - c;
      const C here = row(c), there = row(mirror);
      const C of_even = {0.5 * (here.re + there.re), 0.5 * (here.im - there.im)};
      const C of_odd = {0.5 * (here.im + there.im), 0.5 * (there.re - here.re)};
      const C odd = product(of_odd, t.of_row[static_cast<std::size_t>(c)]);
      set_row(mirror, {of_even.re - odd.re, odd.im - of_even.im});
      set_row(c, of_even + odd);
    }
  } else {
    for (int c = 1; c < t.rows; ++c) {
      set_row(c, row(c));
    }
  }
  for (int begin = 0; begin < t.rows; begin += 8) {
    V x[8], y[8];
    for (int b = 0; b < 8; ++b) {
      const bool is_row = begin + b < t.rows;
      x[b] = is_row ? load(z.re + 8 * (begin + b)) : all(0.0);
      y[b] = is_row ? load(z.im + 8 * (begin + b)) : all(0.0);
    }
    transpose(x);
    transpose(y);
    C a[8];
    for (int b = 0; b < 8; ++b) {
      a[b] = {x[b], y[b]};
    }
    transform<8>(a);
    for (int d = 4; d < 8; ++d) {  // the waves beyond n/2 are the conjugates of those before
      const int k = t.n - t.L * d - begin - 7;
      store(re + k, reversed(a[d].re));
      store(im + k, -reversed(a[d].im));
    }
    for (int d = 0; d < 4; ++d) {
      store(z.re + 8 * (begin + d), a[d].re);
      store(z.im + 8 * (begin + d), a[d].im);
    }
  }
  for (int begin = 0; begin < t.rows; begin += 8) {
    const long long last = t.rows - begin;
    const Mask mask = Mask{0, 1, 2, 3, 4, 5, 6, 7} < Mask{last, last, last, last, last, last, last, last};
    for (int d = 0; d < 4; ++d) {
      double *to_re = re + t.L * d + begin, *to_im = im + t.L * d + begin;
      const C value = row(begin + d);
      store(to_re, mask ? value.re : load(to_re));
      store(to_im, mask ? value.im : load(to_im));
    }
  }
  for (int d = 0; even && d < 4; ++d) {
    re[t.length + t.L * d] = middle[d];
    im[t.length + t.L * d] = middle[4 + d];
  }
  im[0] = im[t.n / 2] = 0.0;
}

// A transform with i in place of -i is that of numbers whose real and imaginary parts are exchanged.
void inverse_avx512(const Tables& t, const double* re, const double* im, double* values) {
  Work one, other, z;
  const V but_first = {0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
  for (int begin = 0; begin < t.rows; begin += 8) {
    C a[8];
    for (int d = 0; d < 4; ++d) {
      a[d] = {load(im + t.L * d + begin), load(re + t.L * d + begin)};
    }
    for (int d = 4; d < 8; ++d) {
      const int k = t.n - t.L * d - begin - 7;
      a[d] = {-reversed(load(im + k)), reversed(load(re + k))};
    }
    if (begin == 0) {
      a[0].re *= but_first;
      a[4].re *= but_first;
    }
    transform<8>(a);
    V x[8], y[8];
    for (int b = 0; b < 8; ++b) {
      x[b] = a[b].im;
      y[b] = a[b].re;
    }
    transpose(x);
    transpose(y);
    for (int b = 0; b < 8; ++b) {
      store(z.re + 8 * (begin + b), x[b]);
      store(z.im + 8 * (begin + b), y[b]);
    }
  }
  const double scale = 1.0 / t.n;
  const auto row = [&](int c) {
    return product(C{load(z.re + 8 * c), load(z.im + 8 * c)}, load(t.inverse.data() + 16 * c),
                   load(t.inverse.data() + 16 * c + 8));
  };
  const auto set_row = [&](int c, C value) {
    store(z.re + 8 * c, value.re);
    store(z.im + 8 * c, value.im);
  };
  if (t.L % 2 == 0) {
    V middle = all(0.0);
    for (std::size_t d = 0; d < 4; ++d) {
      const std::ptrdiff_t k = t.length + t.L * static_cast<std::ptrdiff_t>(d);
      middle += (2.0 * scale * re[k]) * load(t.middle_by_d[d].data()) +
                (2.0 * scale * im[k]) * load(t.middle_by_d[4 + d].data());
    }
    const V first = scale * load(z.re);
    set_row(0, {first + middle, first - middle});
    for (int c = 1; 2 * c <= t.length; ++c) {
      const int mirror = t.length - c;
      const C here = row(c), there = row(mirror);
      const C even = {here.re + there.re, here.im - there.im}, off = {here.re - there.re, here.im + there.im};
      const C odd = product(off, std::conj(t.of_row[static_cast<std::size_t>(c)]));
      set_row(mirror, {even.re + odd.im, odd.re - even.im});
      set_row(c, {even.re - odd.im, even.im + odd.re});
    }
    within_lanes(t, {z.im, z.re, 8}, one, other, {values + 8, values, 16});
  } else {
    store(z.re, scale * load(z.re));
    for (int c = 1; c < t.rows; ++c) {
      const C value = row(c);
      set_row(c, value);
      set_row(t.L - c, {value.re, -value.im});
    }
    Work imaginary;  // rounding
    within_lanes(t, {z.im, z.re, 8}, one, other, {imaginary.re, values, 8});
  }
}

}  // namespace rubato::grids::short_transform

#endif
