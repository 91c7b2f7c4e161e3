#include <rubato/run/run_estimate.hpp>

#include <malloc.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <omp.h>

#include <rubato/figures/text.hpp>
#include <rubato/ranks/communicator.hpp>
#include <rubato/record/error.hpp>
#include <rubato/record/writer.hpp>
#include <rubato/run/ensemble_member.hpp>
#include <rubato/run/no_sink.hpp>
#include <rubato/run/observed_run.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/shared_rows.hpp>
#include <rubato/run/threads.hpp>

namespace rubato {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

double nodes_of(const Problem& problem) {
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  return pde == nullptr ? 1.0 : pde->nodes();
}

/// The problem on a lattice of about so many nodes; numbers of cells stay odd or even, which some schemes need.
Problem on_nodes(Problem problem, double nodes) {
  if (nodes >= nodes_of(problem)) {
    return problem;
  }
  auto& pde = std::get<MultisymplecticProblem>(problem.system);
  const double factor = std::pow(nodes / nodes_of(problem), 1.0 / static_cast<double>(pde.axes.size()));
  for (GridAxis& axis : pde.axes) {
    const auto cells = std::max<std::int64_t>(std::llround(static_cast<double>(axis.cells) * factor), 5);
    axis.cells = cells + (axis.cells - cells) % 2;
  }
  return problem;
}

/// The first steps of a problem, without a record.
class FirstSteps {
public:
  FirstSteps(const Problem& problem, bool tangents) : observed_(problem, tangents) { observed_.append_start(rows_); }

  /// False where a coarse lattice needs shorter steps, or the run is over.
  bool take(std::size_t most) {
    if (ended()) {
      return false;
    }
    observed_.take(most);
    if (observed_.simulation().taken().empty()) {
      return false;
    }
    observed_.append_steps(rows_);
    return true;
  }
  [[nodiscard]] bool ended() const { return observed_.simulation().finished() || observed_.stopped(); }
  [[nodiscard]] const ObservedRun& observed() const { return observed_; }
  [[nodiscard]] std::size_t steps() const { return observed_.statistics().steps; }

private:
  ObservedRun observed_;
  NoSink rows_;
};

/// What a child process shows that takes two steps: how much it grows at its peak, and how long it takes.
struct Growth {
  double bytes = 0.0, seconds = 0.0, state = 0.0;
};

std::optional<Growth> growth(const Problem& problem, bool tangents) {
  ::malloc_trim(0);  // what this process has freed would hide what the child takes
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0) {
    return std::nullopt;
  }
  const pid_t child = ::fork();
  if (child == 0) {
    constexpr rlimit limit{60, 60};
    static_cast<void>(::setrlimit(RLIMIT_CPU, &limit));
    Growth grown;
    try {
      const auto begin = Clock::now();
      const double before = peak_memory();
      const ThreadCount one(1);
      FirstSteps steps(problem, tangents);
      for (int step = 0; step < 2 && steps.take(1); ++step) {
      }
      grown.state = static_cast<double>(size_of_state(steps.observed()));
      grown.bytes = peak_memory() - before;
      grown.seconds = seconds_since(begin);
    } catch (...) {
      ::_exit(1);
    }
    ::_exit(::write(ends[1], &grown, sizeof grown) == sizeof grown ? 0 : 1);
  }
  ::close(ends[1]);
  Growth grown;
  const bool is_read = child > 0 && ::read(ends[0], &grown, sizeof grown) == sizeof grown;
  ::close(ends[0]);
  int status = 0;
  if (child > 0) {
    ::waitpid(child, &status, 0);
  }
  return is_read && status == 0 ? std::optional(grown) : std::nullopt;
}

/// Bytes of a record with so many rows, whose lattice has `scale` times as many nodes as that of the layout.
std::optional<double> scaled_bytes(const record::Layout& layout, const std::vector<std::optional<std::size_t>>& rows,
                                   double scale) {
  std::array<record::Layout, 2> parts;  // of numbers, and of nodes
  std::array<std::vector<std::optional<std::size_t>>, 2> rows_of;
  for (std::size_t i = 0; i < layout.datasets.size(); ++i) {
    const std::size_t part = has_nodes(layout.datasets[i]) ? 1 : 0;
    parts[part].datasets.push_back(layout.datasets[i]);
    rows_of[part].push_back(rows[i]);
  }
  double bytes = 0.0;
  for (const std::size_t part : {0U, 1U}) {
    if (parts[part].datasets.empty()) {
      continue;
    }
    parts[part].scales = layout.scales;
    parts[part].compression = layout.compression;
    const auto of_part = record::expected_bytes(parts[part], rows_of[part]);
    if (!of_part) {
      return std::nullopt;
    }
    bytes += *of_part * (part == 1 ? scale : 1.0);
  }
  return bytes;
}

