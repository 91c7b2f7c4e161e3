#include <rubato/ode/flow_map.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/ode/increment.hpp>
#include <rubato/ode/taylor_code.hpp>

namespace rubato {

namespace {

constexpr int most_parts = 64;
/// Size of a part's last term beside its first at which the part counts as resolved. It need not be small: the map is
/// a start and a direction for an iteration that corrects it.
constexpr double resolved = 1e-3;

}  // namespace

FlowMap::FlowMap(const Hamiltonian& hamiltonian, int order)
    : order_(order), flow_(flow_code(hamiltonian), order), other_(flow_) {
  for (Eigen::VectorXd* vector : {&before_last_, &other_before_last_, &point_}) {
    vector->setZero(static_cast<Eigen::Index>(flow_.dimension()));
  }
}

void FlowMap::add_part(const formula::TaylorFlow& flow, double h, Eigen::VectorXd& delta) const {
  for (Eigen::Index m = 0; m < delta.size(); ++m) {
    const auto c = flow.coefficients(static_cast<std::size_t>(m));
    double sum = 0.0;
    for (std::size_t j = c.size() - 1; j >= 1; --j) {
      sum = c[j] + h * sum;
    }
    delta[m] += h * sum;
  }
}

/// Expands part after part; leaves the last one's series in `flow` and the increment before it in `before_last`.
Status FlowMap::follow(formula::TaylorFlow& flow, const Eigen::VectorXd& z, Eigen::VectorXd& before_last) {
  before_last.setZero();
  for (int part = 0; part < parts_; ++part) {
    point_ = z + before_last;
    if (const Status status = flow(as_span(point_)); status != Status::success) {
      return status;
    }
    if (part + 1 < parts_) {
      add_part(flow, part_, before_last);
    }
  }
  return Status::success;
}

Status FlowMap::start(const Eigen::VectorXd& z, double h) {
  for (parts_ = 1; parts_ <= most_parts; parts_ *= 2) {
    part_ = h / parts_;
    if (const Status status = follow(flow_, z, before_last_); status != Status::success) {
      return status;
    }
    double first = 0.0;
    double last = 0.0;
    for (std::size_t m = 0; m < flow_.dimension(); ++m) {
      const auto c = flow_.coefficients(m);
      first = std::max(first, std::abs(c[1] * part_));
      last = std::max(last, std::abs(c.back()) * std::pow(std::abs(part_), order_));
    }
    if (last <= resolved * first) {
      break;
    }
  }
  parts_ = std::min(parts_, most_parts);
  return Status::success;
}

void FlowMap::increment(double h, Eigen::VectorXd& delta) const {
  delta = before_last_;
  add_part(flow_, h - (parts_ - 1) * part_, delta);
}

Status FlowMap::increment_from(const Eigen::VectorXd& z, double h, Eigen::VectorXd& delta) {
  const Status status = follow(other_, z, other_before_last_);
  if (status == Status::success) {
    delta = other_before_last_;
    add_part(other_, h - (parts_ - 1) * part_, delta);
  }
  return status;
}

}  // namespace rubato
