#include <rubato/ode/generating_continuation.hpp>

#include <rubato/ode/tuning.hpp>

#include <algorithm>
#include <array>
#include <cmath>
namespace rubato {

namespace {

using namespace tuning::generating_start;

using Eigen::Index;

}  // namespace

OrbitContinuation::OrbitContinuation(const GeneratingFunction& generating)
    : lane_stride_(generating.slope_stride()), weights_(Eigen::VectorXd::Zero(generating.terms() * lane_stride_)) {}

void OrbitContinuation::set_weights(const GeneratingNodes& nodes, double h, double ratio, int terms) {
  h_ = h;
  ratio_ = ratio;
  terms_ = terms;
  const Eigen::VectorXd integrals = nodes.integrals_beyond(ratio);
  weights_.setZero();
  double power = h;
  for (int d = 0; d < terms; ++d, power *= h) {
    auto row = weights_.segment(d * lane_stride_, nodes.count);
    for (int l = nodes.parity ? d % 2 : 0; l <= d; l += nodes.parity ? 2 : 1) {
      row += power * integrals[l] * nodes.transform.row(l).transpose();
    }
  }
}

bool OrbitContinuation::increment(const GeneratingFunction& generating, double h, double next, Eigen::VectorXd& delta) {
  const double ratio = next / h;
  if (h_ != h || ratio_ != ratio || terms_ != generating.known_terms()) {
    set_weights(generating.nodes(), h, ratio, generating.known_terms());
  }
  const Index all = terms_ * lane_stride_;
  const Index last = std::min<Index>(terms_, 2) * lane_stride_;
  // Coordinates and momenta apart: their units differ.
  std::array<double, 2> largest{}, largest_last{};
  for (Index m = 0; m < delta.size(); ++m) {
    const Eigen::Map<const Eigen::VectorXd> slopes(generating.slopes(static_cast<std::size_t>(m)).data(), all);
    const double tail = slopes.tail(last).dot(weights_.segment(all - last, last));
    delta[m] = slopes.head(all - last).dot(weights_.head(all - last)) + tail;
    const std::size_t block = m < delta.size() / 2 ? 0 : 1;
    largest[block] = std::max(largest[block], std::abs(delta[m]));
    largest_last[block] = std::max(largest_last[block], std::abs(tail));
  }
  return largest_last[0] <= converged * largest[0] && largest_last[1] <= converged * largest[1];
}

}  // namespace rubato
