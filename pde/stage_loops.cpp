#include <rubato/pde/stage_loops.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include <rubato/base/larger.hpp>
#include <rubato/base/wide_vectors.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

namespace {

using namespace tuning::stage_loops;

constexpr std::size_t lanes = PackedMatrices::lanes;

[[gnu::always_inline]] inline void take(const double* from, std::size_t count, EightLanes& to) {
  if (count == lanes) {
    std::memcpy(&to, from, sizeof to);
    return;
  }
  to = EightLanes{};
  for (std::size_t l = 0; l < count; ++l) {
    to[l] = from[l];
  }
}
[[gnu::always_inline]] inline void give(const EightLanes& from, std::size_t count, double* to) {
  if (count == lanes) {
    std::memcpy(to, &from, sizeof from);
    return;
  }
  for (std::size_t l = 0; l < count; ++l) {
    to[l] = from[l];
  }
}

/// Null bases count as 0.
struct Rows {
  const double *x_re, *x_im, *base_re, *base_im;
  double *y_re, *y_im;
  std::size_t stride;
};

/// `entries` are of the first of R rows out of `rows`, on one block.
template <int R>
[[gnu::always_inline]] inline void apply_rows(int rows, int columns, const double* entries, const Rows& at,
                                              std::size_t count) {
  EightLanes re[R], im[R];
  for (int r = 0; r < R; ++r) {
    re[r] = im[r] = EightLanes{};
    if (at.base_re != nullptr) {
      take(at.base_re + static_cast<std::size_t>(r) * at.stride, count, re[r]);
      take(at.base_im + static_cast<std::size_t>(r) * at.stride, count, im[r]);
    }
  }
  for (int c = 0; c < columns; ++c) {
    EightLanes x_re, x_im, a, b;
    take(at.x_re + static_cast<std::size_t>(c) * at.stride, count, x_re);
    take(at.x_im + static_cast<std::size_t>(c) * at.stride, count, x_im);
    const double* own = entries + static_cast<std::size_t>(c * rows) * 2 * lanes;
    for (int r = 0; r < R; ++r) {
      std::memcpy(&a, own + static_cast<std::size_t>(r) * 2 * lanes, sizeof a);
      std::memcpy(&b, own + static_cast<std::size_t>(r) * 2 * lanes + lanes, sizeof b);
      re[r] += a * x_re - b * x_im;
      im[r] += a * x_im + b * x_re;
    }
  }
  for (int r = 0; r < R; ++r) {
    give(re[r], count, at.y_re + static_cast<std::size_t>(r) * at.stride);
    give(im[r], count, at.y_im + static_cast<std::size_t>(r) * at.stride);
  }
}

[[gnu::always_inline]] inline void apply_some(int some, int rows, int columns, const double* entries, const Rows& at,
                                              std::size_t count) {
  switch (some) {
    case 1: apply_rows<1>(rows, columns, entries, at, count); break;
    case 2: apply_rows<2>(rows, columns, entries, at, count); break;
    case 3: apply_rows<3>(rows, columns, entries, at, count); break;
    case 4: apply_rows<4>(rows, columns, entries, at, count); break;
    case 5: apply_rows<5>(rows, columns, entries, at, count); break;
    case 6: apply_rows<6>(rows, columns, entries, at, count); break;
    case 7: apply_rows<7>(rows, columns, entries, at, count); break;
    default: apply_rows<rows_at_once>(rows, columns, entries, at, count); break;
  }
}

RUBATO_WIDE_VECTORS void apply_packed(int rows, int columns, const double* entries, int first, int wanted,
                                      const Rows& from, std::size_t begin, std::size_t count) {
  for (std::size_t w = begin; w < begin + count; w += lanes) {
    const std::size_t here = std::min(lanes, begin + count - w);
    const double* block = entries + w * static_cast<std::size_t>(2 * rows * columns);
    for (int r = 0; r < wanted; r += rows_at_once) {
      const std::size_t offset = static_cast<std::size_t>(r) * from.stride + w;
      const bool based = from.base_re != nullptr;
      const Rows at = {from.x_re + w,
                       from.x_im + w,
                       based ? from.base_re + offset : nullptr,
                       based ? from.base_im + offset : nullptr,
                       from.y_re + offset,
                       from.y_im + offset,
                       from.stride};
      const double* own = block + static_cast<std::size_t>(first + r) * 2 * lanes;
      const int some = std::min(rows_at_once, wanted - r);
      if (here == lanes) {
        apply_some(some, rows, columns, own, at, lanes);
      } else if (here == 1) {
        apply_some(some, rows, columns, own, at, 1);  // the last wave of lines of 16 n nodes
      } else {
        apply_some(some, rows, columns, own, at, here);
      }
    }
  }
}

/// Adds value·(re + i im) to entries that are `step` apart from block to block.
RUBATO_WIDE_VECTORS void add_packed(double value_re, double value_im, const double* re, const double* im,
                                    std::size_t count, double* entry, std::size_t step) {
  EightLanes a, b, c, d;
  for (std::size_t w = 0; w < count; w += lanes, entry += step) {
    const std::size_t here = std::min(lanes, count - w);
    take(re + w, here, a);
    take(im + w, here, b);
    std::memcpy(&c, entry, sizeof c);
    std::memcpy(&d, entry + lanes, sizeof d);
    c += value_re * a - value_im * b;
    d += value_re * b + value_im * a;
    std::memcpy(entry, &c, sizeof c);
    std::memcpy(entry + lanes, &d, sizeof d);
  }
}

template <int R>
[[gnu::always_inline]] inline void mix_rows(int columns, const double* weights, const double* x, std::size_t stride,
                                            std::size_t count, double* y) {
  EightLanes sums[R], value;
  for (int r = 0; r < R; ++r) {
    sums[r] = EightLanes{};
  }
  for (int c = 0; c < columns; ++c) {
    take(x + static_cast<std::size_t>(c) * stride, count, value);
    for (int r = 0; r < R; ++r) {
      sums[r] += weights[r * columns + c] * value;
    }
  }
  for (int r = 0; r < R; ++r) {
    give(sums[r], count, y + static_cast<std::size_t>(r) * stride);
  }
}

[[gnu::always_inline]] inline void add_weighted(double weight, const EightLanes& x_re, const EightLanes& x_im,
                                                EightLanes& re, EightLanes& im) {
  re += weight * x_re;
  im += weight * x_im;
}
[[gnu::always_inline]] inline void add_weighted(const std::complex<double>& weight, const EightLanes& x_re,
                                                const EightLanes& x_im, EightLanes& re, EightLanes& im) {
  re += weight.real() * x_re - weight.imag() * x_im;
  im += weight.real() * x_im + weight.imag() * x_re;
}

/// R rows of a mixture on one block, in addition to what is there or not.
template <int R, bool Adds, typename Weight>
[[gnu::always_inline]] inline void mix_block(int columns, const Weight* weights, const Strided<const double>& x,
                                             std::size_t count, const Strided<double>& y) {
  EightLanes re[R], im[R], x_re, x_im;
  for (int r = 0; r < R; ++r) {
    re[r] = im[r] = EightLanes{};
    if constexpr (Adds) {
      take(y.re + static_cast<std::size_t>(r) * y.stride, count, re[r]);
      take(y.im + static_cast<std::size_t>(r) * y.stride, count, im[r]);
    }
  }
  for (int c = 0; c < columns; ++c) {
    take(x.re + static_cast<std::size_t>(c) * x.stride, count, x_re);
    take(x.im + static_cast<std::size_t>(c) * x.stride, count, x_im);
    for (int r = 0; r < R; ++r) {
      add_weighted(weights[r * columns + c], x_re, x_im, re[r], im[r]);
    }
  }
  for (int r = 0; r < R; ++r) {
    give(re[r], count, y.re + static_cast<std::size_t>(r) * y.stride);
    give(im[r], count, y.im + static_cast<std::size_t>(r) * y.stride);
  }
}

template <bool Adds, typename Weight>
[[gnu::always_inline]] inline void mix_waves(int rows, int columns, const Weight* weights, Strided<const double> x,
                                             std::size_t count, Strided<double> y) {
  constexpr int some = 4;
  for (std::size_t w = 0; w < count; w += lanes) {
    const std::size_t here = std::min(lanes, count - w);
    const Strided<const double> from = {x.re + w, x.im + w, x.stride};
    for (int r = 0; r < rows;) {
      const Strided<double> to = {y.re + static_cast<std::size_t>(r) * y.stride + w,
                                  y.im + static_cast<std::size_t>(r) * y.stride + w, y.stride};
      const Weight* own = weights + r * columns;
      if (r + some <= rows && here == lanes) {
        mix_block<some, Adds>(columns, own, from, lanes, to);
        r += some;
      } else if (here == lanes) {
        mix_block<1, Adds>(columns, own, from, lanes, to);
        ++r;
      } else if (here == 1) {
        mix_block<1, Adds>(columns, own, from, 1, to);
        ++r;
      } else {
        mix_block<1, Adds>(columns, own, from, here, to);
        ++r;
      }
    }
  }
}

struct LaneNumbers {
  EightLanes re, im;
};
using LaneStages = std::array<LaneNumbers, GaussTableau::most_stages>;

[[gnu::always_inline]] inline void take_stages(int m, const Strided<const double>& from, std::size_t at,
                                               std::size_t count, LaneStages& to) {
  for (int i = 0; i < m; ++i) {
    take(from.re + static_cast<std::size_t>(i) * from.stride + at, count, to[i].re);
    take(from.im + static_cast<std::size_t>(i) * from.stride + at, count, to[i].im);
  }
}
/// Σ conj(x_i) y_i.
[[gnu::always_inline]] inline LaneNumbers inner_product(int m, const LaneStages& x, const LaneStages& y) {
  LaneNumbers sum = {};
  for (int i = 0; i < m; ++i) {
    sum.re += x[i].re * y[i].re + x[i].im * y[i].im;
    sum.im += x[i].re * y[i].im - x[i].im * y[i].re;
  }
  return sum;
}
/// Σ |x_i|².
[[gnu::always_inline]] inline void add_squares(int m, const LaneStages& x, EightLanes& sum) {
  for (int i = 0; i < m; ++i) {
    sum += x[i].re * x[i].re + x[i].im * x[i].im;
  }
}
[[gnu::always_inline]] inline void subtract_product(const LaneNumbers& a, const LaneNumbers& x, LaneNumbers& y) {
  y.re -= a.re * x.re - a.im * x.im;
  y.im -= a.re * x.im + a.im * x.re;
}
[[gnu::always_inline]] inline void take_larger_part(const LaneNumbers& x, EightLanes& of) {
  const EightLanes re = x.re < 0.0 ? -x.re : x.re, im = x.im < 0.0 ? -x.im : x.im;
  of = re > im ? re : im;
}
[[gnu::always_inline]] inline void multiply_by(const EightLanes& factor, LaneNumbers& x) {
  x.re *= factor;
  x.im *= factor;
}
[[gnu::always_inline]] inline void give_number(const LaneNumbers& value, const Strided<double>& to, int row,
                                               std::size_t at, std::size_t count) {
  give(value.re, count, to.re + static_cast<std::size_t>(row) * to.stride + at);
  give(value.im, count, to.im + static_cast<std::size_t>(row) * to.stride + at);
}
/// sum += Σ_j weights_j x_j.
[[gnu::always_inline]] inline void add_continued(int m, const double* weights, const LaneStages& x, LaneNumbers& sum) {
  for (int j = 0; j < m; ++j) {
    sum.re += weights[j] * x[j].re;
    sum.im += weights[j] * x[j].im;
  }
}

/// α and β of z = α x + β y; β = 0 without y. It is found from what z and y have across x: where that is nothing but
/// rounding, they are comparable.
[[gnu::always_inline]] inline void fit_recurrence(int m, const LaneStages& z, const LaneStages& x, const LaneStages* y,
                                                  LaneNumbers& alpha, LaneNumbers& beta) {
  EightLanes squares = {};
  add_squares(m, x, squares);
  const EightLanes of_x = 1.0 / (squares + least_square);
  alpha = inner_product(m, x, z);
  multiply_by(of_x, alpha);
  beta = LaneNumbers{};
  if (y == nullptr) {
    return;
  }
  EightLanes of_y = {};
  add_squares(m, *y, of_y);
  LaneNumbers along = inner_product(m, x, *y);
  multiply_by(of_x, along);
  squares = rounding_of_squares * of_y + least_square;
  for (int i = 0; i < m; ++i) {
    LaneNumbers across = (*y)[i], of_z = z[i];
    subtract_product(along, x[i], across);
    subtract_product(alpha, x[i], of_z);
    squares += across.re * across.re + across.im * across.im;
    beta.re += across.re * of_z.re + across.im * of_z.im;
    beta.im += across.re * of_z.im - across.im * of_z.re;
  }
  multiply_by(1.0 / squares, beta);
  subtract_product(along, beta, alpha);
}

[[gnu::always_inline]] inline void foresee_block(int m, const double* onward, const WaveForecast& forecast, bool judged,
                                                 std::size_t w, std::size_t count) {
  const EightLanes none = {};
  const double* to_last = onward + (m - 1) * m;
  const bool recurs = forecast.known > 1;
  LaneStages z, base;
  LaneNumbers last = {};
  take_stages(m, forecast.past[0], w, count, z);
  add_continued(m, to_last, z, last);
  give_number(last, forecast.last[0], 0, w, count);
  for (int i = 0; i < m; ++i) {
    base[i] = LaneNumbers{};
  }
  if (recurs) {
    LaneStages x, y, left;
    LaneNumbers alpha, beta;
    take_stages(m, forecast.past[1], w, count, x);
    if (forecast.known > 2) {
      take_stages(m, forecast.past[2], w, count, y);
      fit_recurrence(m, z, x, &y, alpha, beta);
    } else {
      for (int i = 0; i < m; ++i) {
        y[i] = LaneNumbers{};
      }
      fit_recurrence(m, z, x, nullptr, alpha, beta);
    }
    for (int i = 0; i < m; ++i) {
      left[i] = z[i];
      subtract_product(alpha, x[i], left[i]);
      subtract_product(beta, y[i], left[i]);
      subtract_product(alpha, z[i], base[i]);
      subtract_product(beta, x[i], base[i]);
      base[i] = {-base[i].re, -base[i].im};
    }
    last = base[m - 1];
    give_number(last, forecast.last[1], 0, w, count);
    add_continued(m, to_last, left, last);
    give_number(last, forecast.last[2], 0, w, count);
    EightLanes off_polynomial, off_recurrence, off_both;
    take(forecast.off[0] + w, count, off_polynomial);
    if (judged) {
      take(forecast.off[1] + w, count, off_recurrence);
      take(forecast.off[2] + w, count, off_both);
    } else {
      take_larger_part(left[m - 1], off_recurrence);
      off_both = off_recurrence;
    }
    off_polynomial *= 1.0 / caution;
    // What is continued is z, or nothing, or what the recurrence leaves.
    const auto alone = off_recurrence <= off_polynomial && off_recurrence <= off_both;
    const auto both = off_both < off_recurrence && off_both <= off_polynomial;
    for (int i = 0; i < m; ++i) {
      z[i].re = alone ? none : (both ? left[i].re : z[i].re);
      z[i].im = alone ? none : (both ? left[i].im : z[i].im);
      base[i].re = alone || both ? base[i].re : none;
      base[i].im = alone || both ? base[i].im : none;
    }
  }
  for (int i = 0; i < m; ++i) {
    add_continued(m, onward + i * m, z, base[i]);
    give_number(base[i], forecast.stages, i, w, count);
  }
}

/// The polynomial through its values at -1, -2, …, at 0: the weight of the k-th of so many is -(-1)^k times a binomial
/// coefficient; of 0 further ones.
constexpr auto weights_of_steps = [] {
  constexpr std::size_t most = steps_of_way.back();
  std::array<std::array<double, most + 1>, most + 1> weights{};
  for (std::size_t points = 1; points <= most; ++points) {
    double binomial = 1.0;
    for (std::size_t k = 1; k <= points; ++k) {
      binomial *= static_cast<double>(points + 1 - k) / static_cast<double>(k);
      weights[points][k - 1] = k % 2 == 1 ? binomial : -binomial;
    }
  }
  return weights;
}();

[[gnu::always_inline]] inline void add_weighted(double weight, const LaneNumbers& x, LaneNumbers& sum) {
  add_weighted(weight, x.re, x.im, sum.re, sum.im);
}
[[gnu::always_inline]] inline void take_distance(const LaneNumbers& x, const LaneNumbers& y, EightLanes& of) {
  take_larger_part({x.re - y.re, x.im - y.im}, of);
}

[[gnu::always_inline]] inline void foresee_steps_block(const StageForecast& forecast, std::size_t w,
                                                       std::size_t count) {
  const auto weights = [&](std::size_t way, int known) {
    return weights_of_steps[static_cast<std::size_t>(std::min(steps_of_way[way], known))].data();
  };
  const int known = forecast.known;
  const double *of_few = weights(1, known), *of_many = weights(2, known);
  const double *of_few_before = weights(1, known - 1), *of_many_before = weights(2, known - 1);
  LaneNumbers last = {}, before = {}, few = {}, many = {}, few_before = {}, many_before = {}, x;
  for (std::size_t k = 0; k < static_cast<std::size_t>(known); ++k) {
    take(forecast.past[k].re + w, count, x.re);
    take(forecast.past[k].im + w, count, x.im);
    add_weighted(of_few[k], x, few);
    add_weighted(of_many[k], x, many);
    if (k == 0) {
      last = x;
    } else {
      before = k == 1 ? x : before;
      add_weighted(of_few_before[k - 1], x, few_before);
      add_weighted(of_many_before[k - 1], x, many_before);
    }
  }
  EightLanes off_one, off_few, off_many;
  take_distance(before, last, off_one);
  take_distance(few_before, last, off_few);
  take_distance(many_before, last, off_many);
  const EightLanes off_two = off_many <= off_few ? off_many : off_few;
  few.re = off_many <= off_few ? many.re : few.re;
  few.im = off_many <= off_few ? many.im : few.im;
  last.re = off_two <= off_one ? few.re : last.re;
  last.im = off_two <= off_one ? few.im : last.im;
  give_number(last, forecast.stage, 0, w, count);
}

}  // namespace

