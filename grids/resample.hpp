#pragma once

#include <span>
#include <vector>

#include <rubato/grids/grid.hpp>

namespace rubato::grids {

/// Values at the nodes of `to` of the trigonometric interpolant of `values`, given at the nodes of `from`: the one of
/// least frequencies, with the cosine of the highest wave alone where a number of cells is even. Exact for functions
/// that `from` resolves, whatever the number of cells of `to`; to the same nodes it is the identity up to rounding.
/// \throws std::invalid_argument unless both grids cover the same box
[[nodiscard]] std::vector<double> resampled(std::span<const double> values, const Grid& from, const Grid& to);

}  // namespace rubato::grids
