#include <rubato/run/checkpoint_check.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>

#include <fmt/format.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/record/run_shape.hpp>
#include <rubato/run/gathering_sink.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/shared_rows.hpp>

namespace rubato {

namespace {

constexpr const char* state_path = shared_state;
/// Rows of more numbers are read in parts.
constexpr std::size_t small_row = std::size_t{1} << 17;

/// Compares the rows that a simulation shows with those of a record.
class Comparison final : public RowSink {
public:
  using RowSink::append;
  using Wanted = std::function<bool(const std::string&)>;

  /// Begins with row `first(path)` of each dataset that is wanted.
  Comparison(const record::Reader& reader, const record::Layout& layout, Disagreements& findings, std::string reason,
             const Wanted& wanted, const std::function<std::size_t(const record::Dataset&)>& first)
      : reader_(reader), findings_(findings), reason_(std::move(reason)) {
    for (const record::Dataset& dataset : layout.datasets) {
      columns_.emplace_back();
      if (wanted(dataset.path) && reader.has(dataset.path)) {
        columns_.back().rows.emplace(reader, dataset.path, reader.info(dataset.path).row_size());
        columns_.back().next = first(dataset);
      }
    }
  }

  void append(record::Column column, std::span<const double> row) override { compare(columns_[column.number], row); }
  void append(record::Column column, std::span<const std::int64_t> row) override {
    compare(columns_[column.number], row);
  }
  void append_part(record::Column column, std::span<const double> part, bool is_last) override {
    Compared& compared = columns_[column.number];
    if (!compared.rows || compared.next >= compared.rows->rows()) {
      return;
    }
    const record::DatasetInfo info = reader_.info(compared.rows->path());
    const std::size_t plane = info.row_size() / info.shape.at(1);
    const std::vector<double> stored =
        reader_.read_part(info.path, compared.next, compared.taken / plane, part.size() / plane);
    for (std::size_t i = 0; i < part.size(); ++i) {
      findings_.same(info.path, compared.next, compared.taken + i, stored[i], part[i], reason_);
    }
    compared.taken = is_last ? 0 : compared.taken + part.size();
    compared.next += is_last ? 1 : 0;
  }

private:
  struct Compared {
    std::optional<StoredRows> rows;
    std::size_t next = 0;
    std::size_t taken = 0;  ///< of that row, in parts
  };

  template <typename Number>
  void compare(Compared& column, std::span<const Number> row) {
    if (!column.rows || column.next >= column.rows->rows()) {
      return;
    }
    const std::span<const double> stored = column.rows->row(column.next);
    for (std::size_t i = 0; i < std::min(row.size(), stored.size()); ++i) {
      findings_.same(column.rows->path(), column.next, row.size() == 1 ? std::nullopt : std::optional(i), stored[i],
                     static_cast<double>(row[i]), reason_);
    }
    ++column.next;
  }

