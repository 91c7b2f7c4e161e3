#include "core.hpp"
#include "states.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include <rubato/base/interrupt.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/run/events.hpp>
#include <rubato/run/last_rows.hpp>
#include <rubato/run/simulation.hpp>
#include <rubato/run/threads.hpp>

namespace rubato::python {

namespace {

/// A crossing of an event, with the state that is read there: coordinates, then momenta, or velocities if L states the
/// problem.
struct FoundCrossing {
  std::string name;
  double t = 0.0;
  int direction = 0;
  std::vector<double> y = {}, quantities = {};
};

/// A step that was taken: the level it led to, and the report of it. One that ends with a reset ends at the crossing.
struct Step {
  double t = 0.0;
  StepReport report;
  std::vector<double> y = {};  ///< what is read of the state of an orbit at t
  std::vector<double> p = {};  ///< its momenta, if L states the problem
  std::vector<FoundCrossing> crossings = {};
  std::vector<std::string> missed = {};  ///< the events that the step left the zero of, and returned through unseen
  bool resets = false;                   ///< the last crossing is one of an event with a reset

  /// \throws py::attribute_error for a lattice
  [[nodiscard]] std::span<const double> state() const {
    if (y.empty()) {
      throw py::attribute_error("a step of a lattice has no state: the integrator has its fields by name");
    }
    return y;
  }
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

/// Looks for the events of a problem along steps.
class Watch {
public:
  explicit Watch(const Problem& problem)
      : problem_(problem),
        writer_(problem),
        reading_(reading_of(problem)),
        layout_(described(writer_)),
        rows_(layout_) {
    for (const std::string& name : writer_.names()) {
      figures_.push_back({name, {}});
      columns_.emplace_back();
      for (std::size_t i = 0; i < layout_.datasets.size(); ++i) {
        const std::string group = "/events/" + name + "/", &path = layout_.datasets[i].path;
        if (path.starts_with(group) && is_kept_whole(layout_.datasets[i])) {
          columns_.back()[path.substr(group.size())] = i;
        }
      }
    }
  }

  /// The conditions with `stop` that hold at the start, as crossings there.
  [[nodiscard]] std::vector<FoundCrossing> begin(std::span<const double> z, double t) {
    writer_.begin(rows_, z, t, figures_);
    return take();
  }
  /// The crossings of a step, in the order of the run.
  [[nodiscard]] std::vector<FoundCrossing> follow(const OutputStep& step) {
    writer_.append(rows_, step, figures_);
    std::vector<FoundCrossing> found = take();
    std::ranges::stable_sort(found, [&](const FoundCrossing& a, const FoundCrossing& b) {
      return step.length() < 0.0 ? a.t > b.t : a.t < b.t;
    });
    return found;
  }

  /// The events that left_and_returned() in the step followed last, which is the first one.
  [[nodiscard]] std::vector<std::string> missed() const {
    std::vector<std::string> names;
    for (const EventFigures& figures : figures_) {
      if (figures.value.returned > 0) {
        names.push_back(figures.name);
      }
    }
    return names;
  }

private:
  static std::optional<Reading> reading_of(const Problem& problem) {
    return problem.hamiltonian() == nullptr ? std::nullopt : std::optional<Reading>(problem);
  }
  static record::Layout described(EventWriter& writer) {
    record::Layout layout;
    writer.describe(layout);
    return layout;
  }

  std::vector<FoundCrossing> take() {
    std::vector<FoundCrossing> found;
    for (std::size_t event = 0; event < columns_.size(); ++event) {
      const std::vector<double>& t = rows_.kept(columns_[event].at("t"));
      for (std::size_t i = 0; i < t.size(); ++i) {
        std::vector<double> z = row(event, "q", i, t.size());
        std::ranges::copy(row(event, "p", i, t.size()), std::back_inserter(z));
        found.push_back({.name = problem_.events[event].name,
                         .t = t[i],
                         .direction = static_cast<int>(row(event, "direction", i, t.size()).front()),
                         .y = reading_ ? (*reading_)(z) : std::vector<double>(),
                         .quantities = row(event, "quantities", i, t.size())});
      }
    }
    rows_.clear();
    return found;
  }
  /// Nothing of what the event has not.
  [[nodiscard]] std::vector<double> row(std::size_t event, const char* name, std::size_t i, std::size_t rows) const {
    const auto column = columns_[event].find(name);
    if (column == columns_[event].end()) {
      return {};
    }
    const std::vector<double>& all = rows_.kept(column->second);
    const auto size = static_cast<std::ptrdiff_t>(all.size() / rows);
    const auto begin = all.begin() + static_cast<std::ptrdiff_t>(i) * size;
    return {begin, begin + size};
  }

