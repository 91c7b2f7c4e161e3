#include <rubato/ode/generating_action.hpp>

#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/ode/increment.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

}  // namespace

GeneratingOrder generating_order(int order, const MatrixXd& F) {
  if (order < 1 || order > most_generating_order) {
    throw std::invalid_argument(fmt::format("the order of a generating function has to be between 1 and {}; got {}",
                                            most_generating_order, order));
  }
  if (!F.isZero(0.0)) {
    return {.terms = order, .order = order};
  }
  const int even = order + order % 2;
  return {.terms = even - 1, .order = even};
}

GeneratingAction::GeneratingAction(const Hamiltonian& hamiltonian, const MatrixXd& F, int order)
    : generating_(hamiltonian, F, generating_order(order, F).terms),
      energy_size_(hamiltonian.size_code()),
      terms_(generating_.terms()),
      element_{.corners = 2, .coordinates = 1, .values = generating_.dimension()},
      J_(symplectic_unit(F.rows() / 2)),
      weight_(0.5 * turned(F)) {
  for (VectorXd* vector : {&middle_, &delta_, &w_, &slope_, &slope_rate_}) {
    vector->setZero(F.rows());
  }
  curvature_.setZero(F.rows(), F.rows());
}

Status GeneratingAction::expand(std::span<const double> corners) {
  const Index size = w_.size();
  const Eigen::Map<const VectorXd> z_0(corners.data() + element_.value(0, 0), size);
  const Eigen::Map<const VectorXd> z_1(corners.data() + element_.value(1, 0), size);
  h_ = corners[element_.coordinate(1, 0)] - corners[element_.coordinate(0, 0)];
  middle_ = 0.5 * (z_0 + z_1);
  delta_ = z_1 - z_0;
  w_ = middle_ + weight_ * delta_;
  const Status status = generating_.expand(as_span(w_));
  if (status == Status::success) {
    generating_.gradient_sum(h_, terms_, slope_);
    generating_.gradient_sum_rate(h_, terms_, slope_rate_);
  }
  return status;
}

double GeneratingAction::value(std::span<const double> corners) {
  if (expand(corners) != Status::success) {
    return undefined;
  }
  return -0.5 * middle_.dot(J_ * delta_) + generating_.sum(h_, terms_) - 0.25 * delta_.dot(generating_.F() * delta_);
}

void GeneratingAction::gradient(std::span<const double> corners, Eigen::Ref<VectorXd> result) {
  if (expand(corners) != Status::success) {
    result.setConstant(undefined);
    return;
  }
  const Index size = w_.size();
  const VectorXd by_middle = slope_ - 0.5 * J_ * delta_;
  const VectorXd by_delta = 0.5 * J_ * middle_ + weight_.transpose() * slope_ - 0.5 * generating_.F() * delta_;
  const double rate = generating_.sum_rate(h_, terms_);
  result[static_cast<Index>(element_.coordinate(0, 0))] = -rate;
  result[static_cast<Index>(element_.coordinate(1, 0))] = rate;
  result.segment(static_cast<Index>(element_.value(0, 0)), size) = 0.5 * by_middle - by_delta;
  result.segment(static_cast<Index>(element_.value(1, 0)), size) = 0.5 * by_middle + by_delta;
}

formula::SumSize GeneratingAction::energy_size(std::span<const double> corners) {
  formula::SumSize size;
  if (expand(corners) == Status::success) {
    size = energy_size_(as_span(w_));
    size.rounding += generating_.rate_rounding(h_, terms_);
  }
  return size;
}

void GeneratingAction::hessian(std::span<const double> corners, Eigen::Ref<MatrixXd> result) {
  if (expand(corners) != Status::success ||
      generating_.hessian_sum(as_span(w_), h_, terms_, curvature_) != Status::success) {
    result.setConstant(undefined);
    return;
  }
  const Index size = w_.size();
  const MatrixXd half = 0.5 * MatrixXd::Identity(size, size);
  const MatrixXd dw[2] = {half - weight_, half + weight_};  // ∂w/∂z_0, ∂w/∂z_1
  const double dt[2] = {-1.0, 1.0};
  const double dd[2] = {-1.0, 1.0};  // ∂δ/∂z
  const MatrixXd F = generating_.F();
  const double second_rate = generating_.sum_second_rate(h_, terms_);
  for (std::size_t a = 0; a < 2; ++a) {
    const auto t_a = static_cast<Index>(element_.coordinate(a, 0));
    const auto z_a = static_cast<Index>(element_.value(a, 0));
    for (std::size_t b = 0; b < 2; ++b) {
      const auto t_b = static_cast<Index>(element_.coordinate(b, 0));
      const auto z_b = static_cast<Index>(element_.value(b, 0));
      result(t_a, t_b) = dt[a] * dt[b] * second_rate;
      result.block(t_a, z_b, 1, size) = dt[a] * (dw[b].transpose() * slope_rate_).transpose();
      result.block(z_a, t_b, size, 1) = dt[b] * (dw[a].transpose() * slope_rate_);
      // -½ z̄ᵀJδ: ∂²/∂z_a∂z_b = -¼ (J dd_b - J dd_a) with Jᵀ = -J.
      result.block(z_a, z_b, size, size) = dw[a].transpose().lazyProduct(curvature_.lazyProduct(dw[b])) -
                                           0.25 * (dd[b] - dd[a]) * J_ - 0.5 * dd[a] * dd[b] * F;
    }
  }
}

}  // namespace rubato
