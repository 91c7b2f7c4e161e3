#pragma once

#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/figures/stored.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>

namespace rubato {

using figures::StoredRows;

/// The numbers of `count` levels of a run that are stored: every n-th up to the last, and the last one, too, unless the
/// run still goes on. Nothing if these are not `count`.
[[nodiscard]] std::optional<std::vector<std::size_t>> every_nth(std::size_t count, std::size_t every, std::size_t last);

/// What /levels and /states say of the levels of a run, as it is stored: which of them have a row or a state, and how
/// they were chosen.
struct StoredLevels {
  std::vector<std::size_t> level;        ///< numbers of the levels that have a row, as their counts have them
  std::vector<double> reported_step;     ///< /levels/step: numbers of the steps that have a row, as stored
  std::vector<double> t;                 ///< of these levels
  std::vector<double> clock;             ///< the times of these levels that users read: with time_scale physical ones
  std::vector<double> h;                 ///< of the step to each of them but the first, the start
  std::vector<double> off_law;           ///< of these steps: 1 where E_k is not E
  std::vector<double> potential;         ///< of these steps: f'(h), a part of E_k; empty without a step potential
  std::vector<double> state_t;           ///< of the stored states
  std::vector<std::size_t> state_level;  ///< their levels, as `every` and the number of levels have them
  std::vector<double> reported_level;    ///< their levels as stored
  std::vector<double> previous_t;        ///< of the level before each of them, where that is stored
  std::size_t last = 0;                  ///< number of the last level of the run
  std::size_t every = 1;                 ///< every n-th level has a state
  std::size_t rows_every = 1;            ///< every n-th level has a row
  bool sparse = false;                   ///< not every level is stored, but the one before each that is, unless
  bool evolving_alone = false;           ///< the first and the last are, without it and of the evolving fields alone

  StoredLevels() = default;
  /// \throws record::Error if the lengths of these datasets contradict each other
  StoredLevels(const record::Reader& reader, const Problem& problem);

  [[nodiscard]] std::size_t steps() const { return last; }
  /// True if every level has a row and a state.
  [[nodiscard]] bool complete() const { return !sparse && rows_every == 1; }
  /// The row under /levels of a level, and of the step that led to a stored state; nothing where there is none.
  ///@{
  [[nodiscard]] std::optional<std::size_t> row_of(std::size_t number) const;
  [[nodiscard]] std::optional<std::size_t> step_to(std::size_t state_row) const;
  ///@}
  [[nodiscard]] double potential_of(std::size_t step_row) const {
    return potential.empty() ? 0.0 : potential[step_row];
  }
  /// Time of the level before that of a stored state, which is not the first; nothing of the evolving fields alone.
  [[nodiscard]] double t_before(std::size_t state_row) const {
    return sparse ? previous_t[state_row] : state_t[state_row - 1];
  }
  /// True if the level before that of `state_row`, which is not the first, is the one that the row before it has.
  [[nodiscard]] bool follows(std::size_t state_row) const {
    return state_level[state_row - 1] + 1 == state_level[state_row];
  }
};

/// Lets a problem have what the version that wrote its record stored: rows of all levels, no physical times, residuals
/// in every cell, all fields of the first and the last level.
void keep_to_version_of(const record::Reader& reader, Problem& problem);

/// The problem that a record says it is of. \throws record::Error if that text cannot be read
[[nodiscard]] Problem stored_problem(const record::Reader& reader);

/// The same text with settings. The state that a run began with is in its record, wherever it came from.
/// \throws ProblemError
[[nodiscard]] Problem parse_stored(const std::string& text, const std::string& file,
                                   std::span<const std::string> settings = {});

/// Calls `action`, which takes the problem in a record for what it says: where it cannot be carried out, the record is
/// wrong, and not what the user typed. \throws record::Error in place of ProblemError and std::invalid_argument
template <typename Action>
auto blame_record(const std::string& file, const Action& action) {
  try {
    return action();
  } catch (const std::invalid_argument& error) {
    throw record::Error(file, fmt::format("the problem in it cannot be carried out ({})", error.what()));
  }
}

}  // namespace rubato
