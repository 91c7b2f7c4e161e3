#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/record/writer.hpp>
#include <rubato/run/observed_run.hpp>
#include <rubato/run/row_sink.hpp>
#include <rubato/run/run.hpp>

namespace rubato {

[[nodiscard]] inline record::Locking locking_of(const RunOptions& options) {
  return options.lock ? record::Locking::yes : record::Locking::no;
}

/// Writes rows into a record.
class Recorder final : public RowSink {
public:
  using RowSink::append;

  explicit Recorder(record::Writer writer) : writer_(std::move(writer)) {}

  void append(record::Column column, std::span<const double> row) override { append_rows(column, 1, row); }
  void append(record::Column column, std::span<const std::int64_t> row) override { append_rows(column, 1, row); }
  void append_rows(record::Column column, std::size_t rows, std::span<const double> values) override {
    appended_ = true;
    writer_.append(column.number, values, rows);
  }
  void append_rows(record::Column column, std::size_t rows, std::span<const std::int64_t> values) override {
    appended_ = true;
    writer_.append(column.number, values, rows);
  }
  void append_part(record::Column column, std::span<const double> part, bool /*is_last*/) override {
    appended_ = true;
    writer_.append_part(column.number, part);
  }
  InParts in_parts(std::span<const record::Column> columns) override;
  void append_checksum(record::Column column, const Checksum& row) override {
    appended_ = true;
    writer_.append_written(column.number, row);
  }
  [[nodiscard]] record::Writer& writer() { return writer_; }
  /// True if rows were appended since the last call.
  [[nodiscard]] bool take_appended() { return std::exchange(appended_, false); }

private:
  record::Writer writer_;
  bool appended_ = false;
};

/// About how many bytes the record of a run takes: its rows and one checkpoint. Empty if the number of rows is unknown.
[[nodiscard]] std::optional<double> expected_record_bytes(const ObservedRun& observed);
/// Numbers in the state that a checkpoint of it has.
[[nodiscard]] std::size_t size_of_state(const ObservedRun& observed);

/// All that `resume` needs, for record::Writer: the state is written part by part, and never copied as a
/// whole. The observed has to stay as it is meanwhile. \param begin called before the state is saved, by all ranks
/// that share it \param measures those of the verdict, asked for after that
[[nodiscard]] record::CheckpointInParts make_checkpoint(const ObservedRun& observed, std::function<void()> begin,
                                                        std::function<figures::Measures()> measures);

/// Brings a run to where the checkpoint was made. False, and the run in no state to be used, if the
/// checkpoint is not one of its problem.
[[nodiscard]] bool restore(const record::Checkpoint& checkpoint, ObservedRun& observed);
/// The same with the "state" apart from all else.
[[nodiscard]] bool restore(const record::Checkpoint& others, StateReader& state, ObservedRun& observed);

}  // namespace rubato
