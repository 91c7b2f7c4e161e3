#pragma once

#include <cstring>
#include <span>

namespace rubato {

/// True if arrays have the same numbers, bit by bit: 0 is not -0 here, and NaN is NaN. Whether a level is the one that
/// something is known of is asked at every step.
[[nodiscard]] inline bool same_bits(std::span<const double> a, std::span<const double> b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

}  // namespace rubato
