#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "../cpu_clock.hpp"
#include "../work.hpp"
#include "extrapolation.hpp"
#include "systems.hpp"

/// \file
/// A problem with its solution, and what a peer's run is made of.

namespace orbits {

using comparison::Class;
using comparison::Method;
using comparison::Outcome;

/// A state in doubles.
template <typename System>
struct State {
  std::vector<double> q, p;
  State() : q(System::n), p(System::n) { System::start(q.data(), p.data()); }
};

/// The solution at `until` and for a while after it, by extrapolation in extended precision.
template <typename System>
class Reference {
public:
  /// \param steps 0 where no positions are asked for
  Reference(double until, int steps) : until_(until), step_(until / steps) {
    if (steps == 0) {
      return;
    }
    const State<System> start;
    const auto run = [&](int n) {
      Extended state{{start.q.begin(), start.q.end()}, {start.p.begin(), start.p.end()}};
      for (int i = 0; i < n; ++i) {
        extrapolate<System>(state.q, state.p, static_cast<long double>(until) / n);
        scale_ = std::max(scale_, norm(state.q));
      }
      return state;
    };
    end_ = run(steps);
    const Extended rough = run(steps / 2);
    uncertainty_ = distance(rough.q, end_.q) / scale_;
  }

  /// |q - q(t)| beside the largest |q|, Euclidean.
  [[nodiscard]] double error(const double* q, double t) const {
    if (end_.q.empty()) {
      return 0.0;
    }
    Extended there = end_;
    const long double later = static_cast<long double>(t) - until_;
    if (!std::isfinite(t)) {
      return std::numeric_limits<double>::infinity();
    }
    if (later != 0) {
      const int steps = 1 + static_cast<int>(std::abs(static_cast<double>(later)) / step_);
      for (int i = 0; i < steps; ++i) {
        extrapolate<System>(there.q, there.p, later / steps);
      }
    }
    const double error = distance(std::vector<long double>(q, q + System::n), there.q) / scale_;
    return std::isfinite(error) ? error : std::numeric_limits<double>::infinity();
  }
  /// Difference from half as many steps.
  [[nodiscard]] double uncertainty() const { return uncertainty_; }

private:
  struct Extended {
    std::vector<long double> q, p;
  };
  static double norm(const std::vector<long double>& x) {
    long double sum = 0;
    for (const long double one : x) {
      sum += one * one;
    }
    return static_cast<double>(std::sqrt(sum));
  }
  static double distance(std::vector<long double> x, const std::vector<long double>& y) {
    for (std::size_t i = 0; i < x.size(); ++i) {
      x[i] -= y[i];
    }
    return norm(x);
  }

  double until_, step_;
  Extended end_;
  double scale_ = 0.0, uncertainty_ = 0.0;
};

/// Of a run that nobody waits for: a tolerance below rounding, above all.
struct TooLong {};

/// Looks at nodes, or does not.
template <typename System>
class Watch {
public:
  static constexpr bool active = true;
  explicit Watch(double longest) : deadline_(peers::cpu_seconds() + longest) {
    const State<System> start;
    first_ = System::energy(start.q.data(), start.p.data());
  }
  void operator()(const double* q, const double* p) {
    const double error = std::abs(System::energy(q, p) - first_);
    worst_ = error <= worst_ ? worst_ : error;
    if (++nodes_ % 1024 == 0 && peers::cpu_seconds() > deadline_) {
      throw TooLong();
    }
  }
  /// max |H(z_k) - H(z_0)| beside |H(z_0)|
  [[nodiscard]] double worst() const {
    return std::isfinite(worst_) ? worst_ / std::abs(first_) : std::numeric_limits<double>::infinity();
  }

private:
  double deadline_, first_ = 0.0, worst_ = 0.0;
  long nodes_ = 0;
};
struct NoWatch {
  static constexpr bool active = false;
  void operator()(const double*, const double*) const {}
};

/// CPU time and number of the steps of a run, and where it ended, in time.
struct Taken {
  double seconds = 0.0;
  long steps = 0;
  double t = 0.0;
};

/// A problem as peers have it.
template <typename System>
struct Case {
  double until = 0.0;
  Reference<System> reference;
  double longest = 0.5;  ///< seconds of a run that is looked at

  Case(double time, int reference_steps) : until(time), reference(time, reference_steps) {}

  /// \param run `Taken run(int effort, double until, State& state, auto& watch)`
  template <typename Run>
  [[nodiscard]] Method method(std::string name, Class kind, int first, Run run) const {
    return {std::move(name), kind, 0, first, [this, run](int effort, bool timed_only) mutable {
              Outcome outcome;
              const auto failed = [&] {
                outcome.seconds = std::numeric_limits<double>::infinity();
                outcome.errors.fill(outcome.seconds);
                return outcome;
              };
              if (!timed_only) {
                State<System> state;
                Watch<System> watch(longest);
                try {
                  const Taken taken = run(effort, until, state, watch);
                  if (!std::isfinite(taken.seconds)) {
                    return failed();
                  }
                  outcome.errors = {watch.worst(), reference.error(state.q.data(), taken.t)};
                } catch (const TooLong&) {
                  return failed();
                }
              }
              State<System> state;
              NoWatch none;
              const Taken taken = run(effort, until, state, none);
              outcome.seconds = taken.seconds;
              outcome.steps = taken.steps;
              return outcome;
            }};
  }
};

/// The tolerance of an effort: n^-4.
[[nodiscard]] inline double tolerance_of(int effort) {
  return std::pow(static_cast<double>(effort), -4.0);
}

/// x ← x + d, x being given in two parts.
inline void add(double& x, double& rest, double d) {
  const double y = d + rest, sum = x + y;
  rest = y - (sum - x);
  x = sum;
}

}  // namespace orbits
