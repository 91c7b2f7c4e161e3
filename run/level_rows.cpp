#include <rubato/run/level_rows.hpp>

#include <rubato/record/error.hpp>

namespace rubato {

void LevelRows::describe(const record::Layout& layout, std::size_t levels) {
  layout_ = &layout;
  levels_ = levels;
  is_kept_.assign(layout.datasets.size(), false);
  rows_.assign(layout.datasets.size() * levels, 0.0);
  for (std::size_t i = 0; i < layout.datasets.size(); ++i) {
    const record::Dataset& dataset = layout.datasets[i];
    const bool of_step = dataset.axis == "/levels/step";
    if (of_step || dataset.axis == "/levels/t") {
      is_kept_[i] = true;
      kept_.push_back({{i}, of_step, dataset.type != record::Type::f64});
    }
  }
}

void LevelRows::append(record::Column column, std::span<const double> row) {
  if (keeps(column)) {
    put(column, row.front());
  } else {
    others_->append(column, row);
  }
}

void LevelRows::append(record::Column column, std::span<const std::int64_t> row) {
  if (keeps(column)) {
    put(column, static_cast<double>(row.front()));
  } else {
    others_->append(column, row);
  }
}

void LevelRows::append_part(record::Column column, std::span<const double> part, bool is_last) {
  others_->append_part(column, part, is_last);
}

std::span<const double> LevelRows::values(record::Column column, std::size_t count, std::size_t stride) {
  numbers_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    numbers_[i] = rows_[column.number * levels_ + place_ + i * stride];
  }
  return numbers_;
}

void LevelRows::append_to(RowSink& sink, bool is_start, std::size_t count, std::size_t stride) {
  for (const Kept& kept : kept_) {
    if (is_start && kept.of_step) {
      continue;
    }
    const std::span<const double> numbers = values(kept.column, count, stride);
    if (kept.is_integer) {
      integers_.assign(numbers.begin(), numbers.end());
      sink.append_rows(kept.column, count, integers_);
    } else {
      sink.append_rows(kept.column, count, numbers);
    }
  }
}

void LevelRows::require_finite(std::size_t count, std::size_t level) const {
  for (const Kept& kept : kept_) {
    record::require_finite(layout_->datasets[kept.column.number], {&rows_[kept.column.number * levels_], count}, 1,
                           level);
  }
}

void LevelRows::save(StateWriter& state) const {
  for (const Kept& kept : kept_) {
    state.write(rows_[kept.column.number * levels_ + place_]);
  }
}

void LevelRows::restore(StateReader& state) {
  for (const Kept& kept : kept_) {
    put(kept.column, state.read());
  }
}

}  // namespace rubato
