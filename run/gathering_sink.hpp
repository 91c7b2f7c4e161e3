#pragma once

#include <cstddef>
#include <exception>
#include <span>
#include <vector>

#include <rubato/grids/slab.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/row_sink.hpp>

namespace rubato {

/// Rows on their way to a sink at rank 0, to nowhere at others, of a lattice that ranks share: of a dataset over nodes
/// this rank's part becomes a row of the whole lattice. Every rank has to append the same columns, and to call finish()
/// then.
///
/// Short rows go to rank 0, some planes at a time. Long ones (record::is_long) wait for finish(): ranks write them
/// together where the sink is a record and all of them can, and they go to rank 0 else. What the sink throws waits
/// until rethrow().
class GatheringSink final : public RowSink {
public:
  /// \param layout of the columns
  /// \param sink null at other ranks than 0
  GatheringSink(const grids::Slab& slab, const record::Layout& layout, RowSink* sink)
      : slab_(slab), layout_(layout), sink_(sink) {}
  using RowSink::append;
  void append(record::Column column, std::span<const double> row) override;
  void append(record::Column column, std::span<const std::int64_t> row) override;
  void finish();
  /// Throws what the sink has thrown first since the last call; it was given nothing after that.
  void rethrow();

private:
  /// A row of which this rank has a part.
  struct Row {
    record::Column column;
    std::vector<double> part;
  };

  template <typename Append>
  void to_sink(const Append& append);
  void gather(record::Column column, std::span<const double> part);
  /// What rank 0's sink wants, with a file that all ranks can write together; reported to all ranks.
  [[nodiscard]] InParts wish();
  /// The checksums of all rows that wait, at rank 0; nothing at others. Rank 0 looks for numbers that are not finite.
  [[nodiscard]] std::vector<Checksum> judged(const InParts& wish);
  void write(const InParts& wish) const;
  [[nodiscard]] std::span<const double> owned(const Row& row) const {
    return std::span(row.part).subspan(slab_.first_node(), slab_.owned());
  }

  const grids::Slab& slab_;
  const record::Layout& layout_;
  RowSink* sink_;
  std::vector<Row> waiting_;
  std::exception_ptr thrown_;
};

}  // namespace rubato
