#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rubato/base/memory.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/run/run.hpp>

namespace rubato {

/// What a run takes, estimated from the first steps of the same problem: of a lattice with far fewer cells, scaled.
/// Absent: what such steps do not show, because they fail.
struct RunEstimate {
  std::string title, file;
  std::vector<std::pair<std::string, std::size_t>> cells;  ///< of a lattice, along each axis
  std::size_t fields = 0;                                  ///< of a lattice
  std::size_t coordinates = 0;                             ///< of an orbit
  std::optional<std::size_t> members;                      ///< of an ensemble; all but record and seconds is of one
  std::optional<double> steps;
  std::optional<double> memory;  ///< bytes of the process at the peak
  AvailableMemory available;
  std::optional<double> record;         ///< bytes when it is complete
  std::optional<double> start, a_step;  ///< seconds up to the first level, and for each step
  std::optional<double> seconds;        ///< of the whole run but for what writing takes

  [[nodiscard]] double nodes() const;
};

/// Estimates what a run of the problem takes, in a second or a few, whatever its size. Lattices are stepped on as many
/// threads as the run would have, members of an ensemble on one; ranks are assumed to share the work evenly.
/// \throws ProblemError if the problem cannot be run
[[nodiscard]] RunEstimate estimate_run(const Problem& problem, const RunOptions& options = {});

/// The estimate of a run that fits. \throws ProblemError if memory does not suffice, FileError if its disk does not:
/// with the same text as the run itself
[[nodiscard]] RunEstimate dry_run(const Problem& problem, const RunOptions& options = {});

/// \param copies runs at the same time, or the reciprocal of the ranks that share one
/// \throws ProblemError if the problem is a lattice that certainly does not fit into the memory that is available, with
/// the numbers of estimate_run()
void require_memory_for(const Problem& problem, const RunOptions& options, double copies = 1.0);

/// Compares the size of a record with the free space of the disk that `file` is on. \return a warning; empty for none
/// \throws FileError if the record certainly takes more
[[nodiscard]] std::string require_disk_for(const Problem& problem, const std::string& file,
                                           std::optional<double> bytes);

/// True if a run stores as many levels as are expected.
[[nodiscard]] bool stores_as_expected(const Problem& problem);

/// "0.2 s", "3.4 h".
[[nodiscard]] std::string duration_text(double seconds);

/// One JSON object, and the table a person reads.
///@{
[[nodiscard]] std::string to_json(const RunEstimate& estimate);
[[nodiscard]] std::string to_table(const RunEstimate& estimate);
///@}

}  // namespace rubato
