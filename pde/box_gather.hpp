#pragma once

#include <cstddef>

#include <rubato/grids/grid.hpp>

namespace rubato {

/// A, D_x, D_y, D_z of fields on a block of cells: box averages and differences of the nodes around (theory, section
/// 5).
class BoxGather {
public:
  explicit BoxGather(const grids::Grid& grid);

  /// mean[i] = A z and difference[a][i] = D_a z at cells begin + i of a line, for i < count; null pointers are skipped.
  void operator()(const double* field, std::size_t line, std::size_t begin, std::size_t count, double* mean,
                  double* const* difference) const;

private:
  int dimensions_;
  std::size_t n_[3];
  std::size_t stride_[3];
  double inverse_spacing_[3];
};

}  // namespace rubato