/// What one run takes.
struct Cost {
  std::optional<double> memory, record, steps, start, a_step;

  [[nodiscard]] std::optional<double> seconds() const {
    return steps && start && a_step ? std::optional(*start + *steps * *a_step) : std::nullopt;
  }
};

class Estimator {
public:
  /// \param seconds that may go into timed steps
  Estimator(const Problem& problem, bool tangents, double seconds)
      : problem_(problem), tangents_(tangents), seconds_(seconds), nodes_(nodes_of(problem)) {}

  Cost take() {
    grow();
    time_steps();
    return cost_;
  }
  /// Of the record of the timed steps, if these could be taken; how many rows the datasets of the run have, and how
  /// many times as many nodes.
  ///@{
  [[nodiscard]] const std::optional<record::Layout>& layout() const { return layout_; }
  [[nodiscard]] const std::vector<std::optional<std::size_t>>& rows() const { return rows_; }
  [[nodiscard]] double scale() const { return scale_; }
  ///@}

private:
  static constexpr double few = 3000, many = 12'000;

  /// Memory, and what the checkpoint has: of a large lattice by lines through two small ones.
  void grow() {
    const Problem large = on_nodes(problem_, many);
    const auto b = growth(large, tangents_);
    if (!b) {
      return;
    }
    grown_ = *b;
    if (const double of_large = nodes_of(large); of_large < nodes_) {
      const Problem small = on_nodes(problem_, few);
      const double of_small = nodes_of(small);
      const auto a = growth(small, tangents_);
      if (!a) {
        grown_.reset();
        return;
      }
      const double more = (nodes_ - of_large) / (of_large - of_small);
      grown_->bytes += (b->bytes - a->bytes) * more;
      grown_->state += (b->state - a->state) * more;
      grown_->seconds /= of_large;  // of a node
    } else {
      grown_->seconds /= nodes_;
    }
    // Of the program itself, and of what HDF5 and rows on their way to the file take at most.
    constexpr double program = 16e6;
    cost_.memory = program + static_cast<double>(record::CommitPolicy().buffer_bytes) + grown_->bytes;
  }

  /// Seconds, and the size of the record.
  void time_steps() {
    if (!grown_) {
      return;
    }
    const bool is_lattice = problem_.multisymplectic() != nullptr;
    const double affordable = is_lattice ? std::max(few, seconds_ / grown_->seconds) : nodes_;
    const Problem sample = on_nodes(problem_, affordable);
    try {
      take_sample(sample);
    } catch (const record::NotFinite&) {
      // What steps take is then unknown.
    } catch (const ProblemError&) {
      if (nodes_of(sample) == nodes_) {
        throw;
      }
    }
  }

  void take_sample(const Problem& sample) {
    scale_ = nodes_ / nodes_of(sample);
    const auto begin = Clock::now();
    FirstSteps steps(sample, tangents_);
    if (!steps.take(1)) {
      return;
    }
    cost_.start = seconds_since(begin) * scale_;
    const auto first = Clock::now();
    constexpr std::size_t at_once = 256;
    while (steps.take(at_once) && seconds_since(first) < seconds_) {
    }
    cost_.steps = expected_steps(steps);
    if (steps.steps() > 1) {
      cost_.a_step = seconds_since(first) / static_cast<double>(steps.steps() - 1) * scale_;
    } else if (*cost_.steps <= 1.0) {
      cost_.a_step = 0.0;
    }
    layout_ = steps.observed().layout();
    measure_record();
  }

  /// As many as these if they are all, or of equal length; else in proportion to the time that they have come.
  [[nodiscard]] double expected_steps(const FirstSteps& first) const {
    const auto taken = static_cast<double>(first.steps());
    if (first.ended()) {
      return taken;
    }
    if (const auto levels = expected_levels(problem_); levels && problem_.scheme.levels == Levels::fixed) {
      return static_cast<double>(*levels - 1);
    }
    const double start = problem_.start();
    const double steps = taken * (problem_.scheme.until - start) / (first.observed().simulation().t() - start);
    return std::min(std::ceil(steps), static_cast<double>(problem_.scheme.max_steps));
  }

