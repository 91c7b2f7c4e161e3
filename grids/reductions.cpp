#include <rubato/grids/reductions.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <iterator>
#include <limits>
#include <type_traits>

#include <rubato/base/lanes.hpp>
#include <rubato/grids/largest.hpp>
#include <rubato/grids/weights.hpp>

namespace rubato::grids {

namespace {

constexpr std::size_t lanes = detail::reduction_lanes;

template <bool squared, int native>
void add_in_lanes(std::span<const double> values, double* highs, double* lows) {
  using V = typename VectorOf<native>::type;
  constexpr std::size_t parts = lanes / native;
  V high[parts], low[parts];
  std::memcpy(high, highs, sizeof high);
  std::memcpy(low, lows, sizeof low);
  const auto take = [&](const double* from) {
    for (std::size_t p = 0; p < parts; ++p) {
      V term;
      std::memcpy(&term, from + p * native, sizeof term);
      if constexpr (squared) {
        term *= term;
      }
      const V sum = high[p] + term, part = sum - high[p];
      low[p] += (high[p] - (sum - part)) + (term - part);
      high[p] = sum;
    }
  };
  std::size_t i = 0;
  for (; i + lanes <= values.size(); i += lanes) {
    take(values.data() + i);
  }
  if (i < values.size()) {
    std::array<double, lanes> rest{};
    std::memcpy(rest.data(), values.data() + i, (values.size() - i) * sizeof(double));
    take(rest.data());
  }
  std::memcpy(highs, high, sizeof high);
  std::memcpy(lows, low, sizeof low);
}

/// The largest |a| or, with b, |a - b|; `poison` becomes NaN with a value that is not finite. In several vectors, to
/// hide what a comparison takes: their number does not matter to a maximum.
template <bool has_second, int native>
double largest_of(const double* a, const double* b, std::size_t count, double& poison) {
  using V = typename VectorOf<native>::type;
  constexpr std::size_t chains = 4;
  V sizes[chains] = {}, poisons[chains] = {};
  std::size_t i = 0;
  const auto take = [&](std::size_t c, std::size_t values) {
    V value = {}, other = {};
    std::memcpy(&value, a + i, values * sizeof(double));
    if constexpr (has_second) {
      std::memcpy(&other, b + i, values * sizeof(double));
      value -= other;
    }
    const V size = value < 0.0 ? -value : value;
    sizes[c] = size > sizes[c] ? size : sizes[c];
    poisons[c] += 0.0 * value;
    i += values;
  };
  while (i + chains * native <= count) {
    take(0, native);
    take(1, native);
    take(2, native);
    take(3, native);
  }
  while (i + native <= count) {
    take(0, native);
  }
  if (i < count) {
    take(0, count - i);
  }
  double largest = 0.0;
  for (std::size_t c = 0; c < chains; ++c) {
    for (int l = 0; l < native; ++l) {
      largest = sizes[c][l] > largest ? sizes[c][l] : largest;
      poison += poisons[c][l];
    }
  }
  return largest;
}

template <bool has_second>
double largest_in_vectors(const double* a, const double* b, std::size_t count, double& poison) {
  return in_vectors(vector_lanes(), [=, &poison]<int native>(std::integral_constant<int, native>) {
    return largest_of<has_second, native>(a, b, count, poison);
  });
}

}  // namespace

void LaneSum::add(std::span<const double> terms) {
  in_vectors(vector_lanes(), [=, this]<int native>(std::integral_constant<int, native>) {
    add_in_lanes<false, native>(terms, high_.data(), low_.data());
  });
}

void LaneSum::add_squares(std::span<const double> values) {
  in_vectors(vector_lanes(), [=, this]<int native>(std::integral_constant<int, native>) {
    add_in_lanes<true, native>(values, high_.data(), low_.data());
  });
}

CompensatedSum LaneSum::total() const {
  CompensatedSum sum;
  for (std::size_t l = 0; l < lanes; ++l) {
    sum.add(CompensatedSum(high_[l], low_[l]));
  }
  return sum;
}

double largest_magnitude(const double* values, std::size_t count, double& poison) {
  return largest_in_vectors<false>(values, nullptr, count, poison);
}

double sum(std::span<const double> values) {
  if (Slab::of(values.size()) != nullptr) {
    return sum_of(values.size(), [v = values.data()](std::size_t i) { return v[i]; });
  }
  return detail::sum_of_pieces(values.size(),
                               [values](LaneSum& sum, std::size_t begin, std::size_t end) {
                                 sum.add(values.subspan(begin, end - begin));
                               })
      .value();
}

namespace {

/// largest_in_vectors() of all pieces; NaN where a value is not finite.
template <bool has_second>
double largest_of_pieces(const double* a, const double* b, std::size_t count) {
  const ReductionBlocks pieces(count);
  std::array<double, ReductionBlocks::most> partial;
  for_each_block(count, pieces.block, [&](std::size_t begin, std::size_t end) {
    double poison = 0.0;
    const double largest = largest_in_vectors<has_second>(a + begin, has_second ? b + begin : b, end - begin, poison);
    partial[begin / pieces.block] = poison == 0.0 ? largest : std::numeric_limits<double>::quiet_NaN();
  });
  double largest = 0.0;
  for (std::size_t i = 0; i < pieces.blocks && largest == largest; ++i) {
    largest = partial[i] > largest || partial[i] != partial[i] ? partial[i] : largest;
  }
  return largest;
}

}  // namespace

double max_abs(std::span<const double> values) {
  if (Slab::of(values.size()) == nullptr) {
    if (const double largest = largest_of_pieces<false>(values.data(), nullptr, values.size()); largest == largest) {
      return largest;
    }
  }
  return max_abs_of(values.size(), [v = values.data()](std::size_t i) { return v[i]; });
}

double max_abs_difference(std::span<const double> a, std::span<const double> b) {
  if (Slab::of(a.size()) == nullptr) {
    if (const double largest = largest_of_pieces<true>(a.data(), b.data(), a.size()); largest == largest) {
      return largest;
    }
  }
  return max_abs_of(a.size(), [p = a.data(), q = b.data()](std::size_t i) { return p[i] - q[i]; });
}

namespace {

std::vector<std::span<const double>> each_row(const FieldSet& rows) {
  std::vector<std::span<const double>> each;
  for (int r = 0; r < rows.fields(); ++r) {
    each.push_back(rows.field(r));
  }
  return each;
}

}  // namespace

void sums(std::span<const std::span<const double>> rows, std::span<double> sums) {
  if (rows.empty() || Slab::of(rows.front().size()) == nullptr) {
    std::ranges::transform(rows, sums.begin(), [](std::span<const double> row) { return sum(row); });
    return;
  }
  sums_of(
      rows.front().size(), [&rows](std::size_t row, std::size_t i) { return rows[row][i]; }, sums);
}

namespace {

/// Where nodes have different parts of their cells.
void weighted_sums(const Grid& grid, std::span<const std::span<const double>> rows, std::span<double> sums) {
  const Slab* const slab = Slab::of(grid.size());
  const std::size_t first = slab == nullptr ? 0 : slab->first_node();
  std::vector<CompensatedSum> totals;
  for (const std::span<const double> row : rows) {
    const auto add = [&grid, from = row.subspan(first), first](LaneSum& sum, std::size_t begin, std::size_t end) {
      std::array<double, 512> terms;
      for (; begin < end; begin += terms.size()) {
        const std::span<double> some = std::span(terms).first(std::min(terms.size(), end - begin));
        std::copy_n(from.data() + begin, some.size(), some.begin());
        weigh(grid, first + begin, some);
        sum.add(some);
      }
    };
    totals.push_back(detail::sum_of_pieces(slab == nullptr ? row.size() : slab->owned(), add));
  }
  if (slab != nullptr) {
    slab->reduce(totals, sums, {});
  } else {
    std::ranges::transform(totals, sums.begin(), &CompensatedSum::value);
  }
}

}  // namespace

std::vector<double> integrals(const Grid& grid, std::span<const std::span<const double>> rows) {
  std::vector<double> result(rows.size());
  if (grid.has_walls()) {
    weighted_sums(grid, rows, result);
  } else {
    sums(rows, result);
  }
  for (double& sum : result) {
    sum *= grid.cell_volume();
  }
  return result;
}

std::vector<double> integrals(const Grid& grid, const FieldSet& rows) {
  return integrals(grid, each_row(rows));
}

void max_abs(std::span<const std::span<const double>> rows, std::span<double> largest) {
  const Slab* const slab = rows.empty() ? nullptr : Slab::of(rows.front().size());
  std::ranges::transform(rows, largest.begin(), [slab](std::span<const double> row) {
    const auto value = [v = row.data()](std::size_t i) { return v[i]; };
    return slab == nullptr ? max_abs(row) : detail::max_abs_of_part(*slab, row.size(), value);
  });
  if (slab != nullptr) {
    slab->reduce({}, {}, largest);
  }
}

namespace {

Spread magnitudes_here(std::span<const double> values) {
  const ReductionBlocks pieces(values.size());
  std::array<double, ReductionBlocks::most> largest_of;
  const std::span largest = std::span(largest_of).first(std::max<std::size_t>(pieces.blocks, 1));
  std::ranges::fill(largest, 0.0);
  const double squares = detail::sum_of_pieces(values.size(), [&](LaneSum& sum, std::size_t begin, std::size_t end) {
                           constexpr std::size_t cached = 2048;  // in the first level, as they are read twice
                           double& most = largest[begin / pieces.block];
                           for (; begin < end; begin += cached) {
                             const auto some = values.subspan(begin, std::min(cached, end - begin));
                             double poison = 0.0;
                             most = std::max(most, largest_magnitude(some.data(), some.size(), poison));
                             sum.add_squares(some);
                           }
                         }).value();
  if (std::isfinite(squares)) {
    return Spread::of_magnitudes(*std::ranges::max_element(largest), squares, static_cast<double>(values.size()), 0.0);
  }
  Spread spread;
  for (const double value : values) {
    spread.add(std::isfinite(value) ? std::abs(value) : value);
  }
  return spread;
}

std::vector<Spread> magnitudes_over(const Slab& slab, std::span<const std::span<const double>> rows) {
  std::vector<CompensatedSum> squares;
  std::vector<double> largest;
  for (const std::span<const double> row : rows) {
    const auto value = [v = row.data()](std::size_t i) { return v[i]; };
    const auto square = [v = row.data()](std::size_t i) { return v[i] * v[i]; };
    largest.push_back(detail::max_abs_of_part(slab, row.size(), value));
    squares.push_back(detail::sum_of_part(slab, row.size(), square));
  }
  std::vector<double> sums(rows.size());
  slab.reduce(squares, sums, largest);
  std::vector<Spread> spreads;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    spreads.push_back(
        std::isfinite(sums[row])
            ? Spread::of_magnitudes(largest[row], sums[row], static_cast<double>(whole_count(rows[row].size())), 0.0)
            : slab.magnitudes(rows[row]));
  }
  return spreads;
}

}  // namespace

std::vector<Spread> magnitudes(std::span<const std::span<const double>> rows) {
  if (const Slab* const slab = rows.empty() ? nullptr : Slab::of(rows.front().size())) {
    return magnitudes_over(*slab, rows);
  }
  std::vector<Spread> spreads;
  std::ranges::transform(rows, std::back_inserter(spreads), magnitudes_here);
  return spreads;
}

std::vector<Spread> magnitudes(const FieldSet& rows) {
  return magnitudes(each_row(rows));
}

Spread magnitudes(std::span<const double> values) {
  const Slab* const slab = Slab::of(values.size());
  return slab == nullptr ? magnitudes_here(values) : magnitudes_over(*slab, std::span(&values, 1)).front();
}

}  // namespace rubato::grids
