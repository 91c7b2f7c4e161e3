#include <rubato/run/checkpoint_check.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>

#include <fmt/format.h>

#include <rubato/run/gathering_sink.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/shared_rows.hpp>

namespace rubato {

namespace {

constexpr const char* state_path = shared_state;
/// Rows of more numbers are read in parts.
constexpr std::size_t small_row = std::size_t{1} << 17;

/// Compares the rows that a simulation tells with those of a record.
class Comparison final : public RowSink {
public:
  using RowSink::append;
  using Wanted = std::function<bool(const std::string&)>;

  /// Begins with row `first(path)` of each dataset that is wanted.
  Comparison(const record::Reader& reader, const record::Layout& layout, Findings& findings, std::string reason,
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
  Findings& findings_;
  std::string reason_;
  std::vector<Compared> columns_;
};

Digest digest_of(const record::Reader& reader, const std::string& path, std::size_t rows) {
  const record::DatasetInfo info = reader.info(path);
  Digest digest;
  if (info.row_size() <= small_row) {
    StoredRows stored(reader, path, info.row_size());
    for (std::size_t row = 0; row < std::min(rows, stored.rows()); ++row) {
      digest.add_row(stored.row(row));
    }
    return digest;
  }
  for (std::size_t row = 0; row < std::min(rows, reader.rows(path)); ++row) {
    read_in_parts(reader, info, row, [&](std::span<const double> part) { digest.add_part(part, false); });
    digest.add_part(std::span<const double>(), true);
  }
  return digest;
}

/// Of the state in the checkpoint, some of it at a time.
Digest digest_of_state(const record::Reader& reader) {
  const std::size_t size = reader.rows(state_path);
  Digest digest;
  for (std::size_t first = 0; first < size; first += small_row) {
    const std::vector<double> some = reader.read(state_path, first, std::min(small_row, size - first));
    digest.add_part(std::span<const double>(some), false);
  }
  digest.add_part(std::span<const double>(), true);
  return digest;
}

void check_digests(const record::Reader& reader, const Chronicle& chronicle, const Digests& digests,
                   Findings& findings) {
  for (std::size_t i = 0; i < digests.size(); ++i) {
    const std::string& path = chronicle.layout().datasets[i].path;
    if (!reader.has(path)) {
      findings.add({.dataset = path, .reason = "it is missing"});
      continue;
    }
    findings.count(1);
    if (digest_of(reader, path, static_cast<std::size_t>(std::max<std::int64_t>(0, digests[i].rows()))) != digests[i]) {
      findings.add(
          {.dataset = path, .reason = "it is not what the run wrote, by the digest in /checkpoint/row_digests"});
    }
  }
}

void compare_arrays(std::span<const double> stored, std::span<const double> expected, std::size_t offset,
                    const char* reason, Findings& findings) {
  for (std::size_t i = 0; i < stored.size(); ++i) {
    findings.same(state_path, offset + i, {}, stored[i], expected[i], reason);
  }
}

void check_potential(const record::Reader& reader, const StepPotential& potential, Findings& findings) {
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

/// What the checkpoint says of the level it is at, against what the record says of it.
void check_state(const record::Reader& reader, const StoredLevels& levels, const figures::Names& names,
                 Chronicle& chronicle, const LatticeLeader* leader, Findings& findings) {
  const std::size_t last = levels.steps();
  const bool tells_state = levels.state_level.back() == last;
  if (leader != nullptr) {
    leader->order_state(tells_state);
  }
  Simulation& simulation = chronicle.simulation();
  const NodeEnergy node = simulation.node();
  const auto at_last = [&](const char* path, double expected) {
    const double stored = reader.read(path, last, 1).front();
    // Bits may differ between machines whose elementary functions round differently.
    findings.compare(
        path, last, {}, stored, expected,
        [&] {
          return Rounding::unit *
                 std::max({std::abs(expected), chronicle.statistics().energy_scale(), simulation.energy_terms()});
        },
        "the level of the checkpoint");
  };
  findings.same("/levels/t", last, {}, levels.t.back(), simulation.t(), "the level of the checkpoint");
  at_last("/levels/node_energy", node.energy);

  const figures::Statistics made = figures::stored_statistics(reader, names);
  StateWriter stored, expected;
  chronicle.statistics().save(stored);
  made.save(expected);
  const std::size_t offset = reader.rows(state_path) - chronicle.values_after_statistics() - stored.values().size();
  compare_arrays(stored.values(), expected.values(), offset, "the statistics of /levels and /laws", findings);

  findings.same(state_path, offset + stored.values().size(), {}, static_cast<double>(chronicle.last_stored()),
                static_cast<double>(last / levels.every * levels.every), "the last of every n-th level");
  if (tells_state) {
    const auto of_states = [](const std::string& path) {
      return path.starts_with("/states/") && !path.starts_with("/states/previous/");
    };
    Comparison comparison(reader, chronicle.layout(), findings, "the state in the checkpoint", of_states,
                          [&](const record::Dataset&) { return levels.state_level.size() - 1; });
    if (leader == nullptr) {
      chronicle.tell_state(comparison);
    } else {
      GatheringSink gathering(leader->slab(), chronicle.layout(), &comparison);
      chronicle.tell_state(gathering);
      gathering.finish();
      gathering.rethrow();
    }
  }
}

/// Brings a chronicle to the checkpoint, with other ranks where there are some. Nothing if it is not one of the
/// problem.
std::optional<Digests> restore(const record::Reader& reader, const record::Checkpoint& others, Chronicle& chronicle,
                               const LatticeLeader* leader) {
  if (leader == nullptr) {
    return restored(others, chronicle);
  }
  if (!reader.has(state_path)) {
    return std::nullopt;
  }
  const std::size_t size = reader.rows(state_path);
  leader->order_restore(size);
  SharedState source(leader->slab(), &reader);
  StateReader state(source, size);
  auto digests = restored(others, state, chronicle);
  source.rethrow();
  return digests;
}

}  // namespace

CheckpointFindings check_checkpoint(const record::Reader& reader, const StoredLevels& levels,
                                    const figures::Names& names, Chronicle& chronicle, const LatticeLeader* leader,
                                    Findings& findings) {
  const record::Checkpoint checkpoint = reader.checkpoint(leader == nullptr ? "" : "state");
  if (!checkpoint.contains(Digest::array)) {
    return {};  // a record of an earlier version
  }
  const std::optional<Digests> digests = restore(reader, checkpoint, chronicle, leader);
  if (!digests) {
    findings.add({.dataset = state_path, .reason = "it is not the checkpoint of the problem in the record"});
    return {.has_digests = true};
  }
  const auto& numbers = std::get<std::vector<std::int64_t>>(checkpoint.at(Digest::array));
  findings.count(1);
  if (digest_of_state(reader) != Digest(numbers[numbers.size() - 2], numbers.back())) {
    findings.add(
        {.dataset = state_path, .reason = "it is not what the run wrote, by the digest in /checkpoint/row_digests"});
  }
  check_digests(reader, chronicle, *digests, findings);
  check_potential(reader, chronicle.simulation().step_potential(), findings);
  CheckpointFindings result{.has_digests = true,
                            .energy_terms = chronicle.simulation().energy_terms(),
                            .potential = chronicle.simulation().step_potential()};
  check_state(reader, levels, names, chronicle, leader, findings);
  return result;
}

namespace {

/// The problem with which the run began: if its step potential is not the one that is chosen for a run to `until`, but
/// that of one that is too short for a scout, it was continued (is_short_run).
Problem as_begun(const record::Reader& reader, const Problem& problem) {
  const std::string path(figures::step_potential_path);
  if (problem.multisymplectic() == nullptr || !reader.has(path)) {
    return problem;
  }
  const std::vector<double> stored = reader.read(path);
  const auto is_chosen = [&](const Problem& tried) {
    Chronicle chronicle(tried, false);
    (void)chronicle.simulation().step();  // the first chooses
    const StepPotential& potential = chronicle.simulation().step_potential();
    return stored == std::vector{potential.strength, potential.length, potential.exponent};
  };
  if (!is_chosen(problem)) {
    Problem begun = problem;
    begun.scheme.begun_until = problem.start();
    if (is_chosen(begun)) {
      return begun;
    }
  }
  return problem;
}

}  // namespace

void replay(const record::Reader& reader, const StoredLevels& levels, const Problem& problem, Findings& findings) {
  const Problem begun = as_begun(reader, problem);
  Chronicle chronicle(begun, reader.has("/laws/multisymplectic_max"));
  Comparison comparison(
      reader, chronicle.layout(), findings, "the step taken again", [](const std::string&) { return true; },
      [](const record::Dataset&) { return std::size_t{0}; });
  chronicle.tell_start(comparison);
  for (std::size_t k = 0; k < levels.steps(); ++k) {
    const StepReport report = chronicle.simulation().step();
    if (report.status != Status::success) {
      findings.add({.dataset = "/levels/h",
                    .row = k,
                    .stored = levels.h[k],
                    .reason = fmt::format("the step taken again ended: {}", to_string(report.status))});
      return;
    }
    chronicle.tell_step(report, comparison);
  }
  const record::Checkpoint checkpoint = reader.checkpoint();
  const auto found = checkpoint.find("state");
  const auto* stored = found == checkpoint.end() ? nullptr : std::get_if<std::vector<double>>(&found->second);
  StateWriter state;
  chronicle.save(state);
  if (stored != nullptr && stored->size() == state.values().size()) {
    compare_arrays(*stored, state.values(), 0, "the run taken again", findings);
  }
  chronicle.tell_last(comparison);
}

}  // namespace rubato
