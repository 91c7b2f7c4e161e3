#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include <rubato/figures/statistics.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/run/events.hpp>
#include <rubato/run/output.hpp>
#include <rubato/run/output_times.hpp>
#include <rubato/run/row_sink.hpp>
#include <rubato/run/simulation.hpp>
#include <rubato/variation/bridge_causes.hpp>

namespace rubato {

/// A simulation and all that is told of it, level by level: the rows of its record, and the statistics, which are made
/// of the same numbers. `run` sends the rows into the record; `check --replay` compares them with one.
class Chronicle {
public:
  /// \throws ProblemError
  Chronicle(const Problem& problem, bool tangents);

  [[nodiscard]] Simulation& simulation() { return *simulation_; }
  [[nodiscard]] const Simulation& simulation() const { return *simulation_; }
  [[nodiscard]] const figures::Statistics& statistics() const { return statistics_; }
  [[nodiscard]] figures::Statistics& statistics() { return statistics_; }
  /// What is told of a run that ends here: the statistics, with the errors and the step potential of its simulation.
  [[nodiscard]] figures::Statistics final_statistics();
  [[nodiscard]] const BridgeCauses& causes() const { return causes_; }
  [[nodiscard]] const record::Layout& layout() const { return layout_; }
  /// Number of the last level whose state went to a sink.
  [[nodiscard]] std::size_t last_stored() const { return stored_; }

  /// The level that the simulation starts from, and its state.
  void tell_start(RowSink& sink);
  /// The step just taken, the level it led to, and its state if it is one of every n-th.
  void tell_step(const StepReport& report, RowSink& sink);
  /// The state of the present level.
  void tell_state(RowSink& sink);
  /// What is told of the last level of a run, if it was not yet: its state, and its quantities where they are told at
  /// levels.
  void tell_last(RowSink& sink);
  [[nodiscard]] bool told_last() const { return stored_ == statistics_.steps; }
  /// Whether an event has ended the run.
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
  void describe(int threads);
  void tell_level(std::size_t number, RowSink& sink);
  /// At the output times that the last step has come to, or at its level.
  void tell_outputs(RowSink& sink);
  void tell_output_of_level(RowSink& sink);

  const Problem& problem_;
  std::unique_ptr<Simulation> simulation_;
  std::unique_ptr<OutputMaker> output_;
  std::unique_ptr<EventTeller> events_;
  OutputTimes times_;
  record::Layout layout_;
  struct Columns {
    record::Column t, gamma, node_energy;  ///< of levels
    record::Column step, h, energy, target, rounding, iterations, bridged, crossing, condition;
    std::optional<record::Column> potential = {}, laws_taken = {};  ///< where there are such
    std::vector<record::Column> invariants = {}, totals = {};
    record::Column state_t = {}, state_level = {}, output_t = {};
  };
  Columns columns_;
  figures::Statistics statistics_;
  BridgeCauses causes_;
  std::size_t stored_ = 0;
  std::size_t outputs_ = 0, undefined_outputs_ = 0;
};

}  // namespace rubato
