#pragma once

#include <memory>
#include <span>

#include <rubato/ode/orbit_methods.hpp>

namespace rubato {

/// The tangent of an orbit's step at frozen levels, from the two levels of the step and its length alone: a run, its
/// continuation and the check of its record make it of the same numbers by the same code.
///
/// - Of a one-step map, ∂ψ_h/∂z (OneStepScheme::tangent()), on variations (δq, δp).
/// - Of the two-step map of an action (forward and custom 𝕃, starting pairs), on variations (δz_k, δP_k), with
///   P_k = ∂A_{k-1}/∂z_k, by its second variation: A_01 δz_{k+1} = -δP_k - A_00 δz_k, δP_{k+1} = A_10 δz_k + A_11
///   δz_{k+1}.
///
/// Both preserve Σ dp∧dq of their variables, which of the two-step map is Σ dP∧dz (theory, section 2.3).
///
/// *Frozen levels.* h is not varied, whatever chose it. The map of variable levels at one E is ψ_h with h = h(z): its
/// tangent adds ∂_hψ ∂h/∂z, a variation along the orbit, which only moves the neighbour in time, and which is
/// unbounded where the level equation degenerates, ∂h/∂z ~ 1/(hΓ) (theory, sections 2.3 and 3). Variations at equal
/// times, which the exponents of the flow are about, are those of ψ_h; and it is ψ_h that preserves dp∧dq at all z,
/// not on one level set of E alone.
class OrbitTangent {
public:
  virtual ~OrbitTangent() = default;

  /// Entries of a variation: 2n, or 4n of a two-step map.
  [[nodiscard]] virtual std::size_t size() const = 0;
  /// The variation, at the start of the first step, that a variation of z_0 is: the same, with constraints its
  /// projection on variations of constrained states, or with the δP_0 of a z_1 that goes along as by a midpoint step.
  /// \param from columns of 2n entries, `to` as many of size()
  [[nodiscard]] virtual Status lift(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h,
                                    std::span<const double> from, std::span<double> to) = 0;
  /// Replaces each of the columns, size() entries one after the other, by its image under the tangent of the step from
  /// z_0 at t_0 to z_1.
  [[nodiscard]] virtual Status step(std::span<const double> z_0, std::span<const double> z_1, double t_0, double h,
                                    std::span<double> columns) = 0;

  /// What other steps left to begin from: after restore() the next one is the same to the bit.
  ///@{
  virtual void save(StateWriter& /*state*/) const {}
  virtual void restore(StateReader& /*state*/) {}
  ///@}
};

/// \param starting_pair whether the run began from one, and so goes by the two-step map
/// \throws std::invalid_argument as the scheme's own function, if it does not take z_0
[[nodiscard]] std::unique_ptr<OrbitTangent> make_orbit_tangent(const Hamiltonian& hamiltonian,
                                                               const SegmentLagrangian& lagrangian, bool starting_pair,
                                                               std::span<const double> z_0);
/// Of a one-step map.
[[nodiscard]] std::unique_ptr<OrbitTangent> make_orbit_tangent(std::unique_ptr<OneStepScheme> map);

}  // namespace rubato
