// Many orbits of one problem from arrays of states.

#include "core.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <mutex>

#include <omp.h>

#include <rubato/base/interrupt.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/member_verdicts.hpp>
#include <rubato/run/threads.hpp>

namespace rubato::python {

namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// The last level of each member and how it ended, as arrays; what is not known of one is not a number.
struct LastLevels {
  LastLevels(std::size_t members, std::size_t size) : dimension(size), y(members * size, unknown), messages(members) {
    for (std::vector<double>* const values : {&t, &energy, &deviation, &node_deviation}) {
      values->assign(members, unknown);
    }
    steps.assign(members, 0);
    status.assign(members, static_cast<std::int64_t>(ExitStatus::interrupted));
  }

  [[nodiscard]] py::dict arrays() && {
    const std::size_t members = t.size();
    py::dict all;
    all["y"] = own(std::move(y), {members, dimension});
    all["t"] = own(std::move(t), {members});
    all["energy"] = own(std::move(energy), {members});
    all["energy_deviation"] = own(std::move(deviation), {members});
    all["node_energy_deviation"] = own(std::move(node_deviation), {members});
    all["steps"] = own(std::move(steps), {members});
    all["status"] = own(std::move(status), {members});
    all["messages"] = py::cast(messages);
    return all;
  }

  std::size_t dimension;
  std::vector<double> y, t = {}, energy = {}, deviation = {}, node_deviation = {};
  std::vector<std::int64_t> steps = {}, status = {};
  std::vector<std::string> messages;
};

std::size_t require_states(const Array& states, std::size_t dimension) {
  if (states.ndim() != 2 || static_cast<std::size_t>(states.shape(1)) != dimension) {
    throw std::invalid_argument(fmt::format("the initial states of an ensemble have shape (members, {})", dimension));
  }
  return static_cast<std::size_t>(states.shape(0));
}

/// What a run of many members is for carry_out().
struct Many {
  ExitStatus status = ExitStatus::done;
};

void show_progress(const RunOptions& options, std::size_t done, std::size_t members) {
  Progress progress{};
  progress.t = static_cast<double>(done);
  progress.members = members;
  options.progress(progress);
}

/// The last levels alone, by integrate() of the library: side by side in vectors where it can.
py::dict ends_of(const SharedProblem& bound, const Array& states, int threads, const py::object& progress) {
  const HamiltonianProblem& orbit = *bound->problem.hamiltonian();
  const std::size_t n = orbit.q.size(), members = require_states(states, 2 * n);
  std::vector<InitialState> initial;
  for (std::size_t m = 0; m < members; ++m) {
    const double* const z = states.data(static_cast<py::ssize_t>(m), 0);
    initial.push_back({.q = {z, z + n}, .p = {z + n, z + 2 * n}, .t = orbit.initial.t});
  }
  LastLevels last(members, 2 * n);
  const auto take = [&](std::size_t m, const OrbitEnd& end) {
    if (end.q.empty()) {
      return;  // interrupted before its start
    }
    std::ranges::copy(end.p, std::ranges::copy(end.q, last.y.begin() + static_cast<std::ptrdiff_t>(2 * n * m)).out);
    last.t[m] = end.t;
    last.energy[m] = end.discrete_energy;
    last.deviation[m] = end.discrete_energy_deviation;
    last.node_deviation[m] = end.node_energy_deviation;
    last.steps[m] = static_cast<std::int64_t>(end.steps);
    const bool singular = end.status == Status::singular || end.status == Status::ill_conditioned;
    last.status[m] = static_cast<std::int64_t>(end.interrupted                 ? ExitStatus::interrupted
                                               : end.status == Status::success ? ExitStatus::done
                                               : singular                      ? ExitStatus::singular
                                                                               : ExitStatus::failed);
    last.messages[m] = end.interrupted ? fmt::format("interrupted at t = {:.10g}", end.t) : end.message;
  };
  static_cast<void>(carry_out({threads, progress}, {}, [&](const RunOptions& options) {
    const ThreadCount thread_count(options.threads);
    const Hamiltonian hamiltonian = make_hamiltonian(bound->problem);
    const IntegrationOptions how = make_integration_options(bound->problem);
    const Interruptible here(options.interrupt);
    // Some members after the other, to show progress: as many as take about a third of a second.
    constexpr std::size_t first_members = 1024;
    constexpr std::chrono::milliseconds short_while{300};
    std::size_t count = first_members, done = 0;
    while (done < members && !*options.interrupt) {
      const auto begun = std::chrono::steady_clock::now();
      count = std::min(count, members - done);
      for (const OrbitEnd& end : integrate(hamiltonian, std::span(initial).subspan(done, count), how)) {
        take(done++, end);
      }
      const auto taken = std::chrono::steady_clock::now() - begun;
      count = taken < short_while ? 2 * count : taken > 2 * short_while ? std::max(count / 2, std::size_t{1}) : count;
      if (options.progress) {
        show_progress(options, done, members);
      }
    }
    const bool all = std::ranges::count(last.status, static_cast<std::int64_t>(ExitStatus::interrupted)) == 0;
    return Many{all ? ExitStatus::done : ExitStatus::interrupted};
  }));
  return std::move(last).arrays();
}

/// The last row of a dataset; empty if there is none.
std::span<const double> last_row(const MemoryRecord& record, const std::string& path) {
  const auto& datasets = record.layout().datasets;
  const auto dataset = std::ranges::find(datasets, path, &record::Dataset::path);
  const auto number = static_cast<std::size_t>(dataset - datasets.begin());
  const auto& values = std::get<std::vector<double>>(record.values(number));
  return std::span(values).last(std::min(record.row_size(number), values.size()));
}

/// Runs of one problem from many states, each as its own run in memory, on all threads.
class ManyRuns {
public:
  /// \param names of the entries of [initial] that the columns of `states` are
  ManyRuns(const Problem& problem, const std::vector<std::string>& names, const Array& states)
      : ensemble_(problem), outcomes_(static_cast<std::size_t>(states.shape(0))), rows_(outcomes_.size()) {
    Ensemble& ensemble = ensemble_.ensemble.emplace();
    ensemble.common = problem.text;
    for (const std::string& name : names) {
      ensemble.paths.push_back("initial." + name);
    }
    for (py::ssize_t m = 0; m < states.shape(0); ++m) {
      auto& values = ensemble.values.emplace_back();
      for (py::ssize_t i = 0; i < states.shape(1); ++i) {
        values.push_back(fmt::format("{:.17g}", states.at(m, i)));
        if (values.back().find_first_of(".e") == std::string::npos) {
          values.back() += ".0";
        }
      }
    }
  }

