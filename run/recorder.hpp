#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include <rubato/record/writer.hpp>
#include <rubato/run/chronicle.hpp>
#include <rubato/run/digest.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// One for each dataset of a layout.
using Digests = std::vector<Digest>;

/// Writes rows into a record, and keeps digests of them.
class Recorder final : public RowSink {
public:
  using RowSink::append;

  Recorder(record::Writer writer, Digests digests) : writer_(std::move(writer)), digests_(std::move(digests)) {}

  void append(record::Column column, std::span<const double> row) override {
    if (row.size_bytes() < long_row) {
      add(column.number, row);
      return;
    }
    Checksum checksum;
    checksum.add(std::as_bytes(row));
    writer_.append(column.number, row, &checksum);
    digests_[column.number].add_row(checksum);
  }
  void append(record::Column column, std::span<const std::int64_t> row) override { add(column.number, row); }
  void append_part(record::Column column, std::span<const double> part, bool is_last) override {
    writer_.append_part(column.number, part);
    digests_[column.number].add_part(part, is_last);
  }
  InParts in_parts(std::span<const record::Column> columns) override;
  void append_checksum(record::Column column, const Checksum& row) override {
    writer_.append_written(column.number, row);
    digests_[column.number].add_row(row);
  }
  [[nodiscard]] record::Writer& writer() { return writer_; }
  [[nodiscard]] const Digests& digests() const { return digests_; }
  /// Those of the rows that are left where rows were dropped.
  void set_digests(Digests digests) { digests_ = std::move(digests); }

private:
  /// From so many bytes on a checksum costs more than putting one more checksum behind another.
  static constexpr std::size_t long_row = 8192;

  template <typename Row>
  void add(std::size_t dataset, Row row) {
    writer_.append(dataset, row);
    digests_[dataset].add_row(row);
  }

  record::Writer writer_;
  Digests digests_;
};

/// All that `resume` needs, and the digests of the rows that belong to it: "state" and Digest::array, each two
/// integers, its number of rows and its value; the last is that of "state" itself.
[[nodiscard]] record::Checkpoint make_checkpoint(const Chronicle& chronicle, const Digests& digests);

/// The same, but for those who have no room for the whole state: of a chronicle that ranks share, and that has to stay
/// as it is meanwhile. `begin` is called before they all save.
[[nodiscard]] record::CheckpointInParts make_checkpoint_in_parts(const Chronicle& chronicle, const Digests& digests,
                                                                 std::function<void()> begin);

/// Brings a chronicle to where the checkpoint was made. Nothing, and the chronicle in no state to be used, if the
/// checkpoint is not one of its problem.
[[nodiscard]] std::optional<Digests> restored(const record::Checkpoint& checkpoint, Chronicle& chronicle);
/// The same with the "state" apart from all else.
[[nodiscard]] std::optional<Digests> restored(const record::Checkpoint& others, StateReader& state,
                                              Chronicle& chronicle);

}  // namespace rubato
