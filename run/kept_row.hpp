#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <rubato/run/row_sink.hpp>

namespace rubato {

/// Keeps the rows of one time or step, dataset by dataset, to be compared with those of a record.
class KeptRow final : public RowSink {
public:
  using RowSink::append;
  explicit KeptRow(std::size_t datasets) : rows_(datasets) {}

  void append(record::Column column, std::span<const double> row) override {
    rows_.at(column.number).assign(row.begin(), row.end());
  }
  void append(record::Column column, std::span<const std::int64_t> row) override {
    rows_.at(column.number).assign(row.begin(), row.end());
  }
  /// Empty where nothing was appended.
  [[nodiscard]] const std::vector<double>& at(std::size_t dataset) const { return rows_[dataset]; }

private:
  std::vector<std::vector<double>> rows_;
};

}  // namespace rubato
