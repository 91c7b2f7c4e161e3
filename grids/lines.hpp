#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// The nodes of a grid along one of its axes: first + i·stride.
struct Line {
  std::size_t first = 0;
  std::size_t stride = 1;

  /// out[i] = values at the line's nodes, as many as out has.
  void read(const double* values, std::span<double> out) const {
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = values[first + i * stride];
    }
  }
};

/// Every line along an axis.
[[nodiscard]] inline std::vector<Line> lines_along(const Grid& grid, int axis) {
  const std::size_t stride = grid.stride(axis);
  const std::size_t cells = grid.cells(axis);
  std::vector<Line> lines;
  lines.reserve(grid.size() / cells);
  for (std::size_t block = 0; block < grid.size(); block += stride * cells) {
    for (std::size_t offset = 0; offset < stride; ++offset) {
      lines.push_back({block + offset, stride});
    }
  }
  return lines;
}

}  // namespace rubato::grids
