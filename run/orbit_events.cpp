#include <algorithm>

#include <rubato/ode/orbit_events.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/reader.hpp>
#include <rubato/run/events.hpp>
#include <rubato/run/orbit_levels.hpp>

namespace rubato {

namespace {

OrbitStep as_orbit(const OutputStep& step) {
  return {.z_0 = step.z_0, .z_1 = step.z_1, .t_0 = step.t_0, .t_1 = step.t_1, .h = step.h};
}

class OrbitEventFinder final : public EventFinder {
public:
  explicit OrbitEventFinder(const Problem& problem)
      : names_(quantity_names(*problem.hamiltonian(), problem.parameters)),
        events_(make_between(problem, "[events] and [section]"), variables(),
                problem.hamiltonian()->L ? std::nullopt : std::optional(make_hamiltonian(problem).without_constant()),
                make_velocities(problem)) {
    for (const StatedEvent& event : problem.events) {
      std::vector<formula::Expression> none;
      events_.add(build_event(event, problem, graph_, none), event.direction);
      std::vector<NamedFormula> quantities;
      for (const OutputQuantity& quantity : event.quantities) {
        quantities.push_back({quantity.name, quantity.formula});
      }
      quantities_.emplace_back(problem, quantities, names_);
    }
  }

  void begin(std::span<const double> z, double t, std::span<double> values) override {
    events_.begin(z, t);
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = events_.value_at_start(i);
    }
  }
  void follow(const OutputStep& step) override { events_.follow(as_orbit(step)); }
  void follow(const OutputStep& step, std::span<const CrossingSearch::Sample> from,
              std::span<const CrossingSearch::Sample> to) override {
    events_.follow(as_orbit(step), from, to);
  }
  [[nodiscard]] const std::vector<Crossing>& crossings(std::size_t event) const override {
    return events_.crossings(event);
  }
  [[nodiscard]] bool undefined(std::size_t event) const override { return events_.undefined(event); }
  [[nodiscard]] bool left_and_returned(std::size_t event) const override { return events_.left_and_returned(event); }

  [[nodiscard]] double time(const OutputStep& step, double fraction) override {
    return step.clock ? events_.state(as_orbit(step), fraction)[*step.clock] : step.time(fraction);
  }

  void describe(std::size_t event, const std::string& group, record::Layout& layout) override {
    const std::string t = group + "/t";
    columns_.resize(std::max(columns_.size(), event + 1));
    columns_[event].q =
        layout.add({group + "/q", t, {"/states/coordinate"}, record::Type::f64, "coordinates at the crossings"});
    columns_[event].p =
        layout.add({group + "/p", t, {"/states/momentum"}, record::Type::f64, "momenta at the crossings"});
  }
  void append(RowSink& sink, std::size_t event, const OutputStep& step, double fraction) override {
    const std::span<const double> z = events_.state(as_orbit(step), fraction);
    state_.assign(z.begin(), z.end());
    const std::size_t n = state_.size() / 2;
    sink.append(columns_[event].q, std::span<const double>(state_).first(n));
    sink.append(columns_[event].p, std::span<const double>(state_).last(n));
  }
  [[nodiscard]] std::vector<double> quantities(std::size_t event, double t) override {
    const std::span<const double> values = quantities_[event](events_.arguments(state_, t));
    return {values.begin(), values.end()};
  }

  void save(StateWriter& state) const override { events_.save(state); }
  void restore(StateReader& state) override { events_.restore(state); }

private:
  [[nodiscard]] std::vector<formula::Expression> variables() {
    std::vector<formula::Expression> variables;
    for (const std::string& name : names_) {
      variables.push_back(graph_.variable(name));
    }
    return variables;
  }

  std::vector<std::string> names_;
  formula::Graph graph_;
  OrbitEvents events_;
  std::vector<FormulaTable> quantities_;
  std::vector<double> state_;
  struct Columns {
    record::Column q, p;
  };
  std::vector<Columns> columns_;  ///< of each event
};

}  // namespace

std::unique_ptr<EventFinder> make_orbit_events(const Problem& problem) {
  return std::make_unique<OrbitEventFinder>(problem);
}

}  // namespace rubato
