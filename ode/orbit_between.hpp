#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <rubato/ode/integrate.hpp>

namespace rubato {

/// The state of an orbit between two levels of a run, to the order of its scheme and continuous from step to step:
///
/// - of a scheme with a one-step production form its own step over the fraction, ψ_{θh}(z_k): symplectic, and as far
///   from the orbit as the levels are. (The collocation polynomial of m Gauss stages would be of order m + 1 only.)
/// - of a two-step form that goes along with a parasite, z_{k+1} ≠ ψ_h(z_k), the same and the share θ of what is
///   missing: z(θ) = ψ_{θh}(z_k) + θ (z_{k+1} - ψ_h(z_k));
/// - of other two-step forms (forward and custom 𝕃) the cubic of Hermite with J∇H at both levels, off by O(h⁴).
///
/// It reads two levels and h alone, so that what a run shows can be recomputed from its record.
class OrbitBetween {
public:
  /// \param starting_pair whether the run began from one, and so has a parasite
  /// \throws std::invalid_argument as the scheme's own function, if it does not take z_0
  OrbitBetween(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian, bool starting_pair,
               std::span<const double> z_0);

  /// Of a one-step map.
  OrbitBetween(std::unique_ptr<OneStepScheme> map, std::size_t dimension);

  /// z at t_k + fraction·h into `out`, 2n entries each. On failure `out` is not a number.
  [[nodiscard]] Status at(std::span<const double> z_k, std::span<const double> z_next, double h, double fraction,
                          std::span<double> out);

  /// What other steps left to begin from: after restore() the next state is the same to the bit.
  ///@{
  void save(StateWriter& state) const;
  void restore(StateReader& state);
  ///@}

private:
  [[nodiscard]] Status step(std::span<const double> z, double h, std::span<double> out);
  [[nodiscard]] Status hermite(std::span<const double> z_k, std::span<const double> z_next, double h, double fraction,
                               std::span<double> out);

  std::unique_ptr<OneStepScheme> map_;  ///< none for Hermite's cubic
  std::optional<HamiltonianEvaluator> hamiltonian_;
  bool has_parasite_;
  std::vector<double> whole_, first_, last_;
};

}  // namespace rubato
