#pragma once

#include <array>
#include <span>

#include <rubato/grids/fourier.hpp>
#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// Grid functions moved by any distance: out(x) = in(x - s), of the trigonometric polynomial through the values. Exact
/// for functions that the grid resolves; the Nyquist mode of an even number of cells is taken as a cosine. Of a slab's
/// part all ranks take part, and ghosts are left alone.
class Shift {
public:
  /// Throws std::bad_alloc. Takes about 2 · fields · size doubles.
  Shift(const Grid& grid, int fields);

  /// One array for each field, or for the first few. in[f] and out[f] may be the same.
  /// \param by s, one distance for each direction
  void operator()(std::span<const double* const> in, std::span<double* const> out, const std::array<double, 3>& by);

private:
  std::array<double, 3> lengths_{};
  std::array<std::size_t, 3> cells_{};
  Fourier transform_;
};

}  // namespace rubato::grids
