#pragma once

#include <Eigen/Core>

#include <rubato/ode/increment.hpp>
#include <rubato/ode/lagrangian.hpp>
#include <rubato/variation/action_quadrature.hpp>

namespace rubato {

/// The quadrature S = h Σ_j b_j L(q(c_j h), q̇(c_j h)) of the action of a polynomial (theory, section 7), with its
/// derivatives by the values of the polynomial at the control points. No allocation after construction.
class PolynomialAction {
public:
  PolynomialAction(const Lagrangian& lagrangian, const ActionQuadrature& quadrature);

  /// q and q̇ at the quadrature points, and L there with its derivatives. \param z q_k and p_k \param Y q at the control
  /// points but the first, less q_k: n × degree. \return true if all are finite
  bool evaluate(const CompensatedState<Eigen::VectorXd>& z, const Eigen::MatrixXd& Y, double h);

  /// ∂S/∂q at the control points but the last, into `residual` (n × degree), and the derivatives of that by Y into the
  /// upper left part of `matrix`.
  void differentiate(double h, Eigen::MatrixXd& residual, Eigen::MatrixXd& matrix) const;

  /// What a variation makes of quadrature point j and of ∇L there: q_k changes by δq, Y by δY and h by δh.
  /// \param point, gradient 2n entries each
  void vary(Eigen::Index j, double h, const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::MatrixXd& Y,
            double change_of_h, Eigen::VectorXd& point, Eigen::VectorXd& gradient) const;

  const ActionQuadrature quadrature;
  Eigen::MatrixXd points, gradients, hessians;  ///< (q, q̇) at the quadrature points, and L's derivatives there
  Eigen::VectorXd values;                       ///< of L there

private:
  LagrangianEvaluator evaluator_;
  Eigen::Index n_;
  Eigen::VectorXd sums_, point_;
};

}  // namespace rubato
