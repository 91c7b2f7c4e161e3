#include <rubato/variation/total_variation.hpp>

#include <stdexcept>

#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

Index index(std::size_t i) {
  return static_cast<Index>(i);
}

/// Σ over the elements of the entries [first, first + count) of ∂A at the node's corner.
VectorXd variation_at_node(DiscreteAction& action, std::span<const Incidence> elements, std::size_t first,
                           std::size_t count) {
  const Element& element = action.element();
  VectorXd gradient(index(element.size()));
  VectorXd sum = VectorXd::Zero(index(count));
  for (const Incidence& incidence : elements) {
    action.gradient(incidence.corners, gradient);
    sum += gradient.segment(index(incidence.corner * element.per_corner() + first), index(count));
  }
  return sum;
}

void require_segment(const Element& element, const char* what) {
  if (element.corners != 2 || element.coordinates != 1) {
    throw std::invalid_argument(std::string(what) +
                                " is defined for a discrete action on a segment (2 corners, 1 coordinate)");
  }
}

}  // namespace

VectorXd value_variation(DiscreteAction& action, std::span<const Incidence> elements) {
  return variation_at_node(action, elements, action.element().coordinates, action.element().values);
}

double coordinate_variation(DiscreteAction& action, std::span<const Incidence> elements, std::size_t coordinate) {
  return variation_at_node(action, elements, coordinate, 1)[0];
}

VectorXd boundary_one_form(DiscreteAction& action, std::span<const double> corners, std::size_t corner) {
  const Element& element = action.element();
  VectorXd gradient(index(element.size()));
  action.gradient(corners, gradient);
  VectorXd form = VectorXd::Zero(gradient.size());
  const Index first = index(corner * element.per_corner());
  const Index count = index(element.per_corner());
  form.segment(first, count) = gradient.segment(first, count);
  return form;
}

MatrixXd two_form(DiscreteAction& action, std::span<const double> corners) {
  require_segment(action.element(), "the two-form dθ⁺");
  const Index size = index(action.element().size());
  const Index half = size / 2;
  MatrixXd hessian(size, size);
  action.hessian(corners, hessian);
  MatrixXd form = MatrixXd::Zero(size, size);
  form.topRightCorner(half, half) = hessian.topRightCorner(half, half);
  form.bottomLeftCorner(half, half) = -hessian.bottomLeftCorner(half, half);
  return form;
}

MatrixXd two_step_tangent(DiscreteAction& action, std::span<const double> first, std::span<const double> second) {
  require_segment(action.element(), "the two-step tangent");
  const Index size = index(action.element().size());
  const Index half = size / 2;
  MatrixXd before(size, size);
  MatrixXd after(size, size);
  action.hessian(first, before);
  action.hessian(second, after);
  MatrixXd right(half, size);
  right.leftCols(half) = -before.bottomLeftCorner(half, half);
  right.rightCols(half) = -(before.bottomRightCorner(half, half) + after.topLeftCorner(half, half));
  MatrixXd tangent = MatrixXd::Zero(size, size);
  tangent.topRightCorner(half, half).setIdentity();
  const auto solution = solve::quotient(after.topRightCorner(half, half), right);
  if (!solution) {
    throw std::invalid_argument("the two-step tangent does not exist: the second variation is singular or not finite");
  }
  tangent.bottomRows(half) = *solution;
  return tangent;
}

}  // namespace rubato