  /// \throws what the first member in their order throws
  Many run(const RunOptions& options) {
    const ThreadCount thread_count(options.threads);
    RunOptions of_member = options;
    of_member.progress = {};
    of_member.threads = 1;
    std::size_t done = 0, failed = outcomes_.size();
    std::atomic<bool> has_failed = false;
    std::exception_ptr error;
    std::mutex counting;
    auto shown = std::chrono::steady_clock::now();
#pragma omp parallel for schedule(dynamic, 1) default(shared)
    for (std::size_t m = 0; m < outcomes_.size(); ++m) {
      if (*options.interrupt || has_failed) {
        continue;
      }
      try {
        rows_[m] = std::make_shared<MemoryRecord>();
        outcomes_[m] = rubato::run(member_problem(ensemble_, m), *rows_[m], of_member);
      } catch (...) {
        const std::scoped_lock lock(counting);
        if (m < failed) {
          failed = m;
          error = std::current_exception();
          has_failed = true;
        }
      }
      const std::scoped_lock lock(counting);
      ++done;
      const auto now = std::chrono::steady_clock::now();
      if (omp_get_thread_num() == 0 && options.progress && now - shown >= options.progress_interval) {
        shown = now;
        show_progress(options, done, outcomes_.size());
      }
    }
    if (error) {
      std::rethrow_exception(error);
    }
    return {*options.interrupt ? ExitStatus::interrupted : ExitStatus::done};
  }