  const record::Reader& reader_;
  Disagreements& findings_;
  std::string reason_;
  std::vector<Compared> columns_;
};

void compare_arrays(std::span<const double> stored, std::span<const double> expected, std::size_t offset,
                    const char* reason, Disagreements& findings) {
  for (std::size_t i = 0; i < stored.size(); ++i) {
    findings.same(state_path, offset + i, {}, stored[i], expected[i], reason);
  }
}

void check_potential(const record::Reader& reader, const StepPotential& potential, Disagreements& findings) {
  const std::string path(figures::step_potential_path);
  if (!reader.has(path)) {
    return;
  }
  const std::vector<double> stored = reader.read(path);
  const std::array<double, 3> expected = {potential.strength, potential.length, potential.exponent};
  for (std::size_t i = 0; i < std::min(stored.size(), expected.size()); ++i) {
    findings.same(path, i, {}, stored[i], expected[i], "the step potential in the state of the checkpoint");
  }
}

/// The row of the level of the checkpoint, where the record has it.
void check_last_row(const record::Reader& reader, const StoredLevels& levels, ObservedRun& observed,
                    Disagreements& findings) {
  const auto row = levels.row_of(levels.steps());
  if (!row) {
    return;
  }
  Comparison comparison(
      reader, observed.layout(), findings, "the row in the checkpoint", [](const std::string&) { return true; },
      [&](const record::Dataset& dataset) { return dataset.axis == "/levels/step" ? *row - 1 : *row; });
  observed.append_row(comparison);
}

/// The statistics that readers take, against those that `resume` takes.
void check_copy(const record::Reader& reader, const figures::Statistics& statistics, Disagreements& findings) {
  const std::string path = "/checkpoint/" + std::string(figures::statistics_name);
  if (!reader.has(path)) {
    return;  // an earlier version
  }
  const std::vector<double> stored = reader.read(path), expected = statistics.values();
  findings.count(1);
  if (stored.size() != expected.size()) {
    findings.add({.dataset = path, .reason = "it is not of the names in the problem"});
    return;
  }
  for (std::size_t i = 0; i < stored.size(); ++i) {
    findings.same(path, i, {}, stored[i], expected[i], "the statistics in " + std::string(state_path));
  }
}

/// What the rows add up to is a part of the statistics of all levels and steps: counts and extremes go no further.
void check_within(const figures::Statistics& part, const figures::Statistics& whole, Disagreements& findings) {
  constexpr const char* reason = "the rows go beyond the statistics of all levels, in the checkpoint";
  const auto parts = part.spreads(), wholes = whole.spreads();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& [path, some] = parts[i];
    const Spread& all = wholes[i].second;
    findings.count(4);
    if (some.defined > all.defined || some.undefined > all.undefined) {
      findings.add({.dataset = path, .stored = some.count(), .recomputed = all.count(), .reason = reason});
    } else if (some.any() && some.min < all.min) {
      findings.add({.dataset = path, .stored = some.min, .recomputed = all.min, .reason = reason});
    } else if (some.any() && some.max > all.max) {
      findings.add({.dataset = path, .stored = some.max, .recomputed = all.max, .reason = reason});
    }
  }
}

/// What the statistics say of the same, once or more often; and of levels and events that have all their rows.
void check_counts(const StoredLevels& levels, const figures::Statistics& part, const ObservedRun& observed,
                  Disagreements& findings) {
  const figures::Statistics& whole = observed.statistics();
  const auto same = [&](double stored, double expected, const char* reason) {
    findings.same(state_path, 0, {}, stored, expected, reason);
  };
  const auto steps = static_cast<double>(whole.steps);
  same(steps, static_cast<double>(levels.steps()), "the number of steps in the statistics of the checkpoint");
  same(whole.t, observed.simulation().t(), "the level of the checkpoint");
  same(whole.start, levels.t.front(), "the start in /levels/t");
  same(whole.node_energy.initial, part.node_energy.initial, "the start in /levels/node_energy");
  for (const Spread* per_level : {&whole.node_energy.values, &whole.gamma}) {
    same(per_level->count(), steps + 1.0, "there is one for each level");
  }
  for (const Spread* per_step : {&whole.h, &whole.energies(), &whole.rounding, &whole.potential, &whole.iterations}) {
    same(per_step->count(), steps, "there is one for each step");
  }
  if (part.has_law() && part.autonomous() && whole.autonomous()) {
    same(whole.energy(), part.energy(), "E in /levels/target");
  }
  for (std::size_t i = 0; i < whole.events.size(); ++i) {
    const figures::EventFigures &event = whole.events[i].value, &rows = part.events[i].value;
    same(static_cast<double>(event.count), static_cast<double>(rows.count), "the crossings of the event");
    same(event.first, rows.first, "the first crossing of the event");
    same(event.last, rows.last, "the last crossing of the event");
    same(event.stopped, rows.stopped, "the crossing that ended the run");
  }
}

/// What the checkpoint says of the level it is at, against what the record says of it.
void check_state(const record::Reader& reader, const StoredLevels& levels, const figures::Names& names,
                 ObservedRun& observed, const LatticeLeader* leader, Disagreements& findings) {
  const std::size_t last = levels.steps();
  const bool stores_state = levels.state_level.back() == last;
  if (leader != nullptr) {
    leader->order_state(stores_state);
  }
  Simulation& simulation = observed.simulation();
  const NodeEnergy node = simulation.node();
  if (const auto row = levels.row_of(last)) {
    findings.same("/levels/t", *row, {}, levels.t[*row], simulation.t(), "the level of the checkpoint");
    // Bits may differ between machines whose elementary functions round differently.
    findings.compare(
        "/levels/node_energy", *row, {}, reader.read("/levels/node_energy", *row, 1).front(), node.energy,
        [&] {
          return Rounding::unit *
                 std::max({std::abs(node.energy), observed.statistics().energy_scale(), simulation.energy_terms()});
        },
        "the level of the checkpoint");
  }

  const figures::Statistics made = figures::statistics_of_rows(reader, names);
  StateWriter stored;
  observed.statistics().save(stored);
  const std::size_t offset = reader.rows(state_path) - observed.values_after_statistics() - stored.values().size();
  if (levels.rows_every == 1) {
    StateWriter expected;
    made.save(expected);
    compare_arrays(stored.values(), expected.values(), offset, "the statistics of /levels and /laws", findings);
  } else {
    check_within(made, observed.statistics(), findings);
    check_counts(levels, made, observed, findings);
    check_last_row(reader, levels, observed, findings);
  }
  check_copy(reader, observed.statistics(), findings);

  findings.same(state_path, offset + stored.values().size(), {}, static_cast<double>(observed.last_stored()),
                static_cast<double>(last / levels.every * levels.every), "the last of every n-th level");
  if (stores_state) {
    const auto of_states = [](const std::string& path) {
      return path.starts_with("/states/") && !path.starts_with("/states/previous/");
    };
    Comparison comparison(reader, observed.layout(), findings, "the state in the checkpoint", of_states,
                          [&](const record::Dataset&) { return levels.state_level.size() - 1; });
    if (leader == nullptr) {
      observed.append_state(comparison);
    } else {
      GatheringSink gathering(leader->slab(), observed.layout(), &comparison);
      observed.append_state(gathering);
      gathering.finish();
      gathering.rethrow();
    }
  }
}

/// Brings a observed to the checkpoint, with other ranks where there are some. False if it is not one of the problem.
bool restored(const record::Reader& reader, const record::Checkpoint& others, ObservedRun& observed,
              const LatticeLeader* leader) {
  if (leader == nullptr) {
    return restore(others, observed);
  }
  if (!reader.has(state_path)) {
    return false;
  }
  const std::size_t size = reader.rows(state_path);
  leader->order_restore(size);
  SharedState source(leader->slab(), &reader);
  StateReader state(source, size);
  const bool done = restore(others, state, observed);
  source.rethrow();
  return done;
}

}  // namespace