PackedMatrices::PackedMatrices(int rows, int columns, std::size_t waves)
    : rows_(rows),
      columns_(columns),
      entries_((waves + lanes - 1) / lanes * lanes * static_cast<std::size_t>(2 * rows * columns)) {
  clear();
}

void PackedMatrices::clear() {
  std::fill_n(entries_.data(), entries_.size(), 0.0);
}

double PackedMatrices::largest(int row, int column) const {
  const auto block = static_cast<std::size_t>(rows_ * columns_) * 2 * lanes;
  const auto place = static_cast<std::size_t>(column * rows_ + row) * 2 * lanes;
  double square = 0.0;
  for (std::size_t begin = place; begin < entries_.size(); begin += block) {
    for (std::size_t l = 0; l < lanes; ++l) {
      const double re = entries_.data()[begin + l], im = entries_.data()[begin + lanes + l];
      square = larger(square, re * re + im * im);
    }
  }
  return std::sqrt(square);
}

void PackedMatrices::add(int row, int column, std::complex<double> value, const double* re, const double* im,
                         std::size_t begin, std::size_t count) {
  const auto block = static_cast<std::size_t>(rows_ * columns_) * 2 * lanes;
  const auto place = static_cast<std::size_t>(column * rows_ + row) * 2 * lanes;
  add_packed(value.real(), value.imag(), re, im, count, entries_.data() + begin / lanes * block + place, block);
}

