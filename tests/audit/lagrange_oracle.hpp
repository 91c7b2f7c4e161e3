#pragma once

#include <optional>
#include <span>
#include <vector>

#include "audit/orbit_problem.hpp"
#include "audit/quadrature.hpp"
#include "audit/series.hpp"
#include "audit/step_findings.hpp"

namespace audit {

/// The equations of problems stated by L(q, q̇) (theory, section 7), evaluated in extended precision with a bound of
/// the rounding error of each in double. The polynomial of each step is found again from z_k and h, by Newton's method
/// in extended precision. States are (q, p, q̇).
class LagrangeOracle {
public:
  explicit LagrangeOracle(const OrbitProblem& problem);

  [[nodiscard]] OrbitStep step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const;
  /// p·q̇ - L
  [[nodiscard]] Bounded node_energy(std::span<const Bounded> z) const;
  /// |E| without added constants, or 3 % of the sum of the magnitudes of its terms.
  [[nodiscard]] long double scale(std::span<const Bounded> z) const;
  /// ∂L/∂q̇ - p
  [[nodiscard]] std::vector<Bounded> momentum_defect(std::span<const Bounded> z) const;
  /// fᵀH_zz f, of the midpoint alone
  [[nodiscard]] std::optional<Bounded> gamma(std::span<const Bounded> z) const;
  [[nodiscard]] double cost() const { return 3e5 * static_cast<double>(degree_); }

private:
  /// L and its derivatives at (q, q̇).
  [[nodiscard]] Series expand(std::span<const Bounded> q, std::span<const Bounded> velocity, std::size_t degree) const;

  const OrbitProblem& problem_;
  std::size_t n_, degree_;
  Quadrature rule_, control_;
  std::vector<std::vector<Bounded>> values_, rates_;  ///< of the control polynomial i at node j: [j][i]
};

}  // namespace audit
