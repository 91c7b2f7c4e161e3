#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/record/reader.hpp>

namespace rubato::figures {

/// A dataset that is not there, or not of the size, that the problem of its record asks for.
class Mismatch : public record::Error {
public:
  Mismatch(const std::filesystem::path& file, std::string dataset, const std::string& reason)
      : Error(file, reason), dataset_(std::move(dataset)), reason_(reason) {}
  [[nodiscard]] const std::string& dataset() const { return dataset_; }
  [[nodiscard]] const std::string& reason() const { return reason_; }

private:
  std::string dataset_, reason_;
};

/// The rows of one dataset of a record, read one after the other with a few megabytes in memory at a time.
class StoredRows {
public:
  /// \throws Mismatch if there is no such dataset, or one of its rows has not `row_size` values
  StoredRows(const record::Reader& reader, std::string path, std::size_t row_size = 1);

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::size_t rows() const { return rows_; }
  /// Valid until the next call. \throws record::Error
  [[nodiscard]] std::span<const double> row(std::size_t row);
  /// The number in a row of one.
  [[nodiscard]] double at(std::size_t row) { return this->row(row).front(); }
  /// Gives back the memory of a row that was used, if rows are read one by one.
  void forget_long_row() {
    if (block_ == 1) {
      values_ = std::vector<double>();
    }
  }

private:
  const record::Reader* reader_;
  std::string path_;
  std::size_t row_size_, rows_, block_;
  std::size_t first_ = 0;  ///< of the rows in memory
  std::vector<double> values_;
};

/// The names of what a record reports on per level and per step.
struct Names {
  std::vector<std::string> invariants;  ///< /laws/NAME
  std::vector<std::string> totals;      ///< /laws/totals/NAME
  std::vector<std::string> residuals;   ///< /laws/NAME_max, _rms
  std::vector<std::string> exact;       ///< /exact/NAME
  std::vector<std::string> events;      ///< /events/NAME/t
};

/// What to take in place of a stored number: by dataset, by row.
using Corrections = std::map<std::string, std::map<std::size_t, double>>;

/// The figures of a run as its record has them: the running statistics in the checkpoint, which are of all levels and
/// steps. Errors are of the last stored level. A record of an earlier version has none: there they are of its rows.
/// \throws record::Error if the record cannot be read, or the lengths of its datasets contradict each other
[[nodiscard]] Statistics stored_statistics(const record::Reader& reader, const Names& names);

/// The same from the rows under /levels, /laws and /events: the same numbers, added up in the same order by the same
/// code. Where every level has a row they are the figures of the run, bit by bit; else they are those of a part of it.
///
/// Records of earlier versions have no /levels/target: there E is the energy of the first step on the law.
/// \throws record::Error likewise
[[nodiscard]] Statistics statistics_of_rows(const record::Reader& reader, const Names& names,
                                            const Corrections& corrections = {});

/// Number of the last level of a run, which need not have a row; nothing in records of earlier versions, in which every
/// level has one. \throws record::Error if it is no number of a level
[[nodiscard]] std::optional<std::size_t> stored_last_level(const record::Reader& reader);

/// The number of cells of a record's grid; 1 without one.
[[nodiscard]] std::size_t stored_cells(const record::Reader& reader);

}  // namespace rubato::figures
