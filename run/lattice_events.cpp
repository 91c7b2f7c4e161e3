#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <rubato/pde/lattice_between.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/run/events.hpp>
#include <rubato/run/lattice_quantity.hpp>

namespace rubato {

namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// An event of a lattice: g is a number, made of integrals, of fields at a point and of t. Its rates are not known.
class LatticeEvent {
public:
  LatticeEvent(const Problem& problem, const StatedEvent& event, const MultisymplecticSystem& system,
               const grids::Grid& grid)
      : search_(event.direction) {
    const auto number = [&](const OutputQuantity& quantity) {
      LatticeQuantity made(problem, quantity, system, grid);
      if (made.is_field()) {
        throw ProblemError(quantity.formula.location,
                           fmt::format("\"{}\" differs from node to node, and an event is of one number: take its "
                                       "integral(...), or say where with at = {{ x = ... }}",
                                       quantity.formula.text.substr(0, 100)));
      }
      return made;
    };
    const auto side = [&](const FormulaText& text) {
      return number({.name = event.name, .formula = text, .at = event.at, .location = event.location});
    };
    sides_.push_back(side(event.crossing));
    if (event.less) {
      sides_.push_back(side(*event.less));
    }
    for (const OutputQuantity& quantity : event.quantities) {
      quantities_.push_back(number(quantity));
    }
  }

  [[nodiscard]] double value(const LatticeLevel& level, double t) {
    const double first = sides_.front().at(level, t).front();
    return sides_.size() == 1 ? first : first - sides_.back().at(level, t).front();
  }
  [[nodiscard]] std::vector<double> quantities(const LatticeLevel& level, double t) {
    std::vector<double> values;
    for (LatticeQuantity& quantity : quantities_) {
      values.push_back(quantity.at(level, t).front());
    }
    return values;
  }
  [[nodiscard]] CrossingSearch& search() { return search_; }
  [[nodiscard]] const CrossingSearch& search() const { return search_; }

  const std::vector<Crossing>* found = nullptr;

private:
  CrossingSearch search_;
  std::vector<LatticeQuantity> sides_, quantities_;
};

class LatticeEventFinder final : public EventFinder {
public:
  explicit LatticeEventFinder(const Problem& problem)
      : system_(make_system(problem)),
        grid_(present_grid(problem)),
        method_(make_method(problem)),
        level_(make_initial_level(problem, system_, grid_)),
        next_(level_),
        between_(*method_, system_, grid_, level_,
                 problem.scheme.step.value_or(problem.scheme.until < problem.start() ? -1.0 : 1.0)) {
    for (const StatedEvent& event : problem.events) {
      events_.emplace_back(problem, event, system_, grid_);
    }
  }

  void begin(std::span<const double> z, double t, std::span<double> values) override {
    std::ranges::copy(z, level_.fields.all().begin());
    for (std::size_t i = 0; i < events_.size(); ++i) {
      values[i] = events_[i].value(level_, t);
      events_[i].search().begin(values[i]);
    }
  }

  void follow(const OutputStep& step) override {
    load(step);
    for (LatticeEvent& event : events_) {
      const auto between = [&](double fraction) -> CrossingSearch::Sample {
        const bool known = between_.take(level_, next_, step.t_0, step.h, fraction) == Status::success;
        return {fraction, known ? event.value(between_.level(), step.time(fraction)) : unknown};
      };
      event.found = &event.search().follow(step.h, {0.0, event.value(level_, step.t_0)},
                                           {1.0, event.value(next_, step.t_1)}, between);
    }
  }
  [[nodiscard]] const std::vector<Crossing>& crossings(std::size_t event) const override {
    return *events_[event].found;
  }
  [[nodiscard]] bool undefined(std::size_t event) const override { return events_[event].search().undefined(); }
  [[nodiscard]] bool left_and_returned(std::size_t event) const override {
    return events_[event].search().left_and_returned();
  }

  void describe(std::size_t /*event*/, const std::string& /*group*/, record::Layout& /*layout*/) override {}
  void append(RowSink& /*sink*/, std::size_t /*event*/, const OutputStep& step, double fraction) override {
    load(step);
    // What fails is not a number.
    static_cast<void>(between_.take(level_, next_, step.t_0, step.h, fraction));
  }
  [[nodiscard]] std::vector<double> quantities(std::size_t event, double t) override {
    return events_[event].quantities(between_.level(), t);
  }

  void save(StateWriter& state) const override {
    for (const LatticeEvent& event : events_) {
      event.search().save(state);
    }
  }
  void restore(StateReader& state) override {
    for (LatticeEvent& event : events_) {
      event.search().restore(state);
    }
  }

private:
  void load(const OutputStep& step) {
    std::ranges::copy(step.z_0, level_.fields.all().begin());
    std::ranges::copy(step.z_1, next_.fields.all().begin());
  }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  std::unique_ptr<LatticeMethod> method_;
  LatticeLevel level_, next_;
  LatticeBetween between_;
  std::vector<LatticeEvent> events_;
};

}  // namespace

std::unique_ptr<EventFinder> make_lattice_events(const Problem& problem) {
  return std::make_unique<LatticeEventFinder>(problem);
}

}  // namespace rubato
