#pragma once

#include <span>

namespace rubato {

/// True if all numbers are finite.
[[nodiscard]] bool all_finite(std::span<const double> numbers);

}  // namespace rubato