  /// Last levels, verdicts, and gathered warnings.
  /// \param numbers of these members among `all` whose others are good; empty: there are no others
  [[nodiscard]] py::dict results(const std::vector<std::size_t>& numbers, std::size_t all_members) {
    const HamiltonianProblem& orbit = *ensemble_.hamiltonian();
    LastLevels last(outcomes_.size(), 2 * orbit.q.size());
    MemberVerdicts findings;
    std::vector<std::string> verdicts(outcomes_.size());
    for (std::size_t m = 0; m < outcomes_.size(); ++m) {
      if (!outcomes_[m]) {
        continue;
      }
      const Outcome& outcome = *outcomes_[m];
      const figures::Statistics& statistics = outcome.statistics;
      const auto to = last.y.begin() + static_cast<std::ptrdiff_t>(last.dimension * m);
      std::ranges::copy(last_row(*rows_[m], orbit.L ? "/states/q_dot" : "/states/p"),
                        std::ranges::copy(last_row(*rows_[m], "/states/q"), to).out);
      last.t[m] = statistics.has_clock() ? statistics.clock : statistics.t;
      last.energy[m] = statistics.energy();
      last.deviation[m] = statistics.relative_energy_deviation().value_or(unknown);
      last.node_deviation[m] = statistics.node_energy.max();
      last.steps[m] = static_cast<std::int64_t>(statistics.steps);
      last.status[m] = static_cast<std::int64_t>(outcome.status);
      last.messages[m] = outcome.message;
      verdicts[m] = figures::to_string(outcome.judgement.verdict);
      findings.add(numbers.empty() ? m : numbers[m], "", outcome.warnings, outcome.judgement,
                   outcome.complete             ? RunEnd::complete
                   : has_failed(outcome.status) ? RunEnd::failed
                                                : RunEnd::interrupted);
    }
    for (std::size_t m = outcomes_.size(); m < all_members; ++m) {
      findings.add(m, "", {}, {}, RunEnd::complete);
    }
    py::dict all = std::move(last).arrays();
    all["verdicts"] = py::cast(verdicts);
    all["warnings"] = py::cast(findings.warnings("members"));
    all["verdict"] = py::cast(std::string(figures::to_string(findings.verdict())));
    return all;
  }

  /// How a member ended, and its rows; nothing of one that was not run.
  [[nodiscard]] std::optional<std::pair<Ending, std::shared_ptr<MemoryRecord>>> member(std::size_t m) const {
    const std::optional<Outcome>& outcome = outcomes_.at(m);
    return outcome ? std::optional(std::pair(ending_of(*outcome), rows_[m])) : std::nullopt;
  }
  [[nodiscard]] std::shared_ptr<BoundProblem> problem(std::size_t m) const {
    auto bound = std::make_shared<BoundProblem>();
    bound->problem = member_problem(ensemble_, m);
    return bound;
  }

private:
  Problem ensemble_;
  std::vector<std::optional<Outcome>> outcomes_;  ///< none of a member that was not run
  std::vector<std::shared_ptr<MemoryRecord>> rows_;
};

}  // namespace

void define_many(py::module_& module) {
  module.def("ends", &ends_of, py::arg("problem"), py::arg("states"), py::arg("threads"), py::arg("progress"));
  py::class_<ManyRuns>(module, "ManyRuns")
      .def(py::init([](const SharedProblem& bound, const std::vector<std::string>& names, const Array& states,
                       int threads, const py::object& progress) {
             require_states(states, names.size());
             auto runs = std::make_unique<ManyRuns>(bound->problem, names, states);
             static_cast<void>(
                 carry_out({threads, progress}, {}, [&](const RunOptions& options) { return runs->run(options); }));
             return runs;
           }),
           py::arg("problem"), py::arg("names"), py::arg("states"), py::arg("threads"), py::arg("progress"))
      .def("results", &ManyRuns::results, py::arg("numbers"), py::arg("members"))
      .def("member", &ManyRuns::member, py::arg("number"))
      .def("problem", &ManyRuns::problem, py::arg("number"));
}

}  // namespace rubato::python
