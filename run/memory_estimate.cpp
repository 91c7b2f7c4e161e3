#include <rubato/run/memory_estimate.hpp>

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>

#include <fmt/format.h>

#include <rubato/base/memory.hpp>
#include <rubato/run/chronicle.hpp>
#include <rubato/run/last_rows.hpp>
#include <rubato/run/recorder.hpp>
#include <rubato/run/threads.hpp>

namespace rubato {

namespace {

double nodes_of(const MultisymplecticProblem& pde) {
  double nodes = 1.0;
  for (const GridAxis& axis : pde.axes) {
    nodes *= static_cast<double>(axis.cells);
  }
  return nodes;
}

/// The problem on a lattice of about so many nodes; numbers of cells stay odd or even, which some schemes need.
Problem on_nodes(Problem problem, double nodes) {
  auto& pde = std::get<MultisymplecticProblem>(problem.system);
  const double factor = std::pow(nodes / nodes_of(pde), 1.0 / static_cast<double>(pde.axes.size()));
  for (GridAxis& axis : pde.axes) {
    const auto cells = std::max<std::int64_t>(std::llround(static_cast<double>(axis.cells) * factor), 5);
    axis.cells = cells + (axis.cells - cells) % 2;
  }
  return problem;
}

/// What a run does until its third level, but for the file.
void take_steps(const Problem& problem, bool tangents) {
  const ThreadCount one(1);
  Chronicle chronicle(problem, tangents);
  LastRows rows(chronicle.layout());
  chronicle.tell_start(rows);
  for (int step = 0; step < 2; ++step) {
    chronicle.take(1);
    if (chronicle.simulation().taken().empty()) {
      break;  // a coarse lattice may need shorter steps
    }
    chronicle.tell_steps(rows);
  }
  static_cast<void>(make_checkpoint(chronicle));
}

/// How much a child process grows at its peak when it takes these steps.
std::optional<double> growth(const Problem& problem, bool tangents) {
  std::array<int, 2> ends{};
  if (::pipe(ends.data()) != 0) {
    return std::nullopt;
  }
  const pid_t child = ::fork();
  if (child == 0) {
    constexpr rlimit seconds{60, 60};
    static_cast<void>(::setrlimit(RLIMIT_CPU, &seconds));
    double grown = 0.0;
    try {
      const double before = peak_memory();
      take_steps(problem, tangents);
      grown = peak_memory() - before;
    } catch (...) {
      ::_exit(1);
    }
    ::_exit(::write(ends[1], &grown, sizeof grown) == sizeof grown ? 0 : 1);
  }
  ::close(ends[1]);
  double grown = 0.0;
  const bool is_read = child > 0 && ::read(ends[0], &grown, sizeof grown) == sizeof grown;
  ::close(ends[0]);
  int status = 0;
  if (child > 0) {
    ::waitpid(child, &status, 0);
  }
  return is_read && status == 0 ? std::optional(grown) : std::nullopt;
}

}  // namespace

std::optional<double> estimated_memory(const Problem& problem, bool tangents) {
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  if (pde == nullptr) {
    return std::nullopt;
  }
  constexpr double few = 3000, many = 12'000;
  const Problem small = on_nodes(problem, few), large = on_nodes(problem, many);
  const double of_small = nodes_of(*small.multisymplectic()), of_large = nodes_of(*large.multisymplectic());
  const auto a = growth(small, tangents), b = growth(large, tangents);
  if (!a || !b) {
    return std::nullopt;
  }
  // Rows wait for the file in 16 MB, as much is the program itself; unused parts of the heap are up to a tenth more.
  constexpr double program_and_rows = 32e6, heap = 1.1;
  return program_and_rows + heap * (*b + (*b - *a) / (of_large - of_small) * (nodes_of(*pde) - of_large));
}

void require_memory_for(const Problem& problem, bool tangents, double copies) {
  const MultisymplecticProblem* const pde = problem.multisymplectic();
  if (pde == nullptr) {
    return;
  }
  // Ten times what the schemes were seen to take: below, nothing has to be estimated.
  constexpr double most_bytes_of_a_value = 8000.0;
  const double nodes = nodes_of(*pde), values = nodes * static_cast<double>(pde->fields.size());
  if (copies * values * most_bytes_of_a_value * problem.scheme.stages.value_or(1) < available_memory().bytes) {
    return;
  }
  if (const auto bytes = estimated_memory(problem, tangents)) {
    try {
      require_memory(copies * *bytes, fmt::format("a run with {} fields on {:.6g} nodes, {:.0f} bytes a node with this "
                                                  "scheme,",
                                                  pde->fields.size(), nodes, *bytes / nodes));
    } catch (const std::invalid_argument& error) {
      throw ProblemError(pde->axes.front().location, fmt::format("{}; take fewer cells", error.what()));
    }
  }
}

}  // namespace rubato
