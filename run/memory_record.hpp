#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include <rubato/record/layout.hpp>
#include <rubato/run/row_sink.hpp>
#include <rubato/run/run.hpp>

namespace rubato {

/// The rows of a run in memory: the same numbers, under the same paths, as the record of the run has (docs/records.md).
class MemoryRecord final : public RowSink {
public:
  using RowSink::append;
  /// All rows of a dataset, one after the other.
  using Values = std::variant<std::vector<double>, std::vector<std::int64_t>>;

  /// Forgets all rows, and takes those of another layout.
  void begin(record::Layout layout);
  /// \throws record::NotFinite as record::Writer::append()
  void append(record::Column column, std::span<const double> row) override;
  void append(record::Column column, std::span<const std::int64_t> row) override;
  void append_rows(record::Column column, std::size_t /*rows*/, std::span<const double> values) override {
    append(column, values);
  }
  void append_rows(record::Column column, std::size_t /*rows*/, std::span<const std::int64_t> values) override {
    append(column, values);
  }
  void append_part(record::Column column, std::span<const double> part, bool /*is_last*/) override {
    append(column, part);
  }
  /// As record::Writer has them: whole levels, and what was appended since the last one.
  ///@{
  void end_level();
  void drop_level();
  ///@}

  [[nodiscard]] const record::Layout& layout() const { return layout_; }
  [[nodiscard]] const Values& values(std::size_t dataset) const { return values_.at(dataset); }
  /// The number of values in one row.
  [[nodiscard]] std::size_t row_size(std::size_t dataset) const { return row_sizes_.at(dataset); }

private:
  record::Layout layout_;
  std::vector<Values> values_;
  std::vector<std::size_t> row_sizes_, whole_;  ///< of each dataset; whole_: values at the end of the last level
  bool appended_ = false;                       ///< since then
};

/// Runs a problem as run() with a file does: `record` takes all rows, in place of those that it has. \throws
/// ProblemError
[[nodiscard]] Outcome run(const Problem& problem, MemoryRecord& record, const RunOptions& options = {});

}  // namespace rubato
