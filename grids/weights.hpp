#pragma once

#include <cstddef>
#include <span>

#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// Multiplies each value by Grid::weight() of its node; they are those of the nodes from `first` on.
void weigh(const Grid& grid, std::size_t first, std::span<double> values);

}  // namespace rubato::grids