CheckpointDisagreements check_checkpoint(const record::Reader& reader, const StoredLevels& levels,
                                         const figures::Names& names, ObservedRun& observed,
                                         const LatticeLeader* leader, Disagreements& findings) {
  if (record::is_of_earlier_version(reader)) {
    return {};
  }
  const record::Checkpoint checkpoint = reader.checkpoint(leader == nullptr ? "" : "state");
  if (!restored(reader, checkpoint, observed, leader)) {
    findings.add({.dataset = state_path, .reason = "it is not the checkpoint of the problem in the record"});
    return {.is_checked = true};
  }
  check_potential(reader, observed.simulation().step_potential(), findings);
  CheckpointDisagreements result{.is_checked = true,
                                 .energy_terms = observed.simulation().energy_terms(),
                                 .potential = observed.simulation().step_potential()};
  check_state(reader, levels, names, observed, leader, findings);
  return result;
}

namespace {

/// ObservedRun::take(). \throws Interrupted where this thread's Interruptible asks for it
void take(ObservedRun& observed, std::size_t most) {
  Interruptible::end_if_asked();
  observed.take(most);
  if (observed.simulation().interrupted()) {
    throw Interrupted();
  }
}

/// The problem with which the run began: if its step potential is not the one that is chosen for a run to `until`, that
/// is the one of a run that was continued.
Problem as_begun(const record::Reader& reader, const Problem& problem) {
  const std::string path(figures::step_potential_path);
  if (!reader.has(path)) {
    return problem;
  }
  const std::vector<double> stored = reader.read(path);
  ObservedRun observed(problem, false);
  take(observed, 1);  // the first chooses
  const StepPotential& chosen = observed.simulation().step_potential();
  Problem begun = problem;
  if (stored.size() == 3 && stored != std::vector{chosen.strength, chosen.length, chosen.exponent}) {
    begun.scheme.potential = {.kind = StepPotentialChoice::Kind::stated,
                              .potential = {.strength = stored[0], .length = stored[1], .exponent = stored[2]}};
  }
  return begun;
}

}  // namespace