void PackedMatrices::apply_to(int first, int count_of_rows, const WaveRows& x, const WaveRows* base, int to,
                              std::size_t begin, std::size_t count, WaveRows& y, int from) const {
  const std::size_t stride = y.waves(), offset = static_cast<std::size_t>(to) * stride;
  const std::size_t start = static_cast<std::size_t>(from) * stride;
  apply_packed(
      rows_, columns_, entries_.data(), first, count_of_rows,
      {x.re.all().data() + start, x.im.all().data() + start, base == nullptr ? nullptr : base->re.all().data() + offset,
       base == nullptr ? nullptr : base->im.all().data() + offset, y.re.all().data() + offset,
       y.im.all().data() + offset, stride},
      begin, count);
}

RUBATO_WIDE_VECTORS void mix(int rows, int columns, const double* weights, const double* x, std::size_t count,
                             double* y) {
  for (std::size_t i = 0; i < count; i += lanes) {
    const std::size_t here = std::min(lanes, count - i);
    int r = 0;
    for (; r + 4 <= rows; r += 4) {
      mix_rows<4>(columns, weights + r * columns, x + i, count, here, y + static_cast<std::size_t>(r) * count + i);
    }
    for (; r < rows; ++r) {
      mix_rows<1>(columns, weights + r * columns, x + i, count, here, y + static_cast<std::size_t>(r) * count + i);
    }
  }
}

