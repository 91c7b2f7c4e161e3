#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <rubato/figures/stored.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/reader.hpp>

namespace rubato {

using figures::StoredRows;

/// What /levels and /states say of the steps of a run, as it is stored: which of the levels are kept, and how they were
/// chosen.
struct StoredLevels {
  std::vector<double> t;                 ///< of every level
  std::vector<double> h;                 ///< of every step
  std::vector<double> bridged;           ///< of every step: 1 on bridges
  std::vector<double> potential;         ///< of every step: f'(h), a part of E_k; empty without a step potential
  std::vector<double> state_t;           ///< of the stored levels
  std::vector<std::size_t> state_level;  ///< their numbers, as `every` and the number of levels have them
  std::vector<double> told_level;        ///< their numbers as stored
  std::size_t every = 1;
  bool sparse = false;  ///< not every level is stored, but the one before each that is

  StoredLevels() = default;
  /// \throws record::Error if the lengths of these datasets contradict each other
  StoredLevels(const record::Reader& reader, std::size_t every);

  [[nodiscard]] std::size_t steps() const { return h.size(); }
  [[nodiscard]] double potential_of(std::size_t step) const { return potential.empty() ? 0.0 : potential[step]; }
  /// Of the step that led to a stored level.
  [[nodiscard]] std::size_t step_to(std::size_t row) const { return state_level[row] - 1; }
  /// Whether the level before that of `row`, which is not the first, is the one that the row before it has.
  [[nodiscard]] bool follows(std::size_t row) const { return state_level[row - 1] + 1 == state_level[row]; }
};

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
