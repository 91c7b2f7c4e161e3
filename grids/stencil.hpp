#pragma once

#include <memory>

#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// A linear operator in space: a box operator (a product of identities, averages, forward differences and shifts
/// along the axes), a backward difference, or the spectral derivative ∂ along one axis.
struct SpaceOperator {
  BoxOperator box{Along::identity, Along::identity, Along::identity};
  int spectral_axis = -1;  ///< of ∂, in place of `box`; -1 for none
  bool mirrored = false;   ///< -boxᵀ in place of `box`: δ⁻ of δ⁺

  [[nodiscard]] static SpaceOperator identity() { return {}; }
  /// The average over the corners of a cell.
  [[nodiscard]] static SpaceOperator average(int dimensions);
  /// D_a of the box: the forward difference along an axis, averaged along the others.
  [[nodiscard]] static SpaceOperator box_difference(int axis, int dimensions);
  /// δ_a⁺ at a node: the forward difference along an axis, the identity along the others.
  [[nodiscard]] static SpaceOperator forward_difference(int axis);
  /// δ_a⁻, that to the node before.
  [[nodiscard]] static SpaceOperator backward_difference(int axis);
  /// The value at the next node along an axis.
  [[nodiscard]] static SpaceOperator next(int axis);
  [[nodiscard]] static SpaceOperator spectral_derivative(int axis);

  bool operator==(const SpaceOperator&) const = default;
};

/// Operators in space and their adjoints on one grid, periodic in every direction. Holds the plans of the spectral
/// derivative, which are made when it is first asked for.
class Stencil {
public:
  explicit Stencil(const Grid& grid) : grid_(grid) {}

  [[nodiscard]] const Grid& grid() const { return grid_; }

  /// out = op z. in and out may not overlap. \throws std::invalid_argument if op acts along an axis the grid lacks
  void apply(const SpaceOperator& op, const double* in, double* out);
  /// out = opᵀ r, ⟨op z, r⟩ = ⟨z, opᵀ r⟩; that of ∂ is -∂.
  void apply_adjoint(const SpaceOperator& op, const double* in, double* out);

private:
  SpectralDerivative& spectral();

  Grid grid_;
  std::unique_ptr<SpectralDerivative> spectral_;
};

}  // namespace rubato::grids
