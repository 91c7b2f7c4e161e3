#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace rubato::report {

/// Indices of the points that a picture of y needs: all of them if there are at most 2 · buckets; else of each of
/// `buckets` runs of consecutive points those with the smallest and the largest value, besides the first and the last
/// point of all. Values are selected, never averaged: the extremes over any bucket, and so a spike of one point, are
/// those of the data. Where a bucket holds values that are not finite, its first such point is kept too, so that gaps
/// stay gaps. Ascending.
[[nodiscard]] std::vector<std::size_t> envelope(std::span<const double> y, std::size_t buckets);

/// The union of ascending lists of indices.
[[nodiscard]] std::vector<std::size_t> merge(std::span<const std::size_t> a, std::span<const std::size_t> b);

/// values[indices[0]], values[indices[1]], …; with a stride and an offset for columns of a matrix.
[[nodiscard]] std::vector<double> pick(std::span<const double> values, std::span<const std::size_t> indices,
                                       std::size_t stride = 1, std::size_t offset = 0);

/// A division of n places into at most `parts` runs of nearly equal length: run b begins at ceil(b·n/parts).
class Partition {
public:
  Partition(std::size_t places, std::size_t most_parts);
  [[nodiscard]] std::size_t places() const { return places_; }
  [[nodiscard]] std::size_t parts() const { return parts_; }
  [[nodiscard]] std::size_t begin(std::size_t part) const { return (part * places_ + parts_ - 1) / parts_; }
  [[nodiscard]] std::size_t end(std::size_t part) const { return begin(part + 1); }
  [[nodiscard]] std::size_t part_of(std::size_t place) const { return place * parts_ / places_; }
  [[nodiscard]] bool is_whole() const { return parts_ == places_; }

private:
  std::size_t places_, parts_;
};

/// The smallest and the largest value in each block of a matrix that is given row by row. Values that are not finite
/// count only where a block holds no others: the block is then NaN.
class BlockEnvelope {
public:
  BlockEnvelope(const Partition& rows, const Partition& columns);

  /// The next row; `values` has as many entries as there are columns.
  void add_row(std::span<const double> values);

  [[nodiscard]] const Partition& rows() const { return rows_; }
  [[nodiscard]] const Partition& columns() const { return columns_; }
  /// Whether each block is a single value, so that low() and high() are the data.
  [[nodiscard]] bool is_whole() const { return rows_.is_whole() && columns_.is_whole(); }
  /// Row by row; complete once every row was added.
  [[nodiscard]] const std::vector<double>& low() const { return low_; }
  [[nodiscard]] const std::vector<double>& high() const { return high_; }

private:
  void close_row_of_blocks(std::size_t part);

  Partition rows_, columns_;
  std::size_t next_row_ = 0;
  std::vector<double> low_, high_;
};

}  // namespace rubato::report
