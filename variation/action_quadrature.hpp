#pragma once

#include <Eigen/Core>

namespace rubato {

/// A discrete Lagrangian from L(q, q̇), the Galerkin one (Marsden and West, Discrete mechanics and variational
/// integrators, Acta Numerica 10, 2001, section 2.2.6): of all polynomials of degree d from q_0 to q_1, the one that
/// makes the quadrature of the action stationary,
///
///     L_d(q_0, q_1, h) = ext h Σ_j b_j L(q(c_j h), q̇(c_j h)).
///
/// With d Gauss points this is Gauss collocation, of order 2d, in other words; one of them is the midpoint rule. With
/// d + 1 Lobatto points it is the pair of Lobatto IIIA and IIIB, of order 2d, too; two of them are the trapezoidal
/// rule, which for L = q̇²/2 - V(q) is Störmer and Verlet's method.
struct ActionQuadrature {
  enum class Points { gauss, lobatto };
  static constexpr int most_degree = 8;

  /// \throws std::invalid_argument unless 1 ≤ degree ≤ most_degree
  ActionQuadrature(Points points, int degree);

  [[nodiscard]] int order() const { return 2 * degree; }
  /// Values of the polynomials of degree d that are 1 at one of `control` and 0 at the others, at σ.
  void interpolation(double sigma, Eigen::VectorXd& weights) const;

  Points points;
  int degree;
  Eigen::VectorXd control;         ///< where the polynomial has its values, ascending from 0 to 1: d + 1 Lobatto points
  Eigen::VectorXd nodes, weights;  ///< c_j and b_j
  /// Of the polynomial that is 1 at control point i, at c_j, on a step of length 1: value and rate (j, i). Rows sum to
  /// 1 and to 0.
  Eigen::MatrixXd values, rates;
};

}  // namespace rubato
