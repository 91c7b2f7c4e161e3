#pragma once

#include <complex>
#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include <rubato/ode/stationary_action.hpp>

namespace rubato {

/// What the second variation of 𝕊 at a stationary orbit shows, levels held: the tangents S_k of its steps,
/// δz_{k+1} = S_k δz_k, as blocks of the second variation in the q alone. With S = [[A, B], [C, D]], p_0 = -∂_0 L_d and
/// p_1 = ∂_1 L_d,
///
///     ∂²L_d/∂q_0² = B⁻¹A,   ∂²L_d/∂q_1² = D B⁻¹,   ∂²L_d/∂q_0∂q_1 = -B⁻¹,
///
/// so that the second variation is block tridiagonal (of a periodic orbit cyclic), with n × n blocks.
class SecondVariation {
public:
  /// \throws std::invalid_argument for a discretisation that is no one-step map, or where a step has no tangent
  SecondVariation(SegmentEquation& segments, const NodesOfOrbit& orbit);

  /// S_{N-1} … S_0.
  [[nodiscard]] const Eigen::MatrixXd& monodromy() const { return products_.back(); }

  /// The eigenvalues of the monodromy matrix, in descending order of their size: of a periodic orbit its Floquet
  /// multipliers. They come in pairs λ, 1/λ; of a periodic orbit of an autonomous H two are 1, and two more for every
  /// continuous symmetry. A multiple one is found to about the root of rounding.
  [[nodiscard]] std::vector<std::complex<double>> multipliers() const;

  /// True if the Legendre condition holds along the orbit: B_k/h_k is positive definite for every k (H_pp is, for steps
  /// that are short). Otherwise the index grows with the number of steps and says nothing of the orbit, and the next
  /// two return nothing.
  [[nodiscard]] bool is_legendre() const { return legendre_; }

  /// The number of negative eigenvalues of the second variation: with fixed q at both ends, the sum of the
  /// multiplicities of the conjugate points inside (Morse's theorem).
  [[nodiscard]] std::optional<std::size_t> index_of_fixed_ends() const;
  /// The same of the cyclic one, with the q of a periodic orbit; eigenvalues that vanish (phase and symmetries) do not
  /// count.
  [[nodiscard]] std::optional<std::size_t> index_of_periodic() const;

  /// Times t - t_0 at which a variation that vanishes at the start vanishes again: zeros of det ∂q(t)/∂p(0), located by
  /// a cubic through the nodes around them, which holds to O(h⁴). A zero at the end itself is one, too; of two in one
  /// step none is found.
  [[nodiscard]] std::vector<double> conjugate_points() const;

private:
  [[nodiscard]] Eigen::Index degrees() const { return products_.back().rows() / 2; }

  std::vector<Eigen::MatrixXd> products_;              ///< S_k … S_0
  std::vector<Eigen::MatrixXd> first_, mixed_, last_;  ///< ∂²L_d/∂q_0², ∂²L_d/∂q_0∂q_1, ∂²L_d/∂q_1² of each step
  std::vector<double> times_;                          ///< of the nodes
  bool legendre_ = true;
};

}  // namespace rubato
