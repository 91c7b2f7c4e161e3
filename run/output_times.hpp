#pragma once

#include <cmath>
#include <cstddef>
#include <optional>

#include <rubato/problem/problem.hpp>

namespace rubato {

/// The times at which a problem's [output] tells states and quantities, whatever the levels are.
class OutputTimes {
public:
  explicit OutputTimes(const Problem& problem)
      : output_(problem.output),
        start_(problem.start()),
        direction_(problem.scheme.until < problem.start() ? -1.0 : 1.0) {}

  /// The one of number `i` if the run has come to it with the step of length h to level t; h = 0 at the start. A time
  /// that a step misses by rounding, as the end of a run may be missed, counts as met. An interval goes on past the end
  /// of the run, to its last level: the run may be resumed.
  [[nodiscard]] std::optional<double> due(std::size_t i, double t, double h) const {
    constexpr double slack = 2e-9;
    double time = 0.0;
    if (output_.interval) {
      time = start_ + static_cast<double>(i) * (direction_ * *output_.interval);
    } else if (i < output_.times.size()) {
      time = output_.times[i];
    } else {
      return std::nullopt;
    }
    return direction_ * (time - t) <= slack * std::abs(h) ? std::optional(time) : std::nullopt;
  }

private:
  const Output& output_;
  double start_, direction_;
};

}  // namespace rubato
