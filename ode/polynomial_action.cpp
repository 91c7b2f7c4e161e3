#include <rubato/ode/polynomial_action.hpp>

namespace rubato {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

PolynomialAction::PolynomialAction(const Lagrangian& lagrangian, const ActionQuadrature& of)
    : quadrature(of), evaluator_(lagrangian), n_(static_cast<Index>(lagrangian.degrees_of_freedom())) {
  const Index count = quadrature.nodes.size();
  points.setZero(2 * n_, count);
  gradients.setZero(2 * n_, count);
  hessians.setZero(2 * n_, 2 * n_ * count);
  values.setZero(count);
  sums_.setZero(2 * n_);
  point_.setZero(2 * n_);
}

bool PolynomialAction::evaluate(const CompensatedState<VectorXd>& z, const MatrixXd& Y, double h) {
  const Index d = quadrature.degree;
  for (Index j = 0; j < values.size(); ++j) {
    sums_.head(n_).noalias() = Y.lazyProduct(quadrature.values.row(j).tail(d).transpose());
    sums_.tail(n_).setZero();
    z.displaced(1.0, sums_, point_);
    auto point = points.col(j);
    point.head(n_) = point_.head(n_);
    point.tail(n_).noalias() = Y.lazyProduct(quadrature.rates.row(j).tail(d).transpose());
    point.tail(n_) /= h;
    values[j] = evaluator_.hessian(point.data(), gradients.col(j).data(), hessians.col(2 * n_ * j).data());
  }
  return values.allFinite() && gradients.allFinite() && hessians.allFinite();
}

void PolynomialAction::differentiate(double h, MatrixXd& residual, MatrixXd& matrix) const {
  const VectorXd& b = quadrature.weights;
  const Index d = quadrature.degree;
  matrix.topLeftCorner(n_ * d, n_ * d).setZero();
  for (Index row = 0; row < d; ++row) {
    auto equation = residual.col(row);
    equation.setZero();
    for (Index j = 0; j < values.size(); ++j) {
      const double value = quadrature.values(j, row), rate = quadrature.rates(j, row);
      equation += b[j] * (h * value * gradients.col(j).head(n_) + rate * gradients.col(j).tail(n_));
      const auto hessian = hessians.middleCols(2 * n_ * j, 2 * n_);
      for (Index column = 0; column < d; ++column) {
        const double value_1 = quadrature.values(j, column + 1), rate_1 = quadrature.rates(j, column + 1);
        auto block = matrix.block(row * n_, column * n_, n_, n_);
        block += (b[j] * h * value * value_1) * hessian.topLeftCorner(n_, n_);
        block += (b[j] * value * rate_1) * hessian.topRightCorner(n_, n_);
        block += (b[j] * rate * value_1) * hessian.bottomLeftCorner(n_, n_);
        block += (b[j] / h * rate * rate_1) * hessian.bottomRightCorner(n_, n_);
      }
    }
  }
}

void PolynomialAction::vary(Index j, double h, const Eigen::Ref<const VectorXd>& q, const MatrixXd& Y,
                            double change_of_h, VectorXd& point, VectorXd& gradient) const {
  const Index d = quadrature.degree;
  point.head(n_).noalias() = Y.lazyProduct(quadrature.values.row(j).tail(d).transpose());
  point.head(n_) += q;
  point.tail(n_).noalias() = Y.lazyProduct(quadrature.rates.row(j).tail(d).transpose());
  point.tail(n_) -= change_of_h * points.col(j).tail(n_);
  point.tail(n_) /= h;
  gradient.noalias() = hessians.middleCols(2 * n_ * j, 2 * n_).lazyProduct(point);
}

}  // namespace rubato
