#include <rubato/ode/generating_continuation.hpp>

#include <algorithm>
namespace rubato {

namespace {

using Eigen::Index;

/// Size of the last two orders beside the whole at which the series is still of use as a start.
constexpr double converged = 1e-3;

}  // namespace

OrbitContinuation::OrbitContinuation(const GeneratingFunction& generating)
    : nodes_(generating.nodes()),
      lane_stride_(generating.slope_stride()),
      slopes_(Eigen::MatrixXd::Zero(generating.terms() * lane_stride_, static_cast<Index>(generating.dimension()))),
      weights_(Eigen::MatrixXd::Zero(slopes_.rows(), 2)),
      sums_(Eigen::MatrixXd::Zero(slopes_.cols(), 2)) {}

void OrbitContinuation::take(const GeneratingFunction& generating, double h) {
  known_ = generating.known_terms();
  h_ = h;
  for (Index m = 0; m < slopes_.cols(); ++m) {
    const std::span<const double> values = generating.slopes(static_cast<std::size_t>(m));
    std::copy_n(values.data(), known_ * lane_stride_, slopes_.col(m).data());
  }
}

void OrbitContinuation::set_weights(double ratio) {
  const Eigen::VectorXd integrals = nodes_.integrals_beyond(ratio);
  weights_.setZero();
  double power = h_;
  for (int d = 0; d < known_; ++d, power *= h_) {
    auto row = weights_.col(0).segment(d * lane_stride_, nodes_.count);
    for (int l = nodes_.parity ? d % 2 : 0; l <= d; l += nodes_.parity ? 2 : 1) {
      row += power * integrals[l] * nodes_.transform.row(l).transpose();
    }
  }
  const Index last = std::max(0, known_ - 2) * lane_stride_;
  weights_.col(1).tail(weights_.rows() - last) = weights_.col(0).tail(weights_.rows() - last);
  weights_h_ = h_;
  weights_ratio_ = ratio;
  weights_known_ = known_;
}

bool OrbitContinuation::increment(double next, Eigen::VectorXd& delta) {
  const double ratio = next / h_;
  if (weights_h_ != h_ || weights_ratio_ != ratio || weights_known_ != known_) {
    set_weights(ratio);
  }
  sums_.noalias() = slopes_.transpose() * weights_;
  delta = sums_.col(0);
  return sums_.col(1).lpNorm<Eigen::Infinity>() <= converged * delta.lpNorm<Eigen::Infinity>();
}

}  // namespace rubato
