#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <rubato/record/layout.hpp>

namespace rubato {

/// Where the rows of a record go as a run produces them: into the record, or into a comparison with one. Columns are
/// those of one layout.
class RowSink {
public:
  virtual ~RowSink() = default;
  virtual void append(record::Column column, std::span<const double> row) = 0;
  virtual void append(record::Column column, std::span<const std::int64_t> row) = 0;
  /// A row in parts, which follow one another as in the row, and nothing else in between.
  virtual void append_part(record::Column column, std::span<const double> part, bool is_last) {
    parts_.insert(parts_.end(), part.begin(), part.end());
    if (is_last) {
      append(column, std::span<const double>(parts_));
      parts_.clear();
    }
  }

  /// One number, for datasets with one number per row.
  void append(record::Column column, std::floating_point auto value) {
    const double number = value;
    append(column, std::span<const double>(&number, 1));
  }
  void append(record::Column column, std::integral auto value) {
    const auto number = static_cast<std::int64_t>(value);
    append(column, std::span<const std::int64_t>(&number, 1));
  }

private:
  std::vector<double> parts_;
};

}  // namespace rubato
