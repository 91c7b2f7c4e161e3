#include <rubato/run/memory_record.hpp>

#include <algorithm>
#include <utility>

#include <rubato/record/error.hpp>

namespace rubato {

namespace {

/// Values of a dataset for which room is made beforehand: a gigabyte, so that two dozen of these fit into any address
/// space.
constexpr std::size_t most_reserved = std::size_t{1} << 27;

std::size_t size_of(const MemoryRecord::Values& values) {
  return std::visit([](const auto& numbers) { return numbers.size(); }, values);
}

}  // namespace

void MemoryRecord::begin(record::Layout layout) {
  layout_ = std::move(layout);
  values_.clear();
  row_sizes_.clear();
  for (const record::Dataset& dataset : layout_.datasets) {
    const std::size_t size = record::row_size(layout_, dataset);
    row_sizes_.push_back(size);
    dataset.type == record::Type::f64 ? values_.emplace_back(std::vector<double>())
                                      : values_.emplace_back(std::vector<std::int64_t>());
    // Rows are not moved as more come. Memory that is not used costs nothing.
    const std::size_t expected = std::min(dataset.expected_rows.value_or(0), most_reserved / size);
    std::visit([&](auto& values) { values.reserve(expected * size); }, values_.back());
  }
  whole_.assign(values_.size(), 0);
}

void MemoryRecord::append(record::Column column, std::span<const double> row) {
  auto& values = std::get<std::vector<double>>(values_[column.number]);
  appended_ = true;
  record::require_finite(layout_.datasets[column.number], row, row_sizes_[column.number], values.size());
  values.insert(values.end(), row.begin(), row.end());
}

void MemoryRecord::append(record::Column column, std::span<const std::int64_t> row) {
  auto& values = std::get<std::vector<std::int64_t>>(values_[column.number]);
  appended_ = true;
  values.insert(values.end(), row.begin(), row.end());
}

void MemoryRecord::end_level() {
  if (std::exchange(appended_, false)) {
    std::ranges::transform(values_, whole_.begin(), &size_of);
  }
}

void MemoryRecord::drop_level() {
  for (std::size_t i = 0; i < values_.size(); ++i) {
    std::visit([&](auto& numbers) { numbers.resize(whole_[i]); }, values_[i]);
  }
}

}  // namespace rubato
