#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <rubato/base/state.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// The rows of everything that lies along /levels/t and /levels/step, of the levels of a block of steps and of the
/// steps that led there. They are filled in at every level, and go into the record where the level has a row.
///
/// Rows of other datasets that are appended here go on to a sink at once: a run appends all of a step to one object.
class LevelRows final : public RowSink {
public:
  using RowSink::append;

  /// \param layout with all columns of these two axes; it has to live longer
  /// \param levels of a block at most
  void describe(const record::Layout& layout, std::size_t levels);

  /// Where all other rows go.
  void pass_on_to(RowSink& sink) { others_ = &sink; }

  /// The row of this place in the block is filled in, appended or saved.
  void look_at(std::size_t place) { place_ = place; }
  void put(record::Column column, double value) { rows_[column.number * levels_ + place_] = value; }
  /// Of that row and of every `stride`-th after it, `count` in all. Valid until the next call.
  [[nodiscard]] std::span<const double> values(record::Column column, std::size_t count, std::size_t stride);

  void append(record::Column column, std::span<const double> row) override;
  void append(record::Column column, std::span<const std::int64_t> row) override;
  void append_part(record::Column column, std::span<const double> part, bool is_last) override;
  InParts in_parts(std::span<const record::Column> columns) override { return others_->in_parts(columns); }
  void append_checksum(record::Column column, const Checksum& row) override { others_->append_checksum(column, row); }

  /// Appends the row, and every `stride`-th after it, `count` in all: of levels, and unless it is the start of steps.
  void append_to(RowSink& sink, bool is_start, std::size_t count, std::size_t stride);
  /// Of the first `count` rows. \param level the first \throws record::NotFinite where a record would refuse one
  void require_finite(std::size_t count, std::size_t level) const;

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Kept {
    record::Column column;
    bool of_step;
    bool is_integer;
  };
  [[nodiscard]] bool keeps(record::Column column) const { return is_kept_[column.number]; }

  const record::Layout* layout_ = nullptr;
  RowSink* others_ = nullptr;
  std::vector<Kept> kept_;
  std::vector<bool> is_kept_;  ///< by dataset
  std::size_t levels_ = 1, place_ = 0;
  std::vector<double> rows_;  ///< by dataset, one place of the block after the other
  std::vector<double> numbers_;
  std::vector<std::int64_t> integers_;
};

}  // namespace rubato
