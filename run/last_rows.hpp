#pragma once

#include <cstdint>
#include <vector>

#include <rubato/record/error.hpp>
#include <rubato/run/ensemble_member.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// Keeps the last row of a state, and all of what is kept whole, and refuses what a record of the run would.
class LastRows final : public RowSink {
public:
  explicit LastRows(const record::Layout& layout) : layout_(layout), rows_(layout.datasets.size()) {
    for (const record::Dataset& dataset : layout.datasets) {
      kept_.push_back(is_kept_whole(dataset) ? Kept::all : is_last_state(dataset) ? Kept::last : Kept::none);
    }
  }
  using RowSink::append;
  void append(record::Column column, std::span<const double> row) override {
    record::require_finite(layout_.datasets[column.number], row, row.size(), 0);
    keep(column.number, row);
  }
  void append(record::Column column, std::span<const std::int64_t> row) override { keep(column.number, row); }
  void clear() {
    for (std::vector<double>& rows : rows_) {
      rows.clear();
    }
  }
  /// The last row of a state; of what is kept whole all, one after the other.
  [[nodiscard]] const std::vector<double>& kept(std::size_t dataset) const { return rows_[dataset]; }

private:
  enum class Kept : std::uint8_t { none, last, all };

  template <typename Row>
  void keep(std::size_t dataset, Row row) {
    if (kept_[dataset] == Kept::none) {
      return;
    }
    if (kept_[dataset] == Kept::last) {
      rows_[dataset].clear();
    }
    rows_[dataset].insert(rows_[dataset].end(), row.begin(), row.end());
  }

  const record::Layout& layout_;
  std::vector<Kept> kept_;  ///< by dataset
  std::vector<std::vector<double>> rows_;
};

}  // namespace rubato
