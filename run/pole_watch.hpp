#pragma once

#include <span>
#include <vector>

#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// Looks for steps of an orbit over a pole of H, or of what L has without velocities: where a divisor changes its sign
/// and the energy is far above that of both ends in between. No motion goes there, and no figure of the scheme need
/// show it, since the levels are far from the pole: H = p²/2 + 10⁻⁶/q² reflects what steps of 0.1 go through.
class PoleWatch {
public:
  explicit PoleWatch(const Problem& problem);

  /// False where no divisor changes its sign.
  [[nodiscard]] bool looks() const { return !divisors_.empty(); }
  /// Whether the straight line from one level to the next, z = (q, p), meets a pole.
  [[nodiscard]] bool crosses(std::span<const double> from, std::span<const double> to);

private:
  /// Whether the energy grows towards the zero that a divisor has on the line.
  [[nodiscard]] bool is_pole(std::span<const double> from, std::span<const double> to, std::size_t divisor);

  std::vector<FormulaTable> divisors_;  ///< one, or none
  std::vector<FormulaTable> energy_;    ///< likewise
  std::vector<double> before_, point_;
};

}  // namespace rubato
