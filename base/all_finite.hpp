#pragma once

#include <span>

namespace rubato {

/// Whether all numbers are finite.
[[nodiscard]] bool all_finite(std::span<const double> numbers);

}  // namespace rubato