  const Problem& problem_;
  EventWriter writer_;
  std::optional<Reading> reading_;
  record::Layout layout_;
  LastRows rows_;
  std::vector<EventFigures> figures_;
  std::vector<std::map<std::string, std::size_t>> columns_;  ///< of each event, by their last names
};

/// Steps a problem by hand.
class Stepper {
public:
  /// \param with_reset the names of the events that end a step where they cross
  Stepper(SharedProblem bound, int threads, std::set<std::string> with_reset)
      : threads_(threads), with_reset_(std::move(with_reset)) {
    begin(std::move(bound));
  }

  /// The next step; nothing at the end of the run. \throws std::runtime_error for a step that cannot be taken
  std::optional<Step> step() {
    const Alone alone(busy_);
    if (simulation_->finished() || !stopped_.empty()) {
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
    taken.t = simulation_->clock();
    if (quick_) {
      const std::span<const double> z = simulation_->last().z_1;
      taken.y = (*reading_)(z);
      if (bound_->problem.hamiltonian()->L) {
        taken.p.assign(z.end() - static_cast<std::ptrdiff_t>(z.size() / 2), z.end());
      }
    }
    if (watch_) {
      find_crossings(taken);
    }
    return taken;
  }

  /// The event that ended the run; empty if none did.
  [[nodiscard]] const std::string& stopped() const { return stopped_; }
  void stop(const std::string& event) { stopped_ = event; }

  [[nodiscard]] std::size_t steps() const { return steps_; }
  /// What `read` reads of the simulation.
  template <typename Read>
  [[nodiscard]] auto read(const Read& read) {
    const Alone alone(busy_);
    return read(*simulation_);
  }

  /// The present state of an orbit: q and p, or q and q̇ if L states the problem.
  [[nodiscard]] Array state() {
    const Alone alone(busy_);
    return array_of((*reading_)(simulation_->last().z_1));
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
    std::vector<std::size_t> shape;
    for (const GridAxis& axis : pde->axes) {
      shape.insert(shape.begin(), static_cast<std::size_t>(axis.nodes()));
    }
    const auto number = static_cast<std::size_t>(place - pde->fields.begin());
    WholeFields whole(make_jumps(bound_->problem), make_grid(bound_->problem), static_cast<int>(pde->fields.size()));
    return Array(shape, whole(static_cast<int>(number), all).data());
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
    if (last.h == 0.0) {
      return array_of((*reading_)(last.z_1));
    }
    const double fraction = fraction_of(last, t);
    if (!(fraction >= -1e-9 && fraction <= 1.0 + 1e-9)) {
      throw std::invalid_argument(
          fmt::format("t = {} is not in the last step, from {} to {}", t, last.begin(), last.end()));
    }
    if (fraction <= 0.0 || fraction >= 1.0) {
      return array_of((*reading_)(fraction <= 0.0 ? last.z_0 : last.z_1));
    }
    if (!between_) {
      between_.emplace(bound_->problem);
    }
    return array_of((*reading_)(between_->at(last, t)));
  }

private:
  void begin(SharedProblem bound) {
    const py::gil_scoped_release released;
    const ThreadCount thread_count(threads_, bound->problem);
    auto simulation = make_simulation(bound->problem);
    static_cast<void>(simulation->node());  // a run begins so, and a scheme may begin from what that computed
    std::optional<Reading> reading;
    if (bound->problem.hamiltonian() != nullptr) {
      reading.emplace(bound->problem);
    }
    std::unique_ptr<Watch> watch;
    std::vector<FoundCrossing> found;
    if (!bound->problem.events.empty()) {
      watch = std::make_unique<Watch>(bound->problem);
      found = watch->begin(simulation->last().z_1, simulation->clock());
    }
    between_.reset();
    reading_ = std::move(reading);
    watch_ = std::move(watch);
    simulation_ = std::move(simulation);  // before the problem that it refers to
    bound_.swap(bound);
    quick_ = false;
    for (const FoundCrossing& crossing : found) {
      count(crossing);
    }
  }

  /// Adds the crossings of a step to it, up to the first one that resets the state.
  void find_crossings(Step& taken) {
    std::vector<FoundCrossing> found;
    {
      const py::gil_scoped_release released;
      found = watch_->follow(simulation_->last());
    }
    if (simulation_->integrator().levels().steps() == 1) {
      taken.missed = watch_->missed();
    }
    for (FoundCrossing& crossing : found) {
      const bool resets = with_reset_.contains(crossing.name);
      count(crossing);
      taken.crossings.push_back(std::move(crossing));
      if (resets) {
        taken.resets = true;
        taken.t = taken.crossings.back().t;
        taken.y = taken.crossings.back().y;
        return;
      }
    }
  }

  /// Ends the run where it is the last crossing of an event with `stop`. Events with a reset do not end it so.
  void count(const FoundCrossing& crossing) {
    const auto event = std::ranges::find(bound_->problem.events, crossing.name, &StatedEvent::name);
    const std::int64_t crossings = ++counts_[crossing.name];
    if (event->stop_after > 0 && crossings >= event->stop_after && !with_reset_.contains(crossing.name) &&
        stopped_.empty()) {
      stopped_ = crossing.name;
    }
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
  std::set<std::string> with_reset_;
  std::atomic<bool> busy_ = false;
  SharedProblem bound_;
  std::unique_ptr<Simulation> simulation_;
  std::optional<Between> between_;
  std::optional<Reading> reading_;  ///< of an orbit
  std::unique_ptr<Watch> watch_;    ///< if there are events
  std::map<std::string, std::int64_t> counts_;
  std::string stopped_;
  std::size_t steps_ = 0;
  bool quick_ = false;  ///< an orbit after its first step, which may look ahead for long
};

/// The states of an orbit between its stored levels, which have to be all of a run.
class DenseOutput {
public:
  /// \param t the times that are read \param y the states that are read at the levels
  DenseOutput(SharedProblem bound, const Array& t, const Array& q, const Array& p, const Array& h, const Array& y)
      : bound_(std::move(bound)),
        t_(t),
        q_(q),
        p_(p),
        h_(h),
        y_(y),
        between_(bound_->problem),
        reading_(bound_->problem) {
    const py::ssize_t levels = t.size();
    if (t.ndim() != 1 || q.ndim() != 2 || p.ndim() != 2 || y.ndim() != 2 || h.ndim() != 1 || q.shape(0) != levels ||
        p.shape(0) != levels || y.shape(0) != levels || h.size() != levels - 1 || q.shape(1) != p.shape(1)) {
      throw std::invalid_argument("dense output takes the states of all levels");
    }
  }

  /// The states at `times`, one row for each. \throws std::invalid_argument for a time outside of the run
  [[nodiscard]] Array at(const Array& times) {
    const auto n = static_cast<std::size_t>(q_.shape(1)), width = static_cast<std::size_t>(y_.shape(1));
    const std::span<const double> t(t_.data(), static_cast<std::size_t>(t_.size()));
    Array states({static_cast<std::size_t>(times.size()), width});
    std::vector<double> z_0(2 * n), z_1(2 * n);
    const bool forward = t.size() < 2 || t.back() > t.front();
    const auto load = [&](std::size_t level, std::span<double> z) {
      const auto row = static_cast<py::ssize_t>(level);
      std::copy_n(q_.data(row, 0), n, z.begin());
      std::copy_n(p_.data(row, 0), n, z.begin() + static_cast<std::ptrdiff_t>(n));
    };
    for (py::ssize_t i = 0; i < times.size(); ++i) {
      const double time = times.data()[i];
      const auto after = forward ? std::upper_bound(t.begin(), t.end(), time)
                                 : std::upper_bound(t.begin(), t.end(), time, std::greater<>());
      auto step = static_cast<std::size_t>(std::max<std::ptrdiff_t>(after - t.begin() - 1, 0));
      step = std::min(step, t.size() < 2 ? 0 : t.size() - 2);
      double* const out = states.mutable_data(i, 0);
      if (t.size() < 2) {
        std::copy_n(y_.data(0, 0), width, out);
        continue;
      }
      const double fraction = (time - t[step]) / (t[step + 1] - t[step]);
      if (!(fraction >= -1e-9 && fraction <= 1.0 + 1e-9)) {
        throw std::invalid_argument(
            fmt::format("t = {} is outside of the run, from {} to {}", time, t.front(), t.back()));
      }
      if (fraction <= 0.0 || fraction >= 1.0) {
        std::copy_n(y_.data(static_cast<py::ssize_t>(fraction <= 0.0 ? step : step + 1), 0), width, out);
        continue;
      }
      load(step, z_0);
      load(step + 1, z_1);
      const OutputStep between{.z_0 = z_0,
                               .z_1 = z_1,
                               .t_0 = t[step],
                               .t_1 = t[step + 1],
                               .h = h_.data()[step],
                               .clock = bound_->problem.clock()};
      std::ranges::copy(reading_(between_.at(between, time)), out);
    }
    return states;
  }

private:
  SharedProblem bound_;
  Array t_, q_, p_, h_, y_;
  Between between_;
  Reading reading_;
};

/// What is read of states (q, p), one row for each.
Array read_states(const BoundProblem& bound, const Array& q, const Array& p) {
  if (q.ndim() != 2 || p.ndim() != 2 || q.shape(0) != p.shape(0) || q.shape(1) != p.shape(1)) {
    throw std::invalid_argument("states are rows of coordinates and of momenta");
  }
  Reading reading(bound.problem);
  const auto n = static_cast<std::size_t>(q.shape(1)), rows = static_cast<std::size_t>(q.shape(0));
  std::vector<double> z(2 * n), all;
  for (std::size_t i = 0; i < rows; ++i) {
    std::copy_n(q.data(static_cast<py::ssize_t>(i), 0), n, z.begin());
    std::copy_n(p.data(static_cast<py::ssize_t>(i), 0), n, z.begin() + static_cast<std::ptrdiff_t>(n));
    std::ranges::copy(reading(z), std::back_inserter(all));
  }
  return Array({rows, rows == 0 ? 2 * n : all.size() / rows}, all.data());
}

/// The next step, after which the integrator itself resets its state if an event asks for it.
std::optional<Step> step_of(Stepper& stepper) {
  std::optional<Step> step = stepper.step();
  if (step && !step->missed.empty()) {
    py::cast(stepper, py::return_value_policy::reference).attr("_warn_of_missed")(step->missed);
  }
  if (step && step->resets) {
    py::cast(stepper, py::return_value_policy::reference).attr("_reset_at")(*step);
  }
  return step;
}

}  // namespace

void define_steps(py::module_& module) {
  py::class_<FoundCrossing>(module, "Crossing")
      .def_readonly("name", &FoundCrossing::name)
      .def_readonly("t", &FoundCrossing::t)
      .def_readonly("direction", &FoundCrossing::direction)
      .def_property_readonly("y", [](const FoundCrossing& crossing) { return array_of(crossing.y); })
      .def_property_readonly("quantities", [](const FoundCrossing& crossing) { return array_of(crossing.quantities); })
      .def("__repr__", [](const FoundCrossing& crossing) {
        return fmt::format("<{} crosses at t = {:.10g}>", crossing.name, crossing.t);
      });
  py::class_<Step>(module, "Step")
      .def_readonly("t", &Step::t)
      .def_property_readonly("h", [](const Step& step) { return step.report.h; })
      .def_property_readonly("energy", [](const Step& step) { return step.report.energy; })
      .def_property_readonly("step_potential", [](const Step& step) { return step.report.potential; })
      .def_property_readonly("iterations", [](const Step& step) { return step.report.iterations; })
      .def_property_readonly("off_law", [](const Step& step) { return step.report.off_law; })
      .def_property_readonly("events", [](const Step& step) { return step.crossings; })
      .def_property_readonly("y", [](const Step& step) { return array_of(step.state()); })
      .def_property_readonly("q", [](const Step& step) { return array_of(step.state().first(step.y.size() / 2)); })
      .def_property_readonly("p", [](const Step& step) {
        return array_of(step.p.empty() ? step.state().last(step.y.size() / 2) : std::span(step.p));
      });
  py::class_<Stepper>(module, "Stepper")
      .def(py::init([](std::shared_ptr<BoundProblem> bound, int threads, std::set<std::string> with_reset) {
             return std::make_unique<Stepper>(std::move(bound), threads, std::move(with_reset));
           }),
           py::arg("problem"), py::arg("threads"), py::arg("with_reset"))
      .def("step", &step_of)
      .def("__next__",
           [](Stepper& stepper) {
             auto step = step_of(stepper);
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
      .def("stop", &Stepper::stop, py::arg("event"))
      .def_property_readonly("stopped", &Stepper::stopped)
      .def_property_readonly("steps", &Stepper::steps)
      .def_property_readonly("t",
                             [](Stepper& stepper) { return stepper.read([](Simulation& s) { return s.clock(); }); })
      .def_property_readonly("finished",
                             [](Stepper& stepper) {
                               return !stepper.stopped().empty() ||
                                      stepper.read([](Simulation& s) { return s.finished(); });
                             })
      .def_property_readonly("h",
                             [](Stepper& stepper) {
                               return stepper.read([](Simulation& s) { return s.integrator().levels().last_step(); });
                             })
      .def_property_readonly(
          "H", [](Stepper& stepper) { return stepper.read([](Simulation& s) { return s.node().energy; }); });
  py::class_<DenseOutput>(module, "DenseOutput")
      .def(py::init(
               [](std::shared_ptr<BoundProblem> bound, const Array& t, const Array& q, const Array& p, const Array& h,
                  const Array& read) { return std::make_unique<DenseOutput>(std::move(bound), t, q, p, h, read); }),
           py::arg("problem"), py::arg("t"), py::arg("q"), py::arg("p"), py::arg("h"), py::arg("y"))
      .def("at", &DenseOutput::at, py::arg("times"));
  module.def("read_states", &read_states, py::arg("problem"), py::arg("q"), py::arg("p"));
}

}  // namespace rubato::python
