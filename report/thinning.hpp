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

/// The envelope with as many buckets as leave it at most `points` points, at least 5: all points, if they are no more.
[[nodiscard]] std::vector<std::size_t> envelope_within(std::span<const double> y, std::size_t points);

/// The union of ascending lists of indices.
[[nodiscard]] std::vector<std::size_t> merge(std::span<const std::size_t> a, std::span<const std::size_t> b);

/// values[indices[0]], values[indices[1]], …; with a stride and an offset for columns of a matrix.
[[nodiscard]] std::vector<double> pick(std::span<const double> values, std::span<const std::size_t> indices,
                                       std::size_t stride = 1, std::size_t offset = 0);

/// A curve in as many dimensions as it has columns, point after point: column c of point k is
/// columns[c][k · strides[c]]. Each is measured in units of its range.
struct Path {
  std::size_t size = 0;
  std::vector<const double*> columns;
  std::vector<std::size_t> strides;
};

/// Points of a path to be joined by straight lines.
struct PathSelection {
  std::vector<std::size_t> kept;    ///< ascending
  std::vector<std::size_t> starts;  ///< places in `kept` where a piece begins; the first is 0
  /// How far a point between two that are joined lies from the line between them, at most, all columns taken together;
  /// it is as near as that in any two columns as well.
  double deviation = 0.0;
};

/// At most `points` (at least 50) points of a path whose lines keep its shape. They lie the more densely, the more the
/// path bends: with the square root of the distance of a point from the middle of its neighbours, which makes all
/// distances between path and lines equally long. If they are too few to come within a hundredth of the range, the path
/// is drawn in pieces that are evenly spread over it, the first and the last among them, and each is.
[[nodiscard]] PathSelection thin_path(const Path& path, std::size_t points);

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
  /// As finely of other places: in as many runs, or whole as this one is.
  [[nodiscard]] Partition of(std::size_t places) const { return {places, is_whole() ? places : parts_}; }

private:
  std::size_t places_, parts_;
};

/// The smallest and the largest value in each block of a matrix that is given row by row. A block with a value that is
/// not finite is NaN: that there is one must not be lost among others.
class BlockEnvelope {
public:
  BlockEnvelope(const Partition& rows, const Partition& columns);

  /// The next row; `values` has as many entries as there are columns.
  void add_row(std::span<const double> values);
  /// Passes over a row in which there is nothing to be seen: blocks without any other row are NaN.
  void skip_row();

  [[nodiscard]] const Partition& rows() const { return rows_; }
  [[nodiscard]] const Partition& columns() const { return columns_; }
  /// True if each block is a single value, so that low() and high() are the data.
  [[nodiscard]] bool is_whole() const { return rows_.is_whole() && columns_.is_whole(); }
  /// Row by row; complete once every row was added.
  [[nodiscard]] const std::vector<double>& low() const { return low_; }
  [[nodiscard]] const std::vector<double>& high() const { return high_; }

private:
  void close_row();

  Partition rows_, columns_;
  std::size_t next_row_ = 0;
  std::vector<double> low_, high_;
};

}  // namespace rubato::report