RUBATO_WIDE_VECTORS void add_mixed(int rows, int columns, const double* weights, Strided<const double> x,
                                   std::size_t count, Strided<double> y) {
  mix_waves<true>(rows, columns, weights, x, count, y);
}
RUBATO_WIDE_VECTORS void add_mixed(int rows, int columns, const std::complex<double>* weights, Strided<const double> x,
                                   std::size_t count, Strided<double> y) {
  mix_waves<true>(rows, columns, weights, x, count, y);
}
RUBATO_WIDE_VECTORS void mix(int rows, int columns, const double* weights, Strided<const double> x, std::size_t count,
                             Strided<double> y) {
  mix_waves<false>(rows, columns, weights, x, count, y);
}
RUBATO_WIDE_VECTORS void mix(int rows, int columns, const std::complex<double>* weights, Strided<const double> x,
                             std::size_t count, Strided<double> y) {
  mix_waves<false>(rows, columns, weights, x, count, y);
}

RUBATO_WIDE_VECTORS void subtract(double value, const double* x, std::size_t count, double* out) {
  EightLanes from, to;
  for (std::size_t i = 0; i < count; i += lanes) {
    const std::size_t here = std::min(lanes, count - i);
    take(x + i, here, from);
    take(out + i, here, to);
    give(to - value * from, here, out + i);
  }
}

