#pragma once

#include <cstddef>

namespace rubato::grids {

/// The largest |v_i|; `poison`, 0 before, becomes NaN with a value that is not finite, and the result then says
/// nothing.
double largest_magnitude(const double* values, std::size_t count, double& poison);

}  // namespace rubato::grids
