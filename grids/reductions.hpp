#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include <rubato/base/compensated_sum.hpp>
#include <rubato/base/spread.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/slab.hpp>

namespace rubato::grids {

/// The pieces a reduction over `count` values is cut into; at most 1024, and a function of `count` alone, so that
/// results do not depend on the number of threads.
struct ReductionBlocks {
  static constexpr std::size_t most = 1024;
  std::size_t block;
  std::size_t blocks;
  explicit ReductionBlocks(std::size_t count)
      : block(std::max<std::size_t>(4096, ((count + most - 1) / most + 7) / 8 * 8)),
        blocks((count + block - 1) / block) {}
};

/// A sum in eight lanes, term i in lane i mod 8, each of which carries its rounding errors along (Knuth's two-sum). Its
/// error is one rounding of the sum and n ε² Σ|terms|.
class LaneSum {
public:
  void add(std::span<const double> terms);
  /// The squares, each rounded, of so many values.
  void add_squares(std::span<const double> values);
  [[nodiscard]] CompensatedSum total() const;

private:
  std::array<double, 8> high_{}, low_{};
};

namespace detail {

inline constexpr std::size_t reduction_lanes = 8;

/// take(lane, f(i)) for i in [begin, end), lane after lane, so that the compiler can keep the lanes in vectors.
template <class F, class Take>
void take_in_lanes(std::size_t begin, std::size_t end, F& f, const Take& take) {
  std::size_t i = begin;
  for (; i + reduction_lanes <= end; i += reduction_lanes) {
    for (std::size_t l = 0; l < reduction_lanes; ++l) {
      take(l, f(i + l));
    }
  }
  for (std::size_t l = 0; i + l < end; ++l) {
    take(l, f(i + l));
  }
}

/// Adds f(begin), …, f(end - 1).
template <class F>
void add_terms(LaneSum& sum, std::size_t begin, std::size_t end, F& f) {
  std::array<double, 512> terms;  // what a first-level cache holds beside what f reads
  for (; begin < end; begin += terms.size()) {
    const std::size_t count = std::min(terms.size(), end - begin);
    for (std::size_t i = 0; i < count; ++i) {
      terms[i] = f(begin + i);
    }
    sum.add(std::span(terms).first(count));
  }
}

/// The sum of what add(sum, begin, end) adds for pieces of [0, count), in parallel: the pieces' sums in their order.
template <class Add>
CompensatedSum sum_of_pieces(std::size_t count, const Add& add) {
  const auto sum_of_piece = [&add](std::size_t begin, std::size_t end) {
    LaneSum sum;
    add(sum, begin, end);
    return sum.total();
  };
  const ReductionBlocks pieces(count);
  if (pieces.blocks <= 1) {
    return sum_of_piece(0, count);
  }
  std::array<CompensatedSum, ReductionBlocks::most> partial;
  grids::for_each_block(count, pieces.block, [&](std::size_t begin, std::size_t end) {
    partial[begin / pieces.block] = sum_of_piece(begin, end);
  });
  CompensatedSum total;
  for (std::size_t b = 0; b < pieces.blocks; ++b) {
    total.add(partial[b]);
  }
  return total;
}

/// Σ f(i) over the values of arrays of `count` that this rank owns.
template <class F>
CompensatedSum sum_of_part(const Slab& slab, std::size_t count, F& f) {
  CompensatedSum total;
  for (std::size_t first = slab.first_node(); first < count; first += slab.size()) {
    total.add(sum_of_pieces(slab.owned(), [&f, first](LaneSum& sum, std::size_t begin, std::size_t end) {
      add_terms(sum, first + begin, first + end, f);
    }));
  }
  return total;
}

}  // namespace detail

/// Σ_i f(i) for i in [0, count), in parallel, by LaneSum: the same bit by bit for every number of threads. Where this
/// thread has a Slab it is over the whole lattice, and to one rounding of the sum and n ε² Σ|f(i)| the same for every
/// number of ranks. Terms that are not finite, and sums that overflow, give NaN or an infinity.
template <class F>
double sum_of(std::size_t count, F&& f) {
  if (const Slab* const slab = Slab::of(count)) {
    CompensatedSum total = detail::sum_of_part(*slab, count, f);
    double sum = 0.0;
    slab->reduce(std::span(&total, 1), std::span(&sum, 1), {});
    return sum;
  }
  return detail::sum_of_pieces(
             count, [&f](LaneSum& sum, std::size_t begin, std::size_t end) { detail::add_terms(sum, begin, end, f); })
      .value();
}

/// The same of several rows, Σ_i f(r, i) for r = 0, 1, …, which ranks exchange together.
template <class F>
void sums_of(std::size_t count, F&& f, std::span<double> sums) {
  const Slab* const slab = Slab::of(count);
  std::array<CompensatedSum, 32> totals;
  for (std::size_t first = 0; first < sums.size(); first += totals.size()) {
    const auto some = sums.subspan(first, std::min(totals.size(), sums.size() - first));
    for (std::size_t row = 0; row < some.size(); ++row) {
      const auto term = [&f, number = first + row](std::size_t i) { return f(number, i); };
      if (slab == nullptr) {
        some[row] = sum_of(count, term);
      } else {
        totals[row] = detail::sum_of_part(*slab, count, term);
      }
    }
    if (slab != nullptr) {
      slab->reduce(std::span(totals).first(some.size()), some, {});
    }
  }
}

namespace detail {

template <class F>
double max_abs_here(std::size_t count, F& f) {
  const ReductionBlocks pieces(count);
  std::array<double, ReductionBlocks::most> partial;
  const auto larger = [](double a, double b) { return b > a || b != b ? b : a; };
  grids::for_each_block(count, pieces.block, [&](std::size_t begin, std::size_t end) {
    constexpr std::size_t lanes = detail::reduction_lanes;
    std::array<double, lanes> sizes{};
    std::array<double, lanes> poison{};  // becomes NaN with the first value that is not finite
    const auto take = [&](std::size_t lane, double value) {
      const double size = std::abs(value);
      sizes[lane] = size > sizes[lane] ? size : sizes[lane];
      poison[lane] += 0.0 * size;
    };
    detail::take_in_lanes(begin, end, f, take);
    double largest = *std::max_element(sizes.begin(), sizes.end());
    if (std::any_of(poison.begin(), poison.end(), [](double value) { return value != 0.0; })) {
      for (std::size_t i = begin; i < end && largest == largest; ++i) {
        largest = larger(largest, std::abs(f(i)));
      }
    }
    partial[begin / pieces.block] = largest;
  });
  double largest = 0.0;
  for (std::size_t b = 0; b < pieces.blocks && largest == largest; ++b) {
    largest = larger(largest, partial[b]);
  }
  return largest;
}

}  // namespace detail

/// Of how many values a reduction over `count` of them is: those of the whole lattice, where this thread has a Slab.
inline std::size_t whole_count(std::size_t count) {
  const Slab* const slab = Slab::of(count);
  return slab == nullptr ? count : count / slab->size() * slab->whole().size();
}

namespace detail {

/// max_i |f(i)| over what this rank owns.
template <class F>
double max_abs_of_part(const Slab& slab, std::size_t count, F& f) {
  double largest = 0.0;
  for (std::size_t begin = slab.first_node(); begin < count && largest == largest; begin += slab.size()) {
    const auto owned = [&f, begin](std::size_t i) { return f(begin + i); };
    const double here = max_abs_here(slab.owned(), owned);
    largest = here > largest || here != here ? here : largest;
  }
  return largest;
}

}  // namespace detail

/// max_i |f(i)|, 0 for none; NaN if one of the values is NaN. With a Slab as sum_of().
template <class F>
double max_abs_of(std::size_t count, F&& f) {
  if (const Slab* const slab = Slab::of(count)) {
    double largest = detail::max_abs_of_part(*slab, count, f);
    slab->reduce({}, {}, std::span(&largest, 1));
    return largest;
  }
  return detail::max_abs_here(count, f);
}

/// The same of an array, in vectors, with the same bits.
///@{
double sum(std::span<const double> values);
double max_abs(std::span<const double> values);
/// max_i |a_i - b_i|. Hypothesis: equal sizes.
double max_abs_difference(std::span<const double> a, std::span<const double> b);
///@}
/// Σ a_i b_i; products rounded, their sum as sum_of(). Hypothesis: equal sizes.
inline double dot(std::span<const double> a, std::span<const double> b) {
  return sum_of(a.size(), [p = a.data(), q = b.data()](std::size_t i) { return p[i] * q[i]; });
}
/// Σ values and max |values| of each row, which ranks exchange together; and Σ ΔV values,
/// by Grid::weight() between walls.
///@{
void sums(std::span<const std::span<const double>> rows, std::span<double> sums);
[[nodiscard]] std::vector<double> integrals(const Grid& grid, std::span<const std::span<const double>> rows);
[[nodiscard]] std::vector<double> integrals(const Grid& grid, const FieldSet& rows);
void max_abs(std::span<const std::span<const double>> rows, std::span<double> largest);
///@}
/// The magnitudes |v_i|, of each row. Values that are not finite, or whose squares are not, are rare: they are looked
/// for only where Σ v_i² says that there are any.
///@{
[[nodiscard]] std::vector<Spread> magnitudes(std::span<const std::span<const double>> rows);
[[nodiscard]] std::vector<Spread> magnitudes(const FieldSet& rows);
[[nodiscard]] Spread magnitudes(std::span<const double> values);
///@}
/// sqrt(Σ v_i² / n).
inline double rms(std::span<const double> values) {
  return values.empty() ? 0.0 : std::sqrt(dot(values, values) / static_cast<double>(whole_count(values.size())));
}

}  // namespace rubato::grids
