#include <rubato/ode/tangent.hpp>

#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/ode/increment.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A⁻¹B. \throws std::invalid_argument where the tangent does not exist
MatrixXd quotient_or_throw(const MatrixXd& A, const MatrixXd& B) {
  auto result = solve::quotient(A, B);
  if (!result) {
    throw std::invalid_argument("the tangent of this step does not exist: the step's equation degenerates there");
  }
  return std::move(*result);
}

/// What the linearised midpoint step is made of: f = J∇H and g = ∇H at z̄, and ½hJH_zz.
struct LinearisedStep {
  VectorXd f, g;
  MatrixXd half_jacobian;
};

LinearisedStep linearise(HamiltonianEvaluator& hamiltonian, std::span<const double> z_0, std::span<const double> z_1,
                         double h) {
  const std::size_t size = hamiltonian.dimension();
  if (z_0.size() != size || z_1.size() != size) {
    throw std::invalid_argument(fmt::format("the tangent of a step needs two states of {} entries; got {} and {}", size,
                                            z_0.size(), z_1.size()));
  }
  if (!std::isfinite(h) || h == 0.0) {
    throw std::invalid_argument(fmt::format("the tangent of a step needs a finite length that is not 0; got {}", h));
  }
  const auto rows = static_cast<Index>(size);
  const Index n = rows / 2;
  const VectorXd middle =
      0.5 * (Eigen::Map<const VectorXd>(z_0.data(), rows) + Eigen::Map<const VectorXd>(z_1.data(), rows));
  LinearisedStep step{VectorXd(rows), VectorXd(rows), MatrixXd(rows, rows)};
  MatrixXd hessian(rows, rows);
  const double energy = hamiltonian.hessian(middle.data(), step.g.data(), hessian.data());
  if (!std::isfinite(energy) || !step.g.allFinite() || !hessian.allFinite()) {
    throw std::invalid_argument("the tangent of a step needs H and its first two derivatives finite at the midpoint");
  }
  apply_j(step.g, step.f);
  step.half_jacobian.topRows(n) = 0.5 * h * hessian.bottomRows(n);
  step.half_jacobian.bottomRows(n) = -0.5 * h * hessian.topRows(n);
  return step;
}

}  // namespace

MatrixXd canonical_two_form(std::size_t degrees_of_freedom) {
  const auto n = static_cast<Index>(degrees_of_freedom);
  MatrixXd form = MatrixXd::Zero(2 * n, 2 * n);
  form.bottomLeftCorner(n, n).setIdentity();
  form.topRightCorner(n, n) = -MatrixXd::Identity(n, n);
  return form;
}

MatrixXd extended_two_form(std::size_t degrees_of_freedom) {
  const auto size = static_cast<Index>(2 * degrees_of_freedom);
  MatrixXd form = MatrixXd::Zero(size + 2, size + 2);
  form.topLeftCorner(size, size) = canonical_two_form(degrees_of_freedom);
  form(size + 1, size) = -1.0;
  form(size, size + 1) = 1.0;
  return form;
}

MatrixXd fixed_level_tangent(HamiltonianEvaluator& hamiltonian, std::span<const double> z_0,
                             std::span<const double> z_1, double h) {
  const LinearisedStep step = linearise(hamiltonian, z_0, z_1, h);
  const MatrixXd identity = MatrixXd::Identity(step.f.size(), step.f.size());
  return quotient_or_throw(identity - step.half_jacobian, identity + step.half_jacobian);
}

MatrixXd variable_level_tangent(HamiltonianEvaluator& hamiltonian, std::span<const double> z_0,
                                std::span<const double> z_1, double h) {
  const LinearisedStep step = linearise(hamiltonian, z_0, z_1, h);
  const Index size = step.f.size();
  const Index time = size;
  const Index energy = size + 1;
  MatrixXd left = MatrixXd::Zero(size + 1, size + 1);
  left.topLeftCorner(size, size) = MatrixXd::Identity(size, size) - step.half_jacobian;
  left.topRightCorner(size, 1) = -step.f;
  left.bottomLeftCorner(1, size) = 0.5 * step.g.transpose();
  MatrixXd right = MatrixXd::Zero(size + 1, size + 2);
  right.topLeftCorner(size, size) = MatrixXd::Identity(size, size) + step.half_jacobian;
  right.bottomLeftCorner(1, size) = -0.5 * step.g.transpose();
  right(size, energy) = 1.0;
  MatrixXd tangent = MatrixXd::Zero(size + 2, size + 2);
  tangent.topRows(size + 1) = quotient_or_throw(left, right);
  tangent(time, time) += 1.0;
  tangent(energy, energy) = 1.0;
  return tangent;
}

}  // namespace rubato
