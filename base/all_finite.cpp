#include <rubato/base/all_finite.hpp>

#include <bit>
#include <cstdint>
#include <limits>

#include <rubato/base/wide_vectors.hpp>

namespace rubato {

RUBATO_WIDE_VECTORS bool all_finite(std::span<const double> numbers) {
  std::uint64_t largest = 0;
  for (const double number : numbers) {
    const std::uint64_t magnitude = std::bit_cast<std::uint64_t>(number) << 1U;
    largest = largest > magnitude ? largest : magnitude;
  }
  return largest < std::bit_cast<std::uint64_t>(std::numeric_limits<double>::infinity()) << 1U;
}

}  // namespace rubato
