#pragma once

#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>
#include <Eigen/LU>

#include <rubato/ode/integrate.hpp>
#include <rubato/variation/discrete_action.hpp>

#include "systems.hpp"

/// Consecutive segments of the two-step map, solved here from the variations of the action alone, by full Newton: a
/// path to z_2 that shares no code with the schemes and the choice of time levels.
namespace pairs {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

inline std::span<const double> as_span(const VectorXd& corners) {
  return {corners.data(), static_cast<std::size_t>(corners.size())};
}

/// (t_0, z_0, t_1, z_1) of a segment.
inline VectorXd segment(double t_0, const std::vector<double>& z_0, double t_1, const std::vector<double>& z_1) {
  const auto size = static_cast<Index>(z_0.size());
  VectorXd corners(2 * (size + 1));
  corners << t_0, Eigen::Map<const VectorXd>(z_0.data(), size), t_1, Eigen::Map<const VectorXd>(z_1.data(), size);
  return corners;
}

/// The image (t_1, z_1, t_2, z_2) of `first` under the two-step map: both variations at node 1 vanish, (3.3) and (3.4).
/// `guess` is the image of a segment near by. NaN where Newton does not settle.
inline VectorXd two_step(rubato::DiscreteAction& action, const VectorXd& first, const VectorXd& guess) {
  const Index size = first.size();
  const Index half = size / 2;
  VectorXd second(size);
  second << first.tail(half), guess.tail(half);
  VectorXd before(size), after(size);
  MatrixXd hessian(size, size);
  action.gradient(as_span(first), before);
  double last = INFINITY;
  for (int iteration = 0; iteration < 50; ++iteration) {
    action.gradient(as_span(second), after);
    action.hessian(as_span(second), hessian);
    const VectorXd correction =
        hessian.topRightCorner(half, half).fullPivLu().solve(before.tail(half) + after.head(half));
    second.tail(half) -= correction;
    const double size_now = correction.norm();
    if (size_now < 1e-9 && size_now >= 0.5 * last) {  // rounding rules
      return second;
    }
    last = size_now;
  }
  return VectorXd::Constant(size, NAN);
}

/// Derivative of a map by central differences, extrapolated once (error O(ε⁴)).
template <typename Map>
MatrixXd difference_quotient(const Map& map, const VectorXd& at, double epsilon) {
  MatrixXd result(map(at).size(), at.size());
  for (Index i = 0; i < at.size(); ++i) {
    const auto central = [&](double distance) -> VectorXd {
      VectorXd plus = at;
      VectorXd minus = at;
      plus[i] += distance;
      minus[i] -= distance;
      return (map(plus) - map(minus)) / (2.0 * distance);
    };
    result.col(i) = (4.0 * central(0.5 * epsilon) - central(epsilon)) / 3.0;
  }
  return result;
}

/// The largest entry of TᵀW₁T - W₀, relative to that of W₀.
inline double preservation_defect(const MatrixXd& tangent, const MatrixXd& before, const MatrixXd& after) {
  return (tangent.transpose() * after * tangent - before).cwiseAbs().maxCoeff() / before.cwiseAbs().maxCoeff();
}

}  // namespace pairs
