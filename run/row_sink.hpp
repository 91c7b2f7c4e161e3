#pragma once

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <vector>

#include <rubato/base/checksum.hpp>
#include <rubato/record/layout.hpp>

namespace rubato {

/// Where the rows of a record go as a run produces them: into the record, or into a comparison with one. Columns are
/// those of one layout.
class RowSink {
public:
  virtual ~RowSink() = default;
  virtual void append(record::Column column, std::span<const double> row) = 0;
  virtual void append(record::Column column, std::span<const std::int64_t> row) = 0;
  /// Rows of one length, one after the other.
  virtual void append_rows(record::Column column, std::size_t rows, std::span<const double> values) {
    append_one_by_one(column, rows, values);
  }
  virtual void append_rows(record::Column column, std::size_t rows, std::span<const std::int64_t> values) {
    append_one_by_one(column, rows, values);
  }
  /// A row in parts, which follow one another as in the row, and nothing else in between.
  virtual void append_part(record::Column column, std::span<const double> part, bool is_last) {
    parts_.insert(parts_.end(), part.begin(), part.end());
    if (is_last) {
      append(column, std::span<const double>(parts_));
      parts_.clear();
    }
  }

  /// What is to become of the next rows of columns whose rows ranks have in parts.
  struct InParts {
    enum class Wanted {
      numbers,   ///< each row as others, by append() or append_part()
      checksum,  ///< append_checksum() of each row; nothing of its numbers
      written,   ///< the same, when ranks have written them into `file` as rows `rows` (record/together.hpp)
    };
    Wanted wanted = Wanted::numbers;
    std::filesystem::path file;
    std::vector<std::size_t> rows;  ///< of each column; with none, numbers may be of any value
  };
  virtual InParts in_parts(std::span<const record::Column> /*columns*/) { return {}; }
  /// \throws std::logic_error unless in_parts() asks for it
  virtual void append_checksum(record::Column /*column*/, const Checksum& /*row*/) {
    throw std::logic_error("these rows are wanted, not their checksums");
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
  template <typename Number>
  void append_one_by_one(record::Column column, std::size_t rows, std::span<const Number> values) {
    const std::size_t size = values.size() / std::max<std::size_t>(rows, 1);
    for (std::size_t i = 0; i < rows; ++i) {
      append(column, values.subspan(i * size, size));
    }
  }

  std::vector<double> parts_;
};

}  // namespace rubato
