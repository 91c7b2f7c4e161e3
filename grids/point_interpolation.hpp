#pragma once

#include <span>
#include <vector>

#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// A grid function between its nodes: the trigonometric polynomial through its values at one point, Σ_j w_j u_j. Of an
/// even number of cells the Nyquist mode is taken as a cosine, the mean of both signs of its wave number. Ranks that
/// share the lattice (grids::Slab) take it together, each of the values of its part, and all have it.
class PointInterpolation {
public:
  /// One coordinate for each direction. \throws std::invalid_argument if there are more or fewer
  PointInterpolation(const Grid& grid, std::vector<double> coordinates);

  [[nodiscard]] const std::vector<double>& coordinates() const { return coordinates_; }
  /// `values`: one for each node.
  [[nodiscard]] double operator()(std::span<const double> values) const;

private:
  std::vector<double> coordinates_;
  std::vector<std::vector<double>> weights_;  ///< of the nodes of the whole lattice along each direction
};

}  // namespace rubato::grids
