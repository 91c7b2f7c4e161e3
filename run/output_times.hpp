#pragma once

#include <cmath>
#include <cstddef>
#include <optional>

#include <rubato/problem/problem.hpp>

namespace rubato {

/// The times at which a problem's [output] shows states and quantities, whatever the levels are.
class OutputTimes {
public:
  explicit OutputTimes(const Problem& problem)
      : output_(problem.output),
        start_(problem.clock_start()),
        direction_(problem.scheme.until < problem.start() ? -1.0 : 1.0) {}

  /// The one of number `i`. An interval goes on past the end of the run, to its last level: the run may be resumed.
  [[nodiscard]] std::optional<double> time(std::size_t i) const {
    if (output_.interval) {
      return start_ + static_cast<double>(i) * (direction_ * *output_.interval);
    }
    return i < output_.times.size() ? std::optional(output_.times[i]) : std::nullopt;
  }

  /// The same if the run has come to it with the step of length h to level t; h = 0 at the start. A time that a step
  /// misses by rounding, as the end of a run may be missed, counts as met.
  [[nodiscard]] std::optional<double> due(std::size_t i, double t, double h) const {
    constexpr double slack = 2e-9;
    const std::optional<double> one = time(i);
    return one && direction_ * (*one - t) <= slack * std::abs(h) ? one : std::nullopt;
  }

private:
  const Output& output_;
  double start_, direction_;
};

}  // namespace rubato
