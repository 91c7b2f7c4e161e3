#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

#include <rubato/record/layout.hpp>

namespace rubato::study {

/// Where the rows of a record go as a run produces them: into the record, or into a comparison with one. Columns are
/// those of one layout.
class RowSink {
public:
  virtual ~RowSink() = default;
  virtual void append(record::Column column, std::span<const double> row) = 0;
  virtual void append(record::Column column, std::span<const std::int64_t> row) = 0;

  /// One number, for datasets with one number per row.
  void append(record::Column column, std::floating_point auto value) {
    const double number = value;
    append(column, std::span<const double>(&number, 1));
  }
  void append(record::Column column, std::integral auto value) {
    const auto number = static_cast<std::int64_t>(value);
    append(column, std::span<const std::int64_t>(&number, 1));
  }
};

}  // namespace rubato::study
