#pragma once

#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>

namespace rubato {

/// What is done along one direction with the two nodes of a cell.
enum class FaceOperation {
  average,
  difference,
  first,   ///< the value at the lower face
  second,  ///< at the upper face
};

/// Values on the faces of a block of cells: one operation along each of x, y, z (those beyond the grid's dimension are
/// ignored) applied to node values.
class FaceGather {
public:
  explicit FaceGather(const grids::Grid& grid);
  void operator()(const double* field, std::size_t line, std::size_t begin, std::size_t count,
                  const FaceOperation (&operations)[3], double* out) const;

private:
  std::size_t n_[3];
  std::size_t stride_[3];
  double inverse_spacing_[3];
  int dimensions_;
};

}  // namespace rubato