  void measure_record() {
    rows_ = expected_rows(*layout_, problem_, static_cast<std::size_t>(*cost_.steps) + 1);
    if (const auto bytes = scaled_bytes(*layout_, rows_, scale_)) {
      cost_.record = *bytes + sizeof(double) * grown_->state;
      // No more rows wait than there are.
      const auto buffer = static_cast<double>(record::CommitPolicy().buffer_bytes);
      *cost_.memory -= std::max(0.0, buffer - *bytes);
    }
  }

  const Problem& problem_;
  bool tangents_;
  double seconds_, nodes_;
  double scale_ = 1.0;
  std::optional<Growth> grown_;  ///< of the run; seconds of a node
  std::optional<record::Layout> layout_;
  std::vector<std::optional<std::size_t>> rows_;
  Cost cost_;
};

constexpr double timed_seconds = 0.25;

/// Bytes of the record of an ensemble whose members are like this one.
std::optional<double> bytes_of_members(const Problem& member, const Ensemble& ensemble, const Estimator& estimator) {
  if (!estimator.layout()) {
    return std::nullopt;
  }
  constexpr std::size_t of_every_member = 3;  // number, status and verdict
  const record::Layout& one = *estimator.layout();
  record::Layout all;
  all.compression = one.compression;
  all.scales = one.scales;
  std::vector<std::optional<std::size_t>> rows;
  const auto add = [&](record::Dataset dataset, std::optional<std::size_t> expected, std::size_t count) {
    dataset.expected_rows = expected;
    static_cast<void>(all.add(std::move(dataset)));
    rows.emplace_back(count);
  };
  const std::size_t members = ensemble.members();
  const std::size_t numbers = of_every_member + ensemble.paths.size() + figure_names(on_nodes(member, 1.0)).size();
  for (std::size_t i = 0; i < numbers; ++i) {
    add({.path = {}, .axis = {}}, members, members);
  }
  for (std::size_t i = 0; i < one.datasets.size(); ++i) {
    const record::Dataset& dataset = one.datasets[i];
    if (is_last_state(dataset)) {
      add(dataset, members, members);
    } else if (is_kept_whole(dataset)) {
      const std::size_t count = estimator.rows()[i].value_or(0) * members;
      add(dataset, std::nullopt, count);
      if (dataset.path == dataset.axis) {  // with the numbers of the members
        add({.path = {}, .axis = dataset.axis}, std::nullopt, count);
      }
    }
  }
  return scaled_bytes(all, rows, estimator.scale());
}

/// From some members, evenly spread.
void estimate_members(const Problem& problem, const RunOptions& options, RunEstimate& estimate) {
  constexpr std::size_t most = 8;
  const std::size_t members = problem.ensemble->members(), sampled = std::min(members, most);
  const ThreadCount threads(options.threads);
  const auto at_once =
      static_cast<double>(std::min<std::size_t>(static_cast<std::size_t>(omp_get_max_threads()), members));
  const auto add = [](std::optional<double>& sum, std::optional<double> value) {
    sum = sum && value ? std::optional(*sum + *value) : std::nullopt;
  };
  std::optional<double> steps = 0.0, start = 0.0, a_step = 0.0, seconds = 0.0, bytes = 0.0, memory = 0.0;
  for (std::size_t i = 0; i < sampled; ++i) {
    const Problem member = member_problem(problem, i * members / sampled);
    const ThreadCount one(1);
    Estimator estimator(member, false, timed_seconds / static_cast<double>(sampled));
    const Cost cost = estimator.take();
    add(steps, cost.steps);
    add(start, cost.start);
    add(a_step, cost.a_step);
    add(seconds, cost.seconds());
    add(bytes, bytes_of_members(member, *problem.ensemble, estimator));
    memory = memory && cost.memory ? std::optional(std::max(*memory, *cost.memory)) : std::nullopt;
  }
  const auto mean = [&](const std::optional<double>& sum, double times = 1.0) {
    return sum ? std::optional(*sum / static_cast<double>(sampled) * times) : std::nullopt;
  };
  estimate.members = members;
  estimate.steps = mean(steps);
  estimate.start = mean(start);
  estimate.a_step = mean(a_step);
  estimate.seconds = mean(seconds, static_cast<double>(members) / at_once);
  estimate.record = mean(bytes);
  estimate.memory = memory ? std::optional(*memory * at_once) : std::nullopt;
}