RUBATO_WIDE_VECTORS void measure_distance(Strided<const double> x, Strided<const double> y, std::size_t count,
                                          double* out) {
  LaneNumbers a, b;
  EightLanes larger;
  for (std::size_t w = 0; w < count; w += lanes) {
    const std::size_t here = std::min(lanes, count - w);
    take(x.re + w, here, a.re);
    take(x.im + w, here, a.im);
    take(y.re + w, here, b.re);
    take(y.im + w, here, b.im);
    a.re -= b.re;
    a.im -= b.im;
    take_larger_part(a, larger);
    give(larger, here, out + w);
  }
}

RUBATO_WIDE_VECTORS void foresee_waves(int m, const double* onward, const WaveForecast& forecast, bool judged,
                                       std::size_t count) {
  for (std::size_t w = 0; w < count; w += lanes) {
    if (count - w >= lanes) {
      foresee_block(m, onward, forecast, judged, w, lanes);
    } else {
      foresee_block(m, onward, forecast, judged, w, count - w);
    }
  }
}

RUBATO_WIDE_VECTORS void foresee_steps(const StageForecast& forecast, std::size_t count) {
  for (std::size_t w = 0; w < count; w += lanes) {
    if (count - w >= lanes) {
      foresee_steps_block(forecast, w, lanes);
    } else {
      foresee_steps_block(forecast, w, count - w);
    }
  }
}

RUBATO_WIDE_VECTORS StageSizes place_stage(const double* high, const double* low, const double* y, const double* last,
                                           std::size_t count, double* point) {
  EightLanes moved = {}, change = {}, poison = {}, a, b, c, d;
  for (std::size_t i = 0; i < count; i += lanes) {
    const std::size_t here = std::min(lanes, count - i);
    take(high + i, here, a);
    take(low + i, here, b);
    take(y + i, here, c);
    take(last + i, here, d);
    a = a + (b + c);
    give(a, here, point + i);
    d = c - d;
    poison += 0.0 * d;
    c = c < 0.0 ? -c : c;
    d = d < 0.0 ? -d : d;
    moved = c > moved ? c : moved;
    change = d > change ? d : change;
  }
  StageSizes sizes;
  double bad = 0.0;
  for (std::size_t l = 0; l < lanes; ++l) {
    sizes.moved = std::max(sizes.moved, moved[l]);
    sizes.change = std::max(sizes.change, change[l]);
    bad += poison[l];
  }
  return {sizes.moved + bad, sizes.change + bad};
}

}  // namespace rubato
