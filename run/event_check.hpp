#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <rubato/problem/stored.hpp>
#include <rubato/run/events.hpp>
#include <rubato/run/shared_rows.hpp>
#include <rubato/run/state_scales.hpp>

namespace rubato {

/// What a record shows under /events, made anew from its levels, where all of them have a state and a row: the signs
/// that decide on crossings go from step to step.
class EventCheck {
public:
  /// \param components how many numbers of a state have one scale: a field's, or one
  /// \throws figures::Mismatch for a dataset that is not there, or of another size
  EventCheck(const SharedRecord& record, const StoredLevels& levels, const Problem& problem, std::size_t components,
             Disagreements& findings);

  /// In the order of the levels.
  ///@{
  void begin(std::span<const double> z);
  void check_step(std::size_t state_row, std::span<const double> before, std::span<const double> z);
  ///@}
  /// After the last one: whether the record has more crossings.
  void finish();

private:
  class Rows;
  /// `moved`: the same of displaced states.
  void compare(const Rows& sound, const std::function<const std::vector<Rows>&()>& moved, const char* reason);
  void restore(const StateWriter& signs);

  const StoredLevels& levels_;
  Disagreements& findings_;
  std::optional<std::size_t> clock_;  ///< Problem::clock()
  std::unique_ptr<EventWriter> writer_;
  record::Layout layout_;
  std::vector<EventFigures> figures_;
  std::vector<SharedRows> columns_;
  std::vector<std::size_t> next_;  ///< row of each of them
  StateScales scales_;
};

}  // namespace rubato
