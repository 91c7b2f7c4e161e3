#pragma once

#include <memory>
#include <span>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/ode/orbit_methods.hpp>

namespace rubato {

/// What a segment contributes to the stationarity of 𝕊 = Σ A(z_k, z_{k+1}, h_k), linearised: values and derivatives in
/// both its nodes and its length.
struct SegmentRows {
  Eigen::VectorXd value;
  Eigen::MatrixXd by_0, by_1;
  Eigen::VectorXd by_h;
  double energy = 0.0;  ///< E = -∂A/∂h
  Eigen::VectorXd energy_by_0, energy_by_1;
  double energy_by_h = 0.0;
};

/// The equations of one segment between two nodes z_0 and z_1 at distance h, for boundary-value problems. There are two
/// kinds.
///
/// A family with a generating function Φ of normal Darboux type F (theory, section 4; midpoint, Gauss collocation,
/// generating functions): `value` is the defect of the step, of 2n entries,
///
///     d = J(z_1 - z_0) - ∇Φ(w, h),   w = (z_0 + z_1)/2 + ½JF(z_1 - z_0),   E = -∂_hΦ(w, h).
///
/// Stationarity at node k is (I + FJ) d_k + (I - FJ) d_{k-1} = 0. All d_k = 0 solves it without the parasite
/// d_k = (-1)^k d_0, which the ends would have to exclude otherwise.
///
/// A map with constraints is of the same kind, d = J(z_1 - ψ_h(z_0)): its multipliers are solved for within the step.
///
/// Any other action of a segment (forward, custom): `value` has 4n entries, ∂A/∂z_0 and ∂A/∂z_1, to be summed at
/// interior nodes. All 2n numbers of both end nodes have to be given.
///
/// An object holds its own work space: use one per thread.
class SegmentEquation {
public:
  virtual ~SegmentEquation() = default;
  /// Status::undefined where H is not defined, or the status of the equations of the stages.
  virtual Status evaluate(std::span<const double> z_0, std::span<const double> z_1, double h, SegmentRows& rows) = 0;
  /// True for the second kind.
  [[nodiscard]] virtual bool is_action() const { return false; }
  /// The order s of the scheme.
  [[nodiscard]] virtual int order() const = 0;

  /// δz_1 = S δz_0 of a step of fixed length, S = -(∂d/∂z_1)⁻¹ ∂d/∂z_0; it is symplectic.
  /// \return nothing where ∂d/∂z_1 is singular. Precondition: not is_action()
  [[nodiscard]] static std::optional<Eigen::MatrixXd> tangent(const SegmentRows& rows);
};

/// \throws std::invalid_argument for what has neither a generating function nor an action (explicit splittings,
/// quadratures of L), and for an action that depends on t_0 and t_1 otherwise than by t_1 - t_0
[[nodiscard]] std::unique_ptr<SegmentEquation> make_segment_equation(const Hamiltonian& hamiltonian,
                                                                     const SegmentLagrangian& lagrangian);

}  // namespace rubato
