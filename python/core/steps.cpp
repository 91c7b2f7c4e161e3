#include "core.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <rubato/base/interrupt.hpp>
#include <rubato/run/orbit_levels.hpp>
#include <rubato/run/simulation.hpp>
#include <rubato/run/threads.hpp>

namespace rubato::python {

namespace {

/// A step that was taken: the level it led to, and the report of it.
struct Step {
  double t = 0.0;
  StepReport report;
  std::vector<double> z;  ///< of an orbit, the state at t: q, then p
};

Array array_of(std::span<const double> values) {
  return Array(static_cast<py::ssize_t>(values.size()), values.data());
}

/// Lets one thread at a time use an object that works without the lock of the interpreter.
class Alone {
public:
  explicit Alone(std::atomic<bool>& busy) : busy_(busy) {
    if (busy_.exchange(true)) {
      throw std::runtime_error("the integrator is in use by another thread; each thread needs one of its own");
    }
  }
  ~Alone() { busy_ = false; }
  Alone(const Alone&) = delete;
  Alone& operator=(const Alone&) = delete;

private:
  std::atomic<bool>& busy_;
};

/// Steps a problem by hand.
class Stepper {
public:
  Stepper(SharedProblem bound, int threads) : threads_(threads) { begin(std::move(bound)); }

  /// The next step; nothing at the end of the run. \throws std::runtime_error for a step that cannot be taken
  std::optional<Step> step() {
    const Alone alone(busy_);
    if (simulation_->finished()) {
      return std::nullopt;
    }
    Step taken;
    bool stopped = false;
    if (quick_) {
      const py::gil_scoped_release released;
      taken.report = simulation_->take(1);
    } else {
      stopped = !interruptible_step(taken.report);
    }
    if (stopped) {
      PyErr_SetNone(PyExc_KeyboardInterrupt);
      throw py::error_already_set();
    }
    if (taken.report.status != Status::success) {
      throw std::runtime_error(simulation_->integrator().explain(taken.report));
    }
    ++steps_;
    quick_ = bound_->problem.hamiltonian() != nullptr;
    taken.t = simulation_->t();
    if (quick_) {
      const auto z = simulation_->last().z_1;
      taken.z.assign(z.begin(), z.end());
    }
    return taken;
  }

  [[nodiscard]] std::size_t steps() const { return steps_; }
  /// What `read` reads of the simulation.
  template <typename Read>
  [[nodiscard]] auto read(const Read& read) {
    const Alone alone(busy_);
    return read(*simulation_);
  }

  /// The present state: q and p, or all fields, one after the other.
  [[nodiscard]] Array state() {
    const Alone alone(busy_);
    return array_of(simulation_->last().z_1);
  }
  /// A field of a lattice at the present level, of the shape of the grid.
  [[nodiscard]] Array field(const std::string& name) {
    const Alone alone(busy_);
    const auto* const pde = bound_->problem.multisymplectic();
    const auto place =
        pde == nullptr ? std::vector<std::string>::const_iterator() : std::ranges::find(pde->fields, name);
    if (pde == nullptr || place == pde->fields.end()) {
      throw py::key_error(name);
    }
    const std::span<const double> all = simulation_->last().z_1;
    const std::size_t size = all.size() / pde->fields.size();
    std::vector<std::size_t> shape;
    for (const GridAxis& axis : pde->axes) {
      shape.insert(shape.begin(), static_cast<std::size_t>(axis.cells));
    }
    return Array(shape, all.data() + static_cast<std::size_t>(place - pde->fields.begin()) * size);
  }

  /// Goes on from another problem: that of another state, at the present time.
  void restart(SharedProblem bound) {
    const Alone alone(busy_);
    begin(std::move(bound));
  }

