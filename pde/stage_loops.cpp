#include <rubato/pde/stage_loops.hpp>

#include <algorithm>
#include <cstring>

#include <rubato/grids/wide_vectors.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::stage_loops;

using grids::EightLanes;
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

/// R rows of a mixture on one block.
template <int R, typename Weight>
[[gnu::always_inline]] inline void add_mixed_block(int columns, const Weight* weights, const Strided<const double>& x,
                                                   std::size_t count, const Strided<double>& y) {
  EightLanes re[R], im[R], x_re, x_im;
  for (int r = 0; r < R; ++r) {
    take(y.re + static_cast<std::size_t>(r) * y.stride, count, re[r]);
    take(y.im + static_cast<std::size_t>(r) * y.stride, count, im[r]);
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

template <typename Weight>
[[gnu::always_inline]] inline void add_mixed_rows(int rows, int columns, const Weight* weights, Strided<const double> x,
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
        add_mixed_block<some>(columns, own, from, lanes, to);
        r += some;
      } else if (here == lanes) {
        add_mixed_block<1>(columns, own, from, lanes, to);
        ++r;
      } else if (here == 1) {
        add_mixed_block<1>(columns, own, from, 1, to);
        ++r;
      } else {
        add_mixed_block<1>(columns, own, from, here, to);
        ++r;
      }
    }
  }
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
  add_mixed_rows(rows, columns, weights, x, count, y);
}
RUBATO_WIDE_VECTORS void add_mixed(int rows, int columns, const std::complex<double>* weights, Strided<const double> x,
                                   std::size_t count, Strided<double> y) {
  add_mixed_rows(rows, columns, weights, x, count, y);
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
