#pragma once

#include <cstddef>
#include <span>

#include <Eigen/Core>

#include <rubato/formula/rounding.hpp>

namespace rubato {

/// The mesh element on which a discrete action lives: its corners, and what varies at each of them.
///
/// All corner data are one vector, corner after corner, at each corner first the coordinates (t, then x, y, z), then
/// the field values. A segment of an orbit has 2 corners and 1 coordinate; a lattice cell in one space dimension has 4
/// corners, (t_k,x_i), (t_k,x_{i+1}), (t_{k+1},x_i), (t_{k+1},x_{i+1}), and 2 coordinates.
struct Element {
  std::size_t corners = 2;
  std::size_t coordinates = 1;
  std::size_t values = 0;

  [[nodiscard]] std::size_t per_corner() const { return coordinates + values; }
  [[nodiscard]] std::size_t size() const { return corners * per_corner(); }
  [[nodiscard]] std::size_t coordinate(std::size_t corner, std::size_t i) const { return corner * per_corner() + i; }
  [[nodiscard]] std::size_t value(std::size_t corner, std::size_t i) const {
    return corner * per_corner() + coordinates + i;
  }
};

/// A discrete action A on one element, as a function of its corners' coordinates **and** values (theory, section 2):
/// the only thing a scheme states. Everything else (the integrator, its discrete energy, the local laws, the one-forms
/// and the preserved two-form) is a variation of A; see total_variation.hpp.
///
/// An object holds its own work space: use one per thread; copies are independent.
class DiscreteAction {
public:
  virtual ~DiscreteAction() = default;

  [[nodiscard]] virtual const Element& element() const = 0;
  /// A at the corners; `corners.size() == element().size()`.
  [[nodiscard]] virtual double value(std::span<const double> corners) = 0;
  /// First variation: ∂A/∂(corners), all coordinates and values.
  virtual void gradient(std::span<const double> corners, Eigen::Ref<Eigen::VectorXd> result) = 0;
  /// Second variation: the symmetric matrix ∂²A/∂(corners)².
  virtual void hessian(std::span<const double> corners, Eigen::Ref<Eigen::MatrixXd> result) = 0;
  /// How large the terms are whose sum is ∂A/∂t at the first corner (on a segment: E), and its rounding error.
  [[nodiscard]] virtual formula::SumSize energy_size(std::span<const double> corners) = 0;

protected:
  DiscreteAction() = default;
  DiscreteAction(const DiscreteAction&) = default;
  DiscreteAction& operator=(const DiscreteAction&) = default;
};

}  // namespace rubato
