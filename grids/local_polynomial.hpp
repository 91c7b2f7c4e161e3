#pragma once

#include <cstddef>
#include <vector>

#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// Weights of nodes `first`, `first` + 1, …: of the polynomial through them, or of its derivative.
struct LocalWeights {
  std::size_t first = 0;
  std::vector<double> of;
};

/// Those at x on an axis between walls, by the nodes nearest to x: as many as there are up to ten, so that smooth
/// values have an error of order Δx^10, or Δx^9 of the derivative (Fornberg, Math. Comp. 51, 1988).
[[nodiscard]] LocalWeights local_weights(const Axis& axis, double x, bool of_derivative = false);

/// out = ∂_a in at the nodes, along an axis between walls. in and out may be the same.
void local_derivative(const Grid& grid, int axis, const double* in, double* out);

}  // namespace rubato::grids
