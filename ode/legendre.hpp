#pragma once

#include <span>
#include <string>

#include <Eigen/Core>

#include <rubato/base/status.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/ode/lagrangian.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace rubato {

/// H(q, p) = p·q̇ - L(q, q̇) with the q̇ for which ∂L/∂q̇ = p, found by Newton's method, and its derivatives through the
/// implicit function. H is stationary in q̇, so that what is left of the iteration enters it squared.
///
/// Where several velocities have the same momentum (L not convex in q̇) it is the one that is found from the first
/// guess: the velocity shortly before. No allocation after construction.
class LegendreTransform {
public:
  explicit LegendreTransform(const Lagrangian& lagrangian);

  /// Solves for q̇, from what q_dot holds (n entries each). Status::undefined where L is not defined on the way or
  /// ∂²L/∂q̇² is singular (singular() shows), Status::not_converged
  /// where ∂L/∂q̇ = p is not met to rounding, which a running error analysis of ∂L/∂q̇ shows.
  [[nodiscard]] Status solve(const double* q, const double* p, double* q_dot);
  [[nodiscard]] bool singular() const { return singular_; }

  /// At the q̇ of the last solve() that succeeded:
  ///@{
  [[nodiscard]] double energy() const { return energy_; }
  /// Γ = fᵀ H_zz f, f = J∇H (theory, section 3).
  [[nodiscard]] double gamma();
  /// q̈ along the motion, n entries; false where ∂²L/∂q̇² is singular.
  [[nodiscard]] bool acceleration(double* q_ddot);
  ///@}

  /// True if ∂²L/∂q̇² (n × n) has an inverse, whatever the units of coordinates.
  [[nodiscard]] bool is_regular(const Eigen::Ref<const Eigen::MatrixXd>& masses);

private:
  [[nodiscard]] Status solve_from_guess(const double* q, const double* p, double* q_dot);
  double evaluate(const double* q, const double* q_dot);
  [[nodiscard]] bool find_acceleration();
  [[nodiscard]] bool is_rounding(const Eigen::Ref<const Eigen::VectorXd>& momenta);

  LagrangianEvaluator evaluator_;
  formula::RoundingEvaluator rounding_;  // of ∇L
  Eigen::Index n_;
  solve::DenseSolver solver_;
  Eigen::VectorXd inputs_, errors_, gradient_, scales_, sizes_, residual_, step_, trial_, last_, last_guess_;
  Eigen::MatrixXd hessian_, scaled_;
  double energy_ = 0.0;
  bool singular_ = false;
};

/// H(q, p) as a formula, of an L that is quadratic in the velocities:
///
///     L = ½ q̇ᵀM(q)q̇ + b(q)·q̇ - V(q),      H = ½ (p - b)ᵀM⁻¹(p - b) + V,
///
/// with M eliminated in the order of the coordinates.
/// \param q_dot variables of L \param p expressions of the same graph
/// \throws std::invalid_argument if ∂²L/∂q̇² depends on a velocity, or the elimination meets a pivot that is 0
[[nodiscard]] formula::Expression legendre_transform(formula::Expression L, std::span<const formula::Expression> q_dot,
                                                     std::span<const formula::Expression> p);

/// Factors d by which velocities are scaled so that d_i M_ij d_j has entries of about 1.
[[nodiscard]] Eigen::VectorXd velocity_scales(const Eigen::MatrixXd& masses);

}  // namespace rubato