  /// The state of an orbit at a time within the last step, by dense output.
  [[nodiscard]] Array between(double t) {
    const Alone alone(busy_);
    const OutputStep last = simulation_->last();
    if (bound_->problem.hamiltonian() == nullptr) {
      throw std::invalid_argument("states between levels are of orbits; a lattice has t_eval");
    }
    const double fraction = last.h == 0.0 ? 1.0 : (t - last.t_0) / last.h;
    if (!(fraction >= -1e-9 && fraction <= 1.0 + 1e-9)) {
      throw std::invalid_argument(fmt::format("t = {} is not in the last step, from {} to {}", t, last.t_0, last.t_1));
    }
    if (last.h == 0.0) {
      return array_of(last.z_1);
    }
    if (!between_) {
      between_.emplace(make_between(bound_->problem, "states between levels"));
    }
    std::vector<double> z(last.z_1.size());
    static_cast<void>(between_->at(last.z_0, last.z_1, last.h, std::clamp(fraction, 0.0, 1.0), z));
    return array_of(z);
  }

private:
  void begin(SharedProblem bound) {
    const py::gil_scoped_release released;
    const ThreadCount count(threads_, bound->problem);
    auto simulation = make_simulation(bound->problem);
    static_cast<void>(simulation->node());  // a run begins so, and a scheme may begin from what that computed
    between_.reset();
    simulation_ = std::move(simulation);  // before the problem that it refers to
    bound_.swap(bound);
    quick_ = false;
  }

  /// False where Ctrl-C ended the look-ahead, or was pressed in the step.
  bool interruptible_step(StepReport& report) {
    CatchInterrupt interrupt;
    bool ended = false;
    {
      const py::gil_scoped_release released;
      const ThreadCount count(threads_, bound_->problem);
      const Interruptible here(&interrupt.asked());
      report = simulation_->take(1);
      ended = simulation_->interrupted();
    }
    if (interrupt.asked() && !ended) {
      PyErr_SetInterrupt();  // after this step
    }
    return !ended;
  }

  int threads_;
  std::atomic<bool> busy_ = false;
  SharedProblem bound_;
  std::unique_ptr<Simulation> simulation_;
  std::optional<OrbitBetween> between_;
  std::size_t steps_ = 0;
  bool quick_ = false;  ///< an orbit after its first step, which may look ahead for long
};

/// The states of an orbit between its stored levels, which have to be all of a run.
class DenseOutput {
public:
  DenseOutput(SharedProblem bound, const Array& t, const Array& q, const Array& p, const Array& h)
      : bound_(std::move(bound)), t_(t), q_(q), p_(p), h_(h), between_(make_between(bound_->problem, "sol")) {
    const py::ssize_t levels = t.size();
    if (t.ndim() != 1 || q.ndim() != 2 || p.ndim() != 2 || h.ndim() != 1 || q.shape(0) != levels ||
        p.shape(0) != levels || h.size() != levels - 1 || q.shape(1) != p.shape(1)) {
      throw std::invalid_argument("dense output takes the states of all levels");
    }
  }

