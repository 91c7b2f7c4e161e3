#pragma once

#include <csignal>

#include <atomic>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <rubato/rubato.hpp>

/// The parts of the module `rubato._core`, which the package in rubato/ is written over.
namespace rubato::python {

namespace py = pybind11;

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// A problem, and the arrays that its initial data are read from.
struct BoundProblem {
  Problem problem;
  std::vector<Array> arrays;
};
using SharedProblem = std::shared_ptr<const BoundProblem>;

/// While one lives in the main thread of Python, Ctrl-C sets asked() and does nothing else.
class CatchInterrupt {
public:
  CatchInterrupt();
  ~CatchInterrupt();
  CatchInterrupt(const CatchInterrupt&) = delete;
  CatchInterrupt& operator=(const CatchInterrupt&) = delete;
  [[nodiscard]] std::atomic<bool>& asked() { return asked_; }

private:
  std::atomic<bool> asked_ = false;
  std::optional<struct sigaction> before_;
};

/// A numpy array that owns `values`.
template <typename Number>
[[nodiscard]] py::array own(std::vector<Number>&& values, std::vector<std::size_t> shape) {
  auto* const kept = new std::vector<Number>(std::move(values));
  const py::capsule owner(kept, [](void* all) { delete static_cast<std::vector<Number>*>(all); });
  return py::array_t<Number>(std::move(shape), kept->data(), owner);
}

/// How a run, a check, an ensemble or a convergence study ended: what the program would print.
struct Ending {
  ExitStatus status = ExitStatus::done;
  std::string json = {}, table = {}, message = {}, file = {}, title = {};
  std::vector<std::string> warnings = {};
  std::string verdict = {};
};

[[nodiscard]] Ending ending_of(const Outcome& outcome);

/// What a caller may ask of a run.
struct Wishes {
  int threads = 0;
  py::object progress;  ///< called with (t, start, until, steps, members), or None
};

/// Carries out `work` without the lock of the interpreter: `progress` is called with it, and what that raises ends the
/// work and is raised again. \return what `work` returns, which has a status
template <typename Work>
auto carry_out(const Wishes& wishes, RunOptions options, const Work& work) {
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
  auto outcome = [&] {
    const py::gil_scoped_release released;
    return work(std::as_const(options));
  }();
  if (raised) {
    std::rethrow_exception(raised);
  }
  if (interrupt.asked() && outcome.status != ExitStatus::interrupted) {
    PyErr_SetInterrupt();  // what cannot be interrupted, or had ended
  }
  return outcome;
}

void define_many(py::module_& module);
void define_problems(py::module_& module);
void define_records(py::module_& module);
void define_runs(py::module_& module);
void define_steps(py::module_& module);

}  // namespace rubato::python
