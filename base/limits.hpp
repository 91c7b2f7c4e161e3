#pragma once

#include <limits>

namespace rubato {

/// The distance from 1 to the next double: what rounding once changes a value by, relative, is at most half of it.
inline constexpr double epsilon = std::numeric_limits<double>::epsilon();
inline constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace rubato