std::string gigabytes(double bytes) {
  return bytes < 1e9 ? fmt::format("{:.3g} MB", 1e-6 * bytes) : fmt::format("{:.3g} GB", 1e-9 * bytes);
}

std::string size_text(const RunEstimate& estimate) {
  std::vector<std::size_t> cells;
  for (const auto& [axis, count] : estimate.cells) {
    cells.push_back(count);
  }
  return cells.size() > 1 ? fmt::format("{:.6g} nodes ({})", estimate.nodes(), fmt::join(cells, " x "))
                          : fmt::format("{:.6g} nodes", estimate.nodes());
}

/// All the numbers, where memory does not suffice.
void require_fitting_memory(const RunEstimate& estimate, const Problem& problem) {
  if (!estimate.memory || *estimate.memory <= estimate.available.bytes) {
    return;
  }
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  std::string text = pde == nullptr
                         ? "the run"
                         : fmt::format("a run with {} fields on {}, {:.0f} bytes a node with this scheme,",
                                       estimate.fields, size_text(estimate), *estimate.memory / estimate.nodes());
  text += fmt::format(" would take {:.3g} GB of memory, and {:.3g} GB is available ({})", 1e-9 * *estimate.memory,
                      1e-9 * estimate.available.bytes, estimate.available.limit);
  if (estimate.record) {
    text += fmt::format("; its record would take {}", gigabytes(*estimate.record));
  }
  if (estimate.seconds) {
    text += fmt::format("; {:.6g} steps would take about {}", *estimate.steps, duration_text(*estimate.seconds));
  }
  throw ProblemError(pde == nullptr ? problem.scheme.location : pde->axes.front().location,
                     fmt::format("{}; take fewer {}", text, pde == nullptr ? "members at once (--threads)" : "cells"));
}

}  // namespace

std::string duration_text(double seconds) {
  constexpr double minute = 60.0, hour = 60.0 * minute, day = 24.0 * hour;
  return seconds < 2.0 * minute ? fmt::format("{:.2g} s", seconds)
         : seconds < 2.0 * hour ? fmt::format("{:.2g} min", seconds / minute)
         : seconds < 2.0 * day  ? fmt::format("{:.2g} h", seconds / hour)
                                : fmt::format("{:.3g} days", seconds / day);
}

double RunEstimate::nodes() const {
  double nodes = 1.0;
  for (const auto& [axis, count] : cells) {
    nodes *= static_cast<double>(count);
  }
  return nodes;
}

RunEstimate estimate_run(const Problem& problem, const RunOptions& options) {
  RunEstimate estimate;
  estimate.title = problem.title;
  estimate.file = options.output.value_or(problem.output.file);
  estimate.available = available_memory();
  if (const MultisymplecticProblem* const pde = problem.multisymplectic()) {
    for (const GridAxis& axis : pde->axes) {
      estimate.cells.emplace_back(axis.name, static_cast<std::size_t>(axis.cells));
    }
    estimate.fields = pde->fields.size();
  } else {
    estimate.coordinates = problem.hamiltonian()->q.size();
  }
  if (problem.ensemble) {
    estimate_members(problem, options, estimate);
    return estimate;
  }
  const ThreadCount threads(options.threads, problem);
  const Cost cost = Estimator(problem, options.tangents, timed_seconds).take();
  estimate.memory = cost.memory;
  estimate.record = cost.record;
  estimate.steps = cost.steps;
  estimate.start = cost.start;
  estimate.a_step = cost.a_step;
  estimate.seconds = cost.seconds();
  return estimate;
}

RunEstimate dry_run(const Problem& problem, const RunOptions& options) {
  RunEstimate estimate = estimate_run(problem, options);
  const double ranks = options.ranks == nullptr ? 1.0 : options.ranks->size();
  for (std::optional<double>* const shared : {&estimate.start, &estimate.a_step, &estimate.seconds}) {
    *shared = *shared ? std::optional(**shared / ranks) : std::nullopt;
  }
  if (estimate.memory && !problem.ensemble) {
    *estimate.memory /= ranks;
  }
  require_fitting_memory(estimate, problem);
  static_cast<void>(require_disk_for(problem, estimate.file, estimate.record));
  return estimate;
}

