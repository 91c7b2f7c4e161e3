#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// The generating function Φ(w, h) of the step of Gauss collocation, of the type F = 0: J(z_1 - z_0) = ∇Φ(w, h) at
/// w = (z_0 + z_1)/2 (theory, section 8). With k_i the slopes of the stages,
///
///     Z_i = w + h Σ_j (a_ij - b_j/2) k_j,   k_i = J∇H(Z_i),
///     Φ = -h Σ_i b_i H(Z_i) - (h²/2) Σ_ij b_i (a_ij - b_j/2) k_iᵀJ⁻¹k_j,
///
/// which is stationary in the k_i, so that ∇Φ = -h Σ b_i ∇H(Z_i) and -∂_hΦ = Σ b_i H(Z_i): the discrete energy.
///
/// Holds work space: one per thread. For judging and comparing; steps are taken by make_gauss_scheme().
class GaussFunction {
public:
  /// \throws std::invalid_argument as GaussTableau
  GaussFunction(const Hamiltonian& hamiltonian, int stages);

  [[nodiscard]] std::size_t dimension() const { return static_cast<std::size_t>(size_); }

  /// Solves for the stages at (w, h). Status::not_converged, or undefined where H is.
  Status expand(std::span<const double> w, double h);

  /// Φ and its derivatives where it was expanded last.
  ///@{
  [[nodiscard]] double value() const;
  [[nodiscard]] double rate() const;  ///< ∂_hΦ
  [[nodiscard]] const Eigen::VectorXd& gradient() const { return gradient_; }
  /// ∂²_hΦ, ∂_h∇Φ and the matrix of second derivatives in w, by differentiation of the stage equations.
  [[nodiscard]] Status second_variation(double& second_rate, Eigen::VectorXd& gradient_rate, Eigen::MatrixXd& hessian);
  ///@}

private:
  [[nodiscard]] bool evaluate();
  /// J∇H of the stages, weighted by Σ_j (a_ij - b_j/2).
  [[nodiscard]] Eigen::VectorXd mean_slope(Eigen::Index i) const;
  [[nodiscard]] Status factor(double h);

  GaussTableau tableau_;
  Eigen::MatrixXd centred_;  ///< a_ij - b_j/2
  HamiltonianEvaluator evaluator_;
  Eigen::Index m_, size_;
  double h_ = 0.0;
  Eigen::VectorXd w_, stages_, energies_, gradient_;  ///< stages_: Z_1 … Z_m, one after the other
  Eigen::MatrixXd gradients_, slopes_;                ///< ∇H(Z_i), k_i: a column for each stage
  std::vector<Eigen::MatrixXd> hessians_;
  solve::DenseSolver factors_;
};

}  // namespace rubato
