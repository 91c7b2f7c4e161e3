#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include <fmt/format.h>

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
    const record::Dataset& description = layout_.datasets[column.number];
    const auto wrong = std::ranges::find_if(row, [](double value) { return !std::isfinite(value); });
    if (wrong != row.end() && !description.may_be_undefined) {
      throw Undefined{fmt::format("a value of {} is {}", description.path, *wrong)};
    }
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

  struct Undefined {
    std::string what;
  };

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
