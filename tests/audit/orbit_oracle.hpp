#pragma once

#include <optional>
#include <span>
#include <vector>

#include "audit/lagrange_oracle.hpp"
#include "audit/orbit_problem.hpp"
#include "audit/quadrature.hpp"
#include "audit/series.hpp"
#include "audit/step_findings.hpp"

namespace audit {

/// The equations of an orbit's scheme, evaluated in extended precision from the expressions that the problem was made
/// of, with a bound of the rounding error of each in double. Generating functions come from the recursion (4.10) of
/// Hamilton and Jacobi, in power series of the state and the time: not the way the library has them. The stages of
/// Gauss collocation are found again from z_k and h, by Newton's method in extended precision.
class OrbitOracle {
public:
  explicit OrbitOracle(const OrbitProblem& problem);

  /// \param time_rounding what t_1 - t_0 may be off h by
  [[nodiscard]] OrbitStep step(std::span<const double> z_0, std::span<const double> z_1, double h,
                               long double time_rounding) const;
  [[nodiscard]] Bounded node_energy(std::span<const double> z) const;
  /// What the tolerance is relative to: |H| without added constants, or 3 % of the sum of the magnitudes of its terms.
  [[nodiscard]] long double scale(std::span<const double> z) const;
  /// Γ, or what stands for it; nothing for Lagrangians that are not generating functions.
  [[nodiscard]] std::optional<Bounded> gamma(std::span<const double> z) const;
  [[nodiscard]] std::vector<Bounded> invariants(std::span<const double> z) const;
  /// What stored velocities leave of ∂L/∂q̇ = p; nothing for problems stated by H.
  [[nodiscard]] std::vector<Bounded> momentum_defect(std::span<const double> z) const;
  /// dE/dh along steps of other lengths from z_0, by the difference of two of them; nothing where it cannot be had.
  [[nodiscard]] std::optional<long double> slope(std::span<const double> z_0, std::span<const double> z_1,
                                                 double h) const;
  /// Multiplications of numbers that one step takes, roughly.
  [[nodiscard]] double cost() const;

private:
  /// φ_t(w + u, t) as a series in u and t, and ∇φ.
  struct Generated {
    Series rate;
    std::vector<Series> gradient;
  };
  [[nodiscard]] Generated generate(std::span<const Bounded> w, std::size_t degree) const;
  [[nodiscard]] OrbitStep generated_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const;
  [[nodiscard]] OrbitStep varied_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const;
  [[nodiscard]] OrbitStep collocated_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const;
  [[nodiscard]] OrbitStep composed_step(std::span<const Bounded> z_0, std::span<const Bounded> z_1, Bounded h) const;
  /// J∇H, and its derivatives row by row.
  [[nodiscard]] std::vector<Bounded> velocity(std::span<const Bounded> z, std::vector<long double>& slopes) const;
  [[nodiscard]] std::size_t terms() const;  ///< s, of Φ_s

  const OrbitProblem& problem_;
  std::optional<LagrangeOracle> by_L_;
  std::optional<Quadrature> collocation_;
};

}  // namespace audit
