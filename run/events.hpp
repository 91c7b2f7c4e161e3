#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/output.hpp>
#include <rubato/run/row_sink.hpp>
#include <rubato/variation/crossing.hpp>

namespace rubato {

using EventFigures = figures::Named<figures::EventFigures>;

/// The events of a problem, looked for in one step after the other: of an orbit, or of a lattice.
class EventFinder {
public:
  virtual ~EventFinder() = default;

  /// g of every event at the start, which is where its sign begins.
  virtual void begin(std::span<const double> z, double t, std::span<double> values) = 0;
  virtual void follow(const OutputStep& step) = 0;
  /// The same, where g and its rate at both levels are known of every event.
  virtual void follow(const OutputStep& step, std::span<const CrossingSearch::Sample> /*from*/,
                      std::span<const CrossingSearch::Sample> /*to*/) {
    follow(step);
  }
  /// Of the step followed last.
  ///@{
  [[nodiscard]] virtual const std::vector<Crossing>& crossings(std::size_t event) const = 0;
  [[nodiscard]] virtual bool undefined(std::size_t event) const = 0;
  [[nodiscard]] virtual bool left_and_returned(std::size_t event) const = 0;
  ///@}

  /// The time at a fraction of a step that users read.
  [[nodiscard]] virtual double time(const OutputStep& step, double fraction) { return step.time(fraction); }

  /// Adds the columns of a crossing's row that are of its state, in the group of the event, and appends to them.
  ///@{
  virtual void describe(std::size_t event, const std::string& group, record::Layout& layout) = 0;
  virtual void append(RowSink& sink, std::size_t event, const OutputStep& step, double fraction) = 0;
  ///@}
  /// The quantities of an event at the state that was appended last.
  [[nodiscard]] virtual std::vector<double> quantities(std::size_t event, double t) = 0;

  virtual void save(StateWriter& state) const = 0;
  virtual void restore(StateReader& state) = 0;
};

/// \throws ProblemError at the place in the problem that is wrong
///@{
[[nodiscard]] std::unique_ptr<EventFinder> make_orbit_events(const Problem& problem);
[[nodiscard]] std::unique_ptr<EventFinder> make_lattice_events(const Problem& problem);
///@}

/// What a record shows under /events, and what that adds up to: a run and the check of its record make it of the same
/// levels by the same code.
///
/// A crossing is reported with the step in which it is. A jump through zero is none, but it makes a condition true; it
/// is marked as a step in which something was missed, and so is one in which the formula is not defined.
class EventWriter {
public:
  explicit EventWriter(const Problem& problem);

  /// Adds the columns of all rows.
  void describe(record::Layout& layout);
  /// At the start: a condition that holds there ends the run, if it is one that does.
  void begin(RowSink& sink, std::span<const double> z, double t, std::span<EventFigures> figures);
  void append(RowSink& sink, const OutputStep& step, std::span<EventFigures> figures);
  void append(RowSink& sink, const OutputStep& step, std::span<const CrossingSearch::Sample> from,
              std::span<const CrossingSearch::Sample> to, std::span<EventFigures> figures);
  /// The crossings of the last step, at the same fractions of another one.
  void append_again(RowSink& sink, const OutputStep& step, std::span<EventFigures> figures);

  [[nodiscard]] std::vector<std::string> names() const;
  void save(StateWriter& state) const { finder_->save(state); }
  void restore(StateReader& state) { finder_->restore(state); }

private:
  void append_row(RowSink& sink, std::size_t event, const OutputStep& step, const Crossing& crossing,
                  EventFigures& figures);
  [[nodiscard]] std::string group(std::size_t event) const;

  const Problem& problem_;
  std::unique_ptr<EventFinder> finder_;
  struct Columns {
    record::Column missed, t, direction, stops, quantities;
  };
  std::vector<Columns> columns_;  ///< of each event
};

/// Nothing where the problem has no events.
[[nodiscard]] std::unique_ptr<EventWriter> make_events(const Problem& problem);

}  // namespace rubato
