#pragma once

// Internal to the cyclic block solver: what a solution leaves of the equations.

#include <algorithm>
#include <cstddef>

#include <rubato/grids/parallel.hpp>
#include <rubato/solve/cyclic_block.hpp>
#include <rubato/solve/tuning.hpp>

namespace rubato::solve::residuals {

/// out[j] = rhs - (A z + B y) of equation `row` at cells begin + j, j < count, none of which is the last cell.
void residual_of_row(const CyclicBidiagonal& a, const CyclicBorder& border, const double* rhs, const double* const* z,
                     const double* y, int row, std::size_t begin, std::size_t count, double* out);

/// The same at the last cell, whose right node is node 0.
[[nodiscard]] double residual_at_seam(const CyclicBidiagonal& a, const CyclicBorder& border, const double* rhs,
                                      const double* const* z, const double* y, int row);

/// Calls use(begin, count, row, residuals) for every row of every block of cells, in parallel. `closed`: the node
/// behind the last cell is the first one; else it is in the arrays.
template <class Use>
void for_each_residual(const CyclicBidiagonal& a, const CyclicBorder& border, const double* const* rhs,
                       const double* const* z, const double* y, bool closed, Use&& use) {
  using tuning::cyclic_block::residual_block;
  const std::size_t blocks = (a.cells + residual_block - 1) / residual_block;
  grids::for_each_index(blocks, blocks > 8, [&](std::size_t block, std::size_t) {
    double out[residual_block];
    const std::size_t begin = block * residual_block;
    const std::size_t end = std::min(begin + residual_block, a.cells);
    for (int row = 0; row < a.block; ++row) {
      const double* r = rhs != nullptr ? rhs[row] : nullptr;
      const bool has_seam = closed && end == a.cells;
      const std::size_t inner = end - begin - (has_seam ? 1 : 0);
      residual_of_row(a, border, r, z, y, row, begin, inner, out);
      if (has_seam) {
        out[inner] = residual_at_seam(a, border, r, z, y, row);
      }
      use(begin, end - begin, row, out);
    }
  });
}

}  // namespace rubato::solve::residuals
