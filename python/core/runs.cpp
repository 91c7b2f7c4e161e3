#include "core.hpp"

#include <algorithm>
#include <chrono>
#include <exception>

#include <rubato/base/interrupt.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/run/threads.hpp>

namespace rubato::python {

namespace {

/// How a run, a check, an ensemble or a convergence study ended: what the program would print.
struct Ending {
  ExitStatus status = ExitStatus::done;
  std::string json = {}, table = {}, message = {}, file = {}, title = {};
  std::vector<std::string> warnings = {};
  std::string verdict = {};
};

Ending ending_of(const Outcome& outcome) {
  return {.status = outcome.status,
          .json = to_json(outcome),
          .table = to_table(outcome),
          .message = outcome.message,
          .file = outcome.file,
          .title = outcome.title,
          .warnings = outcome.warnings,
          .verdict = std::string(figures::to_string(outcome.judgement.verdict))};
}

Ending ending_of(const EnsembleOutcome& outcome) {
  return {.status = outcome.status,
          .json = to_json(outcome),
          .table = to_table(outcome, true),
          .message = outcome.message,
          .file = outcome.file,
          .title = outcome.title,
          .warnings = outcome.findings.warnings("members")};
}

Ending ending_of(const Ending& ending) {
  return ending;
}

Ending ending_of(const ConvergenceOutcome& outcome) {
  return {.status = outcome.status,
          .json = outcome.ended ? to_json(outcome) : "",
          .table = outcome.ended ? to_table(outcome) : "",
          .message = outcome.message,
          .title = outcome.title,
          .warnings = outcome.findings.warnings("runs")};
}

/// What a caller may ask of a run.
struct Wishes {
  int threads = 0;
  py::object progress;  ///< called with (t, start, until, steps, members), or None
};

/// Carries out `work` without the lock of the interpreter: `progress` is called with it, and what that raises ends the
/// work and is raised again.
template <typename Work>
Ending carry_out(const Wishes& wishes, RunOptions options, const Work& work) {
  CatchInterrupt interrupt;
  std::exception_ptr raised;
  options.threads = wishes.threads;
  options.interrupt = &interrupt.asked();
  if (!wishes.progress.is_none()) {
    options.progress = [&](const Progress& now) {
      const py::gil_scoped_acquire acquired;
      try {
        wishes.progress(now.t, now.start, now.until, now.steps, now.members);
      } catch (...) {
        raised = std::current_exception();
        interrupt.asked() = true;
      }
    };
  }
  Ending ending;
  {
    const py::gil_scoped_release released;
    ending = ending_of(work(options));
  }
  if (raised) {
    std::rethrow_exception(raised);
  }
  if (interrupt.asked() && ending.status != ExitStatus::interrupted) {
    PyErr_SetInterrupt();  // what cannot be interrupted, or had ended
  }
  return ending;
}

Ending run_to_file(const SharedProblem& bound, const std::string& file, bool overwrite, bool tangents, int threads,
                   const py::object& progress) {
  RunOptions options{.output = file, .overwrite = overwrite, .tangents = tangents};
  const Problem& problem = bound->problem;
  if (problem.ensemble) {
    return carry_out({threads, progress}, options,
                     [&](const RunOptions& complete) { return run_ensemble(problem, complete); });
  }
  return carry_out({threads, progress}, options, [&](const RunOptions& complete) { return run(problem, complete); });
}

py::tuple run_in_memory(const SharedProblem& bound, bool tangents, int threads, const py::object& progress) {
  auto rows = std::make_shared<MemoryRecord>();
  const Ending ending = carry_out({threads, progress}, {.tangents = tangents},
                                  [&](const RunOptions& complete) { return run(bound->problem, *rows, complete); });
  return py::make_tuple(ending, rows);
}

Ending resume_file(const std::string& file, std::optional<double> until, int threads, const py::object& progress) {
  if (is_ensemble(record::Reader(file))) {
    if (until) {
      throw std::invalid_argument("the members of an ensemble end where its problem says; leave until out");
    }
    return carry_out({threads, progress}, {},
                     [&](const RunOptions& complete) { return resume_ensemble(file, complete); });
  }
  return carry_out({threads, progress}, {}, [&](const RunOptions& complete) { return resume(file, until, complete); });
}

Ending check_file(const std::string& file, bool replay) {
  const bool ensemble = is_ensemble(record::Reader(file, record::Altered::told));
  return carry_out({0, py::none()}, {}, [&](const RunOptions& complete) {
    if (ensemble) {
      return ending_of(check_ensemble(file, complete));
    }
    const Interruptible here(replay ? nullptr : complete.interrupt);
    try {
      return ending_of(check(file, {.replay = replay}));
    } catch (const Interrupted&) {
      return Ending{};  // the interrupt is passed on
    }
  });
}

/// Orbits of one H from many initial states: the last level of each, as integrate() of the library has them.
py::dict ends_of(const SharedProblem& bound, const Array& states, int threads) {
  const HamiltonianProblem* const orbit = bound->problem.hamiltonian();
  if (orbit == nullptr || orbit->L) {
    throw std::invalid_argument("an ensemble from an array is of a Hamiltonian: use rubato.scan for others");
  }
  const std::size_t n = orbit->q.size(), dimension = 2 * n;
  if (states.ndim() != 2 || static_cast<std::size_t>(states.shape(1)) != dimension) {
    throw std::invalid_argument(fmt::format("the initial states of an ensemble have shape (members, {})", dimension));
  }
  std::vector<InitialState> initial;
  for (py::ssize_t m = 0; m < states.shape(0); ++m) {
    const double* const z = states.data(m, 0);
    initial.push_back({.q = {z, z + n}, .p = {z + n, z + dimension}, .t = orbit->initial.t});
  }
  const Hamiltonian hamiltonian = make_hamiltonian(bound->problem);
  const IntegrationOptions options = make_integration_options(bound->problem);
  std::vector<OrbitEnd> ends;
  // Some members after the other, so that Ctrl-C is heard: as many as take about a third of a second.
  constexpr std::size_t first_members = 256;
  constexpr std::chrono::milliseconds short_while{300};
  for (std::size_t count = first_members; ends.size() < initial.size();) {
    const auto begun = std::chrono::steady_clock::now();
    const std::span<const InitialState> next(initial.begin() + static_cast<std::ptrdiff_t>(ends.size()), initial.end());
    {
      const py::gil_scoped_release released;
      const ThreadCount thread_count(threads);
      std::ranges::move(integrate(hamiltonian, next.first(std::min(count, next.size())), options),
                        std::back_inserter(ends));
    }
    if (PyErr_CheckSignals() != 0) {
      throw py::error_already_set();
    }
    const auto taken = std::chrono::steady_clock::now() - begun;
    count = taken < short_while ? 2 * count : taken > 2 * short_while ? std::max(count / 2, std::size_t{1}) : count;
  }
  std::vector<double> z, t, energy, deviation, node_deviation;
  std::vector<std::int64_t> steps, status;
  py::list messages;
  for (const OrbitEnd& end : ends) {
    z.insert(z.end(), end.q.begin(), end.q.end());
    z.insert(z.end(), end.p.begin(), end.p.end());
    t.push_back(end.t);
    steps.push_back(static_cast<std::int64_t>(end.steps));
    status.push_back(end.status == Status::success ? 0 : 1);
    energy.push_back(end.discrete_energy);
    deviation.push_back(end.discrete_energy_deviation);
    node_deviation.push_back(end.node_energy_deviation);
    messages.append(end.message);
  }
  const std::size_t members = ends.size();
  py::dict all;
  all["y"] = own(std::move(z), {members, dimension});
  all["t"] = own(std::move(t), {members});
  all["steps"] = own(std::move(steps), {members});
  all["status"] = own(std::move(status), {members});
  all["energy"] = own(std::move(energy), {members});
  all["energy_deviation"] = own(std::move(deviation), {members});
  all["node_energy_deviation"] = own(std::move(node_deviation), {members});
  all["messages"] = messages;
  return all;
}

}  // namespace

void define_runs(py::module_& module) {
  py::class_<Ending>(module, "Ending")
      .def_property_readonly("status", [](const Ending& ending) { return static_cast<int>(ending.status); })
      .def_readonly("json", &Ending::json)
      .def_readonly("table", &Ending::table)
      .def_readonly("message", &Ending::message)
      .def_readonly("file", &Ending::file)
      .def_readonly("title", &Ending::title)
      .def_readonly("warnings", &Ending::warnings)
      .def_readonly("verdict", &Ending::verdict);
  module.def("run", &run_to_file, py::arg("problem"), py::arg("file"), py::arg("overwrite"), py::arg("tangents"),
             py::arg("threads"), py::arg("progress"));
  module.def("run_in_memory", &run_in_memory, py::arg("problem"), py::arg("tangents"), py::arg("threads"),
             py::arg("progress"));
  module.def("resume", &resume_file, py::arg("file"), py::arg("until"), py::arg("threads"), py::arg("progress"));
  module.def("check", &check_file, py::arg("file"), py::arg("replay"));
  module.def(
      "converge",
      [](const SharedProblem& bound, std::optional<double> tolerance, int threads, const py::object& progress) {
        return carry_out({threads, progress}, {},
                         [&](const RunOptions& complete) { return converge(bound->problem, tolerance, complete); });
      },
      py::arg("problem"), py::arg("tolerance"), py::arg("threads"), py::arg("progress"));
  module.def("ends", &ends_of, py::arg("problem"), py::arg("states"), py::arg("threads"));
}

}  // namespace rubato::python