  /// The states at `times`, one row for each; not a number outside of the run.
  [[nodiscard]] Array at(const Array& times) {
    const auto n = static_cast<std::size_t>(q_.shape(1));
    const std::span<const double> t(t_.data(), static_cast<std::size_t>(t_.size()));
    Array states({static_cast<std::size_t>(times.size()), 2 * n});
    std::vector<double> z_0(2 * n), z_1(2 * n);
    const bool forward = t.size() < 2 || t.back() > t.front();
    const auto load = [&](std::size_t level, std::vector<double>& z) {
      const auto row = static_cast<py::ssize_t>(level);
      std::copy_n(q_.data(row, 0), n, z.begin());
      std::copy_n(p_.data(row, 0), n, z.begin() + static_cast<std::ptrdiff_t>(n));
    };
    for (py::ssize_t i = 0; i < times.size(); ++i) {
      const double time = times.data()[i];
      const std::span<double> out(states.mutable_data(i, 0), 2 * n);
      const auto after = forward ? std::upper_bound(t.begin(), t.end(), time)
                                 : std::upper_bound(t.begin(), t.end(), time, std::greater<>());
      auto step = static_cast<std::size_t>(std::max<std::ptrdiff_t>(after - t.begin() - 1, 0));
      step = std::min(step, t.size() < 2 ? 0 : t.size() - 2);
      load(step, z_0);
      if (t.size() < 2) {
        std::ranges::copy(z_0, out.begin());
        continue;
      }
      const double h = h_.data()[step], fraction = (time - t[step]) / h;
      load(step + 1, z_1);
      if (!(fraction >= -1e-9 && fraction <= 1.0 + 1e-9)) {
        throw std::invalid_argument(
            fmt::format("t = {} is outside of the run, from {} to {}", time, t.front(), t.back()));
      }
      if (fraction <= 0.0 || fraction >= 1.0) {
        std::ranges::copy(fraction <= 0.0 ? z_0 : z_1, out.begin());
      } else {
        static_cast<void>(between_.at(z_0, z_1, h, fraction, out));
      }
    }
    return states;
  }

private:
  SharedProblem bound_;
  Array t_, q_, p_, h_;
  OrbitBetween between_;
};

}  // namespace

void define_steps(py::module_& module) {
  py::class_<Step>(module, "Step")
      .def_readonly("t", &Step::t)
      .def_property_readonly("h", [](const Step& step) { return step.report.h; })
      .def_property_readonly("energy", [](const Step& step) { return step.report.energy; })
      .def_property_readonly("step_potential", [](const Step& step) { return step.report.potential; })
      .def_property_readonly("iterations", [](const Step& step) { return step.report.iterations; })
      .def_property_readonly("off_law", [](const Step& step) { return step.report.off_law; })
      .def_property_readonly("y", [](const Step& step) { return array_of(step.z); })
      .def_property_readonly("q", [](const Step& step) { return array_of(std::span(step.z).first(step.z.size() / 2)); })
      .def_property_readonly("p", [](const Step& step) { return array_of(std::span(step.z).last(step.z.size() / 2)); });
  py::class_<Stepper>(module, "Stepper")
      .def(py::init([](std::shared_ptr<BoundProblem> bound, int threads) {
             return std::make_unique<Stepper>(std::move(bound), threads);
           }),
           py::arg("problem"), py::arg("threads"))
      .def("step", &Stepper::step)
      .def("__next__",
           [](Stepper& stepper) {
             auto step = stepper.step();
             if (!step) {
               throw py::stop_iteration();
             }
             return *std::move(step);
           })
      .def("__iter__", [](const py::object& self) { return self; })
      .def("between", &Stepper::between, py::arg("t"))
      .def("field", &Stepper::field, py::arg("name"))
      .def("state", &Stepper::state)
      .def("restart", [](Stepper& stepper, std::shared_ptr<BoundProblem> bound) { stepper.restart(std::move(bound)); })
      .def_property_readonly("steps", &Stepper::steps)
      .def_property_readonly("t", [](Stepper& stepper) { return stepper.read([](Simulation& s) { return s.t(); }); })
      .def_property_readonly("finished",
                             [](Stepper& stepper) { return stepper.read([](Simulation& s) { return s.finished(); }); })
      .def_property_readonly("h",
                             [](Stepper& stepper) {
                               return stepper.read([](Simulation& s) { return s.integrator().levels().last_step(); });
                             })
      .def_property_readonly(
          "H", [](Stepper& stepper) { return stepper.read([](Simulation& s) { return s.node().energy; }); });
  py::class_<DenseOutput>(module, "DenseOutput")
      .def(py::init([](std::shared_ptr<BoundProblem> bound, const Array& t, const Array& q, const Array& p,
                       const Array& h) { return std::make_unique<DenseOutput>(std::move(bound), t, q, p, h); }),
           py::arg("problem"), py::arg("t"), py::arg("q"), py::arg("p"), py::arg("h"))
      .def("at", &DenseOutput::at, py::arg("times"));
}

}  // namespace rubato::python
