#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/events.hpp>
#include <rubato/run/level_rows.hpp>
#include <rubato/run/output.hpp>
#include <rubato/run/output_times.hpp>
#include <rubato/run/row_sink.hpp>
#include <rubato/run/simulation.hpp>
#include <rubato/run/tangent_writer.hpp>
#include <rubato/run/verdict_meter.hpp>
#include <rubato/variation/off_law_causes.hpp>

namespace rubato {

/// About how many levels a run has: as many as equal steps make. Nothing if its step is to be chosen.
[[nodiscard]] std::optional<std::size_t> expected_levels(const Problem& problem);
/// About how many rows each dataset of a layout has after a run of so many levels.
[[nodiscard]] std::vector<std::optional<std::size_t>> expected_rows(const record::Layout& layout,
                                                                    const Problem& problem, std::size_t levels);

/// A simulation and all that is reported on it, block by block: the rows of its record, and the statistics, which are
/// made of the same numbers. `run` sends the rows into the record; `check --replay` compares them with one.
class ObservedRun {
public:
  /// \throws ProblemError
  ObservedRun(const Problem& problem, bool tangents);

  [[nodiscard]] Simulation& simulation() { return *simulation_; }
  [[nodiscard]] const Simulation& simulation() const { return *simulation_; }
  [[nodiscard]] const figures::Statistics& statistics() const { return statistics_; }
  [[nodiscard]] figures::Statistics& statistics() { return statistics_; }
  /// What is reported on a run that ends here: the statistics, with the errors and the step potential of its
  /// simulation.
  [[nodiscard]] figures::Statistics final_statistics();
  /// The measures of the verdict: of the levels so far, and for saving; those of a run that ends here.
  ///@{
  [[nodiscard]] VerdictMeter& meter() { return meter_; }
  [[nodiscard]] const VerdictMeter& meter() const { return meter_; }
  /// Those up to the present level, which the record and the outcome have.
  [[nodiscard]] figures::Measures final_measures();
  ///@}
  [[nodiscard]] const OffLawCauses& causes() const { return causes_; }
  [[nodiscard]] const record::Layout& layout() const { return layout_; }
  /// Number of the last level whose state went to a sink.
  [[nodiscard]] std::size_t last_stored() const { return stored_; }

  /// The level that the simulation starts from, and its state.
  void append_start(RowSink& sink);
  /// Simulation::take(); one step where an event may end the run with it.
  const StepReport& take(std::size_t most) { return simulation_->take(may_stop_ ? 1 : most); }
  /// The steps taken and the levels they led to: rows of those that have some, and states of every n-th.
  /// \throws record::NotFinite where a record would refuse the row of a level, whether it has one or not
  void append_steps(RowSink& sink);
  /// The state of the present level.
  void append_state(RowSink& sink) { append_states(sink, statistics_.steps, 1, 1); }
  /// The row of the present level.
  void append_row(RowSink& sink) { rows_.append_to(sink, statistics_.steps == 0, 1, 1); }
  /// What is reported on the last level of a run, if it was not yet: its row, its state, and its quantities where they
  /// are reported at levels.
  void append_last(RowSink& sink);
  /// True if an event has ended the run.
  [[nodiscard]] bool stopped() const { return statistics_.stopped_by() != nullptr; }
  /// How many rows there are under /output, and in how many of them something is not defined.
  ///@{
  [[nodiscard]] std::size_t outputs() const { return outputs_; }
  [[nodiscard]] std::size_t undefined_outputs() const { return undefined_outputs_; }
  ///@}

  void save(StateWriter& state) const;
  /// How many values save() writes after those of the statistics: the first is last_stored().
  [[nodiscard]] std::size_t values_after_statistics() const;
  /// \throws std::invalid_argument if `state` is shorter than what it should restore
  void restore(StateReader& state);

private:
  void save_output(StateWriter& state) const;
  void describe(int threads);
  /// Fills in the row of the level that is looked at, and of the step to it.
  ///@{
  void take_level(std::size_t number, const figures::LevelFigures& level, double rounding);
  void take_step(const TakenStep& step);
  ///@}
  void look_at(std::size_t place) {
    simulation_->look_at(place);
    rows_.look_at(place);
  }
  /// Of the level that is looked at, of this number, and of every `stride`-th after it, `count` in all.
  void append_states(RowSink& sink, std::size_t number, std::size_t count, std::size_t stride);
  /// At the output times that the step to the level has come to, or at the level.
  void append_outputs(RowSink& sink, std::size_t number);
  void take_tangents(RowSink& sink);
  void append_output_of_level(RowSink& sink);

  const Problem& problem_;
  std::unique_ptr<Simulation> simulation_;
  std::unique_ptr<OutputMaker> output_;
  std::unique_ptr<EventWriter> events_;
  std::unique_ptr<TangentWriter> tangents_;
  OutputTimes times_;
  record::Layout layout_;
  struct Columns {
    record::Column t, gamma, node_energy;  ///< of levels
    record::Column step, h, energy, target, rounding, iterations, off_law, condition;
    std::optional<record::Column> potential = {}, laws_taken = {}, time = {};  ///< where there are such
    std::vector<record::Column> invariants = {}, totals = {};
    record::Column state_t = {}, state_level = {}, output_t = {};
  };
  Columns columns_;
  LevelRows rows_;
  figures::Statistics statistics_;
  VerdictMeter meter_;
  std::optional<std::pair<std::size_t, figures::Measures>> final_;  ///< final_measures() at the level of this number
  OffLawCauses causes_;
  bool may_stop_ = false;  ///< by an event
  std::vector<std::int64_t> numbers_of_states_;
  std::size_t stored_ = 0;
  std::size_t outputs_ = 0, undefined_outputs_ = 0;
};

}  // namespace rubato
