#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include <rubato/base/state.hpp>

namespace rubato {

/// What Newton's method has shown of its convergence: near the solution the corrections of a step obey
///
///     |c_{j+1}| ≤ κ |c_j|²,      κ ~ (h²/8) |S'''| |δ| for a lattice,
///
/// sizes relative to the increment δ. The error after a correction is the size of the next one, so that with a measured
/// κ the iteration ends without the correction that would only show how small it is. κ is a property of the solution
/// and the step, and both change slowly: a measurement serves the following levels, with a margin that grows from level
/// to level until it takes another one, up to κ = 1 where what was measured is less. Without any, κ = 1.
class NewtonContraction {
public:
  /// The error, relative, that a correction of this size leaves in a step of length h.
  [[nodiscard]] double error_after(double size, double h) const {
    const double growth = std::max(1.0, std::abs(h / measured_h_));
    const double kappa = kappa_ * growth * growth * growth;
    return std::min(margin_ * kappa, std::max(1.0, first_margin * kappa)) * size * size;
  }

  /// Two successive corrections of a step of length h.
  void observe(double size, double next, double h) {
    const double kappa = std::max(next, rounding) / (size * size);
    // A next one of the size of rounding errors gives an upper bound only.
    if (next > rounding || kappa < margin_ * kappa_) {
      kappa_ = kappa;
      measured_h_ = h;
      margin_ = first_margin;
    }
  }

  /// On to the next level.
  void advance() { margin_ = std::min(2.0 * margin_, 1.0 / std::numeric_limits<double>::epsilon()); }

  void save(StateWriter& state) const {
    state.write(kappa_);
    state.write(measured_h_);
    state.write(margin_);
  }
  void restore(StateReader& state) {
    state.read(kappa_);
    state.read(measured_h_);
    state.read(margin_);
  }

private:
  static constexpr double rounding = 16.0 * std::numeric_limits<double>::epsilon();
  static constexpr double first_margin = 4.0;

  double kappa_ = 1.0;
  double measured_h_ = std::numeric_limits<double>::infinity();
  double margin_ = 1.0;
};

}  // namespace rubato
