#include <rubato/ode/flow_map.hpp>

#include <algorithm>
#include <cmath>

#include <rubato/ode/increment.hpp>
#include <rubato/ode/taylor_code.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/variation/power_of.hpp>

namespace rubato {

namespace {

using namespace tuning::flow_map;

}  // namespace

FlowMap::FlowMap(const Hamiltonian& hamiltonian, int order) : order_(order), flow_(flow_code(hamiltonian), order) {
  for (Eigen::VectorXd* vector : {&before_last_, &point_}) {
    vector->setZero(static_cast<Eigen::Index>(flow_.dimension()));
  }
}

void FlowMap::add_part(double h, Eigen::VectorXd& delta) const {
  for (Eigen::Index m = 0; m < delta.size(); ++m) {
    double sum = 0.0;
    for (int j = order_; j >= 1; --j) {
      sum = flow_.coefficient(static_cast<std::size_t>(m), j) + h * sum;
    }
    delta[m] += h * sum;
  }
}

Status FlowMap::start(const Eigen::VectorXd& z, double h) {
  for (parts_ = 1; parts_ <= most_parts; parts_ *= 2) {
    part_ = h / parts_;
    before_last_.setZero();
    for (int part = 0; part < parts_; ++part) {
      if (part > 0) {
        add_part(part_, before_last_);
      }
      point_ = z + before_last_;
      if (const Status status = flow_(as_span(point_)); status != Status::success) {
        return status;
      }
    }
    if (is_resolved()) {
      break;
    }
  }
  parts_ = std::min(parts_, most_parts);
  return Status::success;
}

/// Whether the last terms of coordinates, and those of momenta, are small beside the first: their units differ.
bool FlowMap::is_resolved() const {
  const std::size_t n = flow_.dimension() / 2;
  const auto largest = [&](std::size_t begin, int j) {
    double size = 0.0;
    for (std::size_t m = begin; m < begin + n; ++m) {
      size = std::max(size, std::abs(flow_.coefficient(m, j)) * power_of(std::abs(part_), j));
    }
    return size;
  };
  const auto is_block_resolved = [&](std::size_t begin) {
    return largest(begin, order_) <= resolved * std::max(largest(begin, 1), largest(begin, 2));
  };
  return is_block_resolved(0) && is_block_resolved(n);
}

void FlowMap::increment(double h, Eigen::VectorXd& delta) const {
  delta = before_last_;
  add_part(h - (parts_ - 1) * part_, delta);
}

FlowTangent::FlowTangent(const Hamiltonian& hamiltonian, int order)
    : order_(order), flow_(flow_code(hamiltonian), order, 2) {
  points_[0] = points_[1] = last_terms_ = displaced_ =
      Eigen::VectorXd::Zero(static_cast<Eigen::Index>(flow_.dimension()));
}

/// Moves both points through all parts; adds up the last terms.
Status FlowTangent::follow(const Eigen::VectorXd& z, const Eigen::VectorXd& v, double part, int parts) {
  points_[0] = z + v;
  points_[1] = z - v;
  displaced_ = 0.5 * (points_[0] - points_[1]);
  last_terms_.setZero();
  const double* const starts[] = {points_[0].data(), points_[1].data()};
  const double last_power = power_of(std::abs(part), order_);
  for (int k = 0; k < parts; ++k) {
    if (const Status status = flow_(starts); status != Status::success) {
      return status;
    }
    for (Eigen::Index m = 0; m < z.size(); ++m) {
      const auto component = static_cast<std::size_t>(m);
      const double last = flow_.coefficient(component, order_, 0) - flow_.coefficient(component, order_, 1);
      last_terms_[m] += 0.5 * std::abs(last) * last_power;
      for (std::size_t lane = 0; lane < 2; ++lane) {
        double sum = 0.0;
        for (int j = order_; j >= 1; --j) {
          sum = flow_.coefficient(component, j, lane) + part * sum;
        }
        points_[lane][m] += part * sum;
      }
    }
  }
  return Status::success;
}

/// Coordinates and momenta are compared among themselves: their units differ.
bool FlowTangent::resolved_in(const Eigen::VectorXd& v, const Eigen::VectorXd& result) const {
  const Eigen::Index n = v.size() / 2;
  const auto resolved_block = [&](Eigen::Index first) {
    const double scale = std::max(v.segment(first, n).lpNorm<Eigen::Infinity>(),
                                  (v + result).segment(first, n).lpNorm<Eigen::Infinity>());
    return last_terms_.segment(first, n).lpNorm<Eigen::Infinity>() <= tangent_resolved * scale;
  };
  return resolved_block(0) && resolved_block(n);
}

Status FlowTangent::apply(const Eigen::VectorXd& z, const Eigen::VectorXd& v, double h, Eigen::VectorXd& result) {
  for (int parts = 1; parts <= most_parts; parts *= 2) {
    if (const Status status = follow(z, v, h / parts, parts); status != Status::success) {
      return status;
    }
    result = 0.5 * (points_[0] - points_[1]) - displaced_;
    if (resolved_in(v, result)) {
      break;
    }
  }
  return Status::success;
}

}  // namespace rubato
