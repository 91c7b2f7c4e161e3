#include "core.hpp"

#include <rubato/base/interrupt.hpp>
#include <rubato/run/solve.hpp>

namespace rubato::python {

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

namespace {

using python::ending_of;

Ending ending_of(const EnsembleOutcome& outcome) {
  return {.status = outcome.status,
          .json = to_json(outcome),
          .table = to_table(outcome, true),
          .message = outcome.message,
          .file = outcome.file,
          .title = outcome.title,
          .warnings = outcome.findings.warnings("members")};
}

Ending ending_of(const ConvergenceOutcome& outcome) {
  return {.status = outcome.status,
          .json = outcome.ended ? to_json(outcome) : "",
          .table = outcome.ended ? to_table(outcome) : "",
          .message = outcome.message,
          .title = outcome.title,
          .warnings = outcome.findings.warnings("runs")};
}

Ending ending_of(const SolveOutcome& outcome) {
  return {.status = outcome.status,
          .json = to_json(outcome),
          .table = to_table(outcome),
          .message = outcome.message,
          .file = outcome.file,
          .title = outcome.title,
          .warnings = outcome.warnings,
          .verdict = outcome.found() ? std::string(figures::to_string(outcome.judgement.verdict)) : ""};
}

Ending run_to_file(const SharedProblem& bound, const std::string& file, bool overwrite, bool tangents, int threads,
                   const py::object& progress) {
  RunOptions options{.output = file, .overwrite = overwrite, .tangents = tangents};
  const Problem& problem = bound->problem;
  if (problem.ensemble) {
    return ending_of(carry_out({threads, progress}, options,
                               [&](const RunOptions& complete) { return run_ensemble(problem, complete); }));
  }
  return ending_of(
      carry_out({threads, progress}, options, [&](const RunOptions& complete) { return run(problem, complete); }));
}

py::tuple run_in_memory(const SharedProblem& bound, bool tangents, int threads, const py::object& progress) {
  auto rows = std::make_shared<MemoryRecord>();
  const Ending ending =
      ending_of(carry_out({threads, progress}, {.tangents = tangents},
                          [&](const RunOptions& complete) { return run(bound->problem, *rows, complete); }));
  return py::make_tuple(ending, rows);
}

Ending resume_file(const std::string& file, std::optional<double> until, int threads, const py::object& progress) {
  if (is_ensemble(record::Reader(file))) {
    if (until) {
      throw std::invalid_argument("the members of an ensemble end where its problem says; leave until out");
    }
    return ending_of(carry_out({threads, progress}, {},
                               [&](const RunOptions& complete) { return resume_ensemble(file, complete); }));
  }
  return ending_of(
      carry_out({threads, progress}, {}, [&](const RunOptions& complete) { return resume(file, until, complete); }));
}

Ending check_file(const std::string& file, bool replay) {
  const bool ensemble = is_ensemble(record::Reader(file, record::Altered::reported));
  return carry_out({0, py::none()}, {}, [&](const RunOptions& complete) {
    if (ensemble) {
      return ending_of(check_ensemble(file, complete));
    }
    const Interruptible here(complete.interrupt);
    try {
      return ending_of(check(file, {.replay = replay}));
    } catch (const Interrupted&) {
      return Ending{};  // the interrupt is passed on
    }
  });
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
  module.def(
      "solve",
      [](const SharedProblem& bound, const std::string& file, bool overwrite, int threads) {
        return ending_of(
            carry_out({threads, py::none()}, {.output = file, .overwrite = overwrite},
                      [&](const RunOptions& complete) { return solve_problem(bound->problem, complete); }));
      },
      py::arg("problem"), py::arg("file"), py::arg("overwrite"), py::arg("threads"));
  module.def("check", &check_file, py::arg("file"), py::arg("replay"));
  module.def(
      "converge",
      [](const SharedProblem& bound, std::optional<double> tolerance, int threads, const py::object& progress) {
        return ending_of(carry_out({threads, progress}, {}, [&](const RunOptions& complete) {
          return converge(bound->problem, tolerance, complete);
        }));
      },
      py::arg("problem"), py::arg("tolerance"), py::arg("threads"), py::arg("progress"));
}

}  // namespace rubato::python
