#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/study/problem.hpp>
#include <rubato/study/statistics.hpp>

namespace rubato::study {

/// The rows of one dataset of a record, read one after the other with a few megabytes in memory at a time.
class StoredRows {
public:
  /// \throws record::Error if there is no such dataset, or one of its rows has not `row_size` values
  StoredRows(const record::Reader& reader, std::string path, std::size_t row_size);

  [[nodiscard]] std::size_t rows() const { return rows_; }
  /// Valid until the next call. \throws record::Error
  [[nodiscard]] std::span<const double> row(std::size_t row);

private:
  const record::Reader& reader_;
  std::string path_;
  std::size_t row_size_, rows_, block_;
  std::size_t first_ = 0;  ///< of the rows in memory
  std::vector<double> values_;
};

/// What /levels and /states say of the steps of a run, as it is stored: which of the levels are kept, and how they were
/// chosen.
struct StoredLevels {
  std::vector<double> t;                  ///< of every level
  std::vector<double> h;                  ///< of every step
  std::vector<double> bridged, crossing;  ///< of every step: 1 on bridges, 1 on the first step of each
  std::vector<double> condition;          ///< step condition of every step
  std::vector<double> state_t;            ///< of the stored levels
  std::vector<std::size_t> state_level;   ///< their numbers
  bool sparse = false;                    ///< not every level is stored, but the one before each that is

  /// \throws record::Error if these datasets contradict each other
  explicit StoredLevels(const record::Reader& reader);

  /// How far t_{k+1} is from t_k + h_k, and the times of the stored levels from those of the same number, beyond what
  /// the rounding of times explains; 0 in a sound record.
  [[nodiscard]] double mismatch() const;
};

/// The problem that a record says it is of. \throws record::Error if that text cannot be read
[[nodiscard]] Problem stored_problem(const record::Reader& reader);

/// Takes over what only the run itself knows: steps, h, bridges, step condition, iterations.
void copy_counts(const record::Reader& reader, const StoredLevels& levels, Statistics& statistics);

}  // namespace rubato::study