std::size_t reproduced_states(const record::Reader& reader, const StoredLevels& levels, const Problem& problem,
                              std::size_t last) {
  const Problem begun = as_begun(reader, problem);
  ObservedRun observed(begun, reader.has("/laws/multisymplectic_max"));
  Disagreements findings;
  Comparison comparison(
      reader, observed.layout(), findings, "the step taken again",
      [](const std::string& path) { return path.starts_with("/states/") || path == "/levels/energy"; },
      [](const record::Dataset&) { return std::size_t{0}; });
  observed.append_start(comparison);
  std::size_t row = findings.disagreements() == 0 ? 1 : 0;
  for (std::size_t k = 0; k < levels.state_level[last] && findings.disagreements() == 0; ++k) {
    take(observed, 1);
    if (observed.simulation().taken().empty()) {
      break;
    }
    observed.append_steps(comparison);
    row += findings.disagreements() == 0 && observed.last_stored() == k + 1 ? 1 : 0;
  }
  if (row == last) {  // the last level, which is stored in addition to every n-th
    observed.append_last(comparison);
    row += findings.disagreements() == 0 ? 1 : 0;
  }
  return row;
}

void replay(const record::Reader& reader, const StoredLevels& levels, const Problem& problem, Disagreements& findings) {
  const Problem begun = as_begun(reader, problem);
  ObservedRun observed(begun, reader.has("/laws/multisymplectic_max"));
  Comparison comparison(
      reader, observed.layout(), findings, "the step taken again", [](const std::string&) { return true; },
      [](const record::Dataset&) { return std::size_t{0}; });
  observed.append_start(comparison);
  const Simulation& simulation = observed.simulation();
  while (observed.statistics().steps < levels.steps()) {
    const std::size_t steps = observed.statistics().steps;
    take(observed, levels.steps() - steps);
    if (simulation.taken().empty()) {
      findings.add({.dataset = "/levels/h",
                    .row = steps,
                    .reason = fmt::format("the step taken again ended: {}", to_string(simulation.report().status))});
      return;
    }
    observed.append_steps(comparison);
  }
  const record::Checkpoint checkpoint = reader.checkpoint();
  const auto found = checkpoint.find("state");
  const auto* stored = found == checkpoint.end() ? nullptr : std::get_if<std::vector<double>>(&found->second);
  StateWriter state;
  observed.save(state);
  if (stored != nullptr && stored->size() == state.values().size()) {
    compare_arrays(*stored, state.values(), 0, "the run taken again", findings);
  }
  observed.append_last(comparison);
}

}  // namespace rubato
