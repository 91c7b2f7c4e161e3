#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/ode/orbit_between.hpp>
#include <rubato/variation/crossing.hpp>

namespace rubato {

/// A step of an orbit: the states at both ends, and what h was; t_1 is t_0 + h to rounding.
struct OrbitStep {
  std::span<const double> z_0, z_1;
  double t_0 = 0.0, t_1 = 0.0;
  double h = 0.0;

  [[nodiscard]] double time(double fraction) const {
    return fraction == 0.0 ? t_0 : fraction == 1.0 ? t_1 : t_0 + fraction * h;
  }
};

/// Zeros of formulas g(q, p, t) along an orbit, located on its dense output (OrbitBetween) to rounding, so that their
/// times are off by what the orbit is off by: as its scheme's order says.
///
/// What is found in a step follows from its two levels, and from what save() writes of the steps before.
class OrbitEvents {
public:
  /// `arguments`: the variables of all formulas: coordinates, velocities where `velocities` shows them, momenta, and t,
  /// unless that is one of the coordinates.
  /// `rates`: of the Hamiltonian, for an orbit that is stated by one; null otherwise.
  OrbitEvents(OrbitBetween between, std::vector<formula::Expression> arguments, std::optional<Hamiltonian> rates,
              std::unique_ptr<OneStepScheme> velocities);

  /// Another one, of the graph of the arguments; crossings in the other direction are not looked for.
  /// \throws std::invalid_argument if g depends on something else
  void add(formula::Expression g, Direction direction);
  [[nodiscard]] std::size_t size() const { return events_.size(); }

  void begin(std::span<const double> z, double t);
  /// All of a step: what is reported below is then of it.
  void follow(const OrbitStep& step);
  /// The same, where g and its rate, dg/dfraction, at both levels are known of every event.
  void follow(const OrbitStep& step, std::span<const CrossingSearch::Sample> from,
              std::span<const CrossingSearch::Sample> to);

  [[nodiscard]] const std::vector<Crossing>& crossings(std::size_t event) const { return *events_[event].found; }
  /// True if g was not a number somewhere in the step.
  [[nodiscard]] bool undefined(std::size_t event) const { return events_[event].search.undefined(); }
  /// True if a crossing of the step, the first one, was missed (CrossingSearch).
  [[nodiscard]] bool left_and_returned(std::size_t event) const { return events_[event].search.left_and_returned(); }
  /// g at the last state that was looked at by begin().
  [[nodiscard]] double value_at_start(std::size_t event) const { return events_[event].first; }
  /// z at a fraction of a step. Not a number where it cannot be reported. Valid until the next call.
  [[nodiscard]] std::span<const double> state(const OrbitStep& step, double fraction);
  /// What formulas are given at a state. Valid until the next call.
  [[nodiscard]] std::span<const double> arguments(std::span<const double> z, double t);

  void save(StateWriter& state) const;
  void restore(StateReader& state);

private:
  struct Event {
    CrossingSearch search;
    formula::ScalarEvaluator g;  ///< and its derivatives by the arguments, where rates are known
    CrossingSearch::Sample from{}, to{};
    const std::vector<Crossing>* found = nullptr;
    double first = 0.0;
  };

  void search(const OrbitStep& step);
  [[nodiscard]] CrossingSearch::Sample sample(Event& event, double h, double fraction);

  OrbitBetween between_;
  std::vector<formula::Expression> variables_;
  std::optional<HamiltonianEvaluator> rates_;
  std::unique_ptr<OneStepScheme> velocities_;
  std::vector<Event> events_;
  std::vector<double> z_, arguments_, gradient_;
};

}  // namespace rubato
