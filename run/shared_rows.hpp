#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/grids/slab.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/record/reader.hpp>
#include <rubato/run/disagreements.hpp>

/// A record that the ranks of a job check together: rank 0 reads it, some planes at a time, and each rank gets its own.
/// All ranks ask the same. What goes wrong at rank 0 ends it at all: it throws there what went wrong, and
/// std::invalid_argument elsewhere.
namespace rubato {

class SharedRecord {
public:
  /// \param slab null for one process, which has all of it
  /// \param reader null at other ranks than 0
  SharedRecord(const grids::Slab* slab, const record::Reader* reader) : slab_(slab), reader_(reader) {}

  [[nodiscard]] const grids::Slab* slab() const { return slab_; }
  /// Null at other ranks than 0.
  [[nodiscard]] const record::Reader* reader() const { return reader_; }
  [[nodiscard]] bool has(const std::string& path) const;
  /// Calls `read` at rank 0; `values` are then those of all.
  void at_rank_0(const std::function<void()>& read, std::span<double> values = {}) const;

private:
  const grids::Slab* slab_;
  const record::Reader* reader_;
};

/// The levels of a record, at all ranks; `levels` is looked at by rank 0 alone.
[[nodiscard]] StoredLevels shared_levels(const SharedRecord& record, const StoredLevels* levels);

/// True if a row has a number for each node, of which every rank has some.
[[nodiscard]] bool has_nodes(const record::Dataset& dataset);

/// figures::StoredRows, of which a rank has its part: where a row has a number for each node, those of its grid. Ghosts
/// have no value.
class SharedRows {
public:
  SharedRows(const SharedRecord& record, std::string path, std::size_t row_size = 1);
  /// Those of a dataset as a layout has it.
  SharedRows(const SharedRecord& record, const record::Dataset& dataset);

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::size_t rows() const { return rows_; }
  /// Valid until the next call.
  [[nodiscard]] std::span<const double> row(std::size_t row);
  [[nodiscard]] double at(std::size_t row);
  /// As StoredRows, of one process.
  void forget_long_row() {
    if (stored_) {
      stored_->forget_long_row();
    }
  }
  /// True if a rank has a part of each row, and not all of it.
  [[nodiscard]] bool are_in_parts() const { return in_parts_; }

private:
  SharedRows(const SharedRecord& record, std::string path, std::size_t row_size, bool in_parts);

  SharedRecord record_;
  std::string path_;
  std::size_t rows_ = 0;
  bool in_parts_;
  std::optional<StoredRows> stored_;  ///< of one process; of rank 0 what is not in parts
  std::vector<double> row_;           ///< of this rank, where there are others
};

/// Compares rows of which each rank has its part; rank 0 has the findings.
class PartDisagreements {
public:
  PartDisagreements(const grids::Slab* slab, Disagreements& findings) : slab_(slab), findings_(findings) {}

  /// As Disagreements::compare(), of every number of a row: `expected(i)` by the node of the part; tolerance() is asked
  /// by all ranks.
  template <typename Expected, typename Tolerance>
  void compare(const std::string& path, std::size_t row, std::span<const double> stored, Expected&& expected,
               Tolerance&& tolerance, std::string_view reason) {
    if (slab_ == nullptr) {
      for (std::size_t i = 0; i < stored.size(); ++i) {
        findings_.compare(path, row, i, stored[i], expected(i), tolerance, reason);
      }
      return;
    }
    findings_.count(slab_->whole().size());
    if (!any([&](std::size_t i) { return Disagreements::differ(stored[i], expected(i)); })) {
      return;
    }
    const double allowed = tolerance();
    write(path, row, reason, [&](std::size_t i) -> std::optional<Numbers> {
      const double found = stored[i], right = expected(i);
      const bool finite = std::isfinite(found) && std::isfinite(right);
      return !Disagreements::differ(found, right) || (finite && std::abs(found - right) <= allowed)
                 ? std::nullopt
                 : std::optional(Numbers{found, right, finite ? allowed : 0.0});
    });
  }
  /// True if all numbers of a row are finite; those that are not are findings.
  bool finite(const std::string& path, std::size_t row, std::span<const double> stored, std::string_view reason);

private:
  /// What is stored, what is expected, within what.
  using Numbers = std::array<double, 3>;
  /// True if it is so at a node, of those of all ranks.
  [[nodiscard]] bool any(const std::function<bool(std::size_t)>& is) const;
  /// Reports to rank 0 what is found at nodes, in the order of their numbers.
  void write(const std::string& path, std::size_t row, std::string_view reason,
             const std::function<std::optional<Numbers>(std::size_t)>& find);

  const grids::Slab* slab_;
  Disagreements& findings_;
};

}  // namespace rubato
