#pragma once

#include <csignal>

#include <atomic>
#include <memory>
#include <optional>
#include <string>
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

void define_problems(py::module_& module);
void define_records(py::module_& module);
void define_runs(py::module_& module);
void define_steps(py::module_& module);

}  // namespace rubato::python