void require_memory_for(const Problem& problem, const RunOptions& options, double copies) {
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  if (pde == nullptr) {
    return;
  }
  // Ten times what the schemes were seen to take: below, nothing has to be estimated.
  constexpr double most_bytes_of_a_value = 8000.0;
  const double values = pde->nodes() * static_cast<double>(pde->fields.size());
  if (copies * values * most_bytes_of_a_value * problem.scheme.stages.value_or(1) < available_memory().bytes) {
    return;
  }
  RunEstimate estimate = estimate_run(problem, options);
  if (estimate.memory) {
    *estimate.memory *= copies;
  }
  require_fitting_memory(estimate, problem);
}

bool stores_as_expected(const Problem& problem) {
  return problem.scheme.levels == Levels::fixed &&
         std::ranges::none_of(problem.events, [](const auto& event) { return event.stop_after > 0; });
}

std::string require_disk_for(const Problem& problem, const std::string& file, std::optional<double> bytes) {
  constexpr double copies = 3.0;  // a published version, the working file, and the next version
  std::error_code unknown;
  const std::filesystem::path folder = std::filesystem::absolute(file).parent_path();
  const double available = static_cast<double>(std::filesystem::space(folder, unknown).available);
  if (unknown || !bytes || copies * *bytes <= available) {
    return {};
  }
  const std::string sizes = fmt::format(
      "the record takes about {:.3g} GB, up to three times as much while it is written, "
      "and {:.3g} GB are free in '{}'",
      1e-9 * *bytes, 1e-9 * available, folder.string());
  constexpr const char* remedy = "store less (output.every, output.compression), or elsewhere (-o)";
  if (*bytes > available && stores_as_expected(problem) && problem.output.compression == 0) {
    throw FileError(fmt::format("{}: {}: {}", file, sizes, remedy));
  }
  return fmt::format("{}: {}", sizes, remedy);
}

std::string to_json(const RunEstimate& estimate) {
  figures::JsonObject object, cells, memory, record, seconds;
  object.count("status", 0).flag("dry_run", true);
  for (const auto& [axis, count] : estimate.cells) {
    cells.count(axis, count);
  }
  object.object("cells", cells);
  if (estimate.fields > 0) {
    object.count("fields", estimate.fields);
  } else {
    object.count("coordinates", estimate.coordinates);
  }
  if (estimate.members) {
    object.count("members", *estimate.members);
  }
  const auto add = [](figures::JsonObject& to, const char* key, const std::optional<double>& value) {
    if (value) {
      to.number(key, *value);
    }
  };
  add(object, "steps", estimate.steps);
  add(memory, "bytes", estimate.memory);
  memory.number("available", estimate.available.bytes).text("limit", estimate.available.limit);
  add(record, "bytes", estimate.record);
  add(seconds, "total", estimate.seconds);
  add(seconds, "start", estimate.start);
  add(seconds, "step", estimate.a_step);
  return object.object("memory", memory)
      .object("record", record)
      .object("seconds", seconds)
      .text("file", estimate.file)
      .str();
}

std::string to_table(const RunEstimate& estimate) {
  std::string table = estimate.title + "\n";
  const auto row = [&table](std::string_view name, const std::string& value) {
    table += fmt::format("  {:<26} {}\n", name, value);
  };
  const auto about = [](const std::optional<double>& value, const auto& text) {
    return value ? "about " + text(*value) : std::string("unknown: the first steps fail on fewer cells");
  };
  if (estimate.fields > 0) {
    row("cells", fmt::format("{}, {} fields", size_text(estimate), estimate.fields));
  } else {
    row("coordinates", fmt::format("{}", estimate.coordinates));
  }
  if (estimate.members) {
    row("members", fmt::format("{}", *estimate.members));
  }
  row("steps", about(estimate.steps,
                     [&](double steps) { return fmt::format("{:.0f}{}", steps, estimate.members ? " each" : ""); }));
  row("memory", about(estimate.memory, [&](double bytes) {
        const std::string of_a_node =
            estimate.fields > 0 ? fmt::format(" ({:.0f} bytes a node)", bytes / estimate.nodes()) : "";
        return fmt::format("{}{}; {} are available ({})", gigabytes(bytes), of_a_node,
                           gigabytes(estimate.available.bytes), estimate.available.limit);
      }));
  row("record",
      about(estimate.record, [&](double bytes) { return fmt::format("{}, {}", gigabytes(bytes), estimate.file); }));
  row("time", about(estimate.seconds, [&](double seconds) {
        return fmt::format("{}, without writing: {} to start, {} a step", duration_text(seconds),
                           duration_text(*estimate.start), duration_text(*estimate.a_step));
      }));
  return table + "nothing was run\n";
}

}  // namespace rubato
