#include <rubato/base/all_finite.hpp>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>

#include <rubato/base/wide_vectors.hpp>

namespace rubato {

namespace {

/// Without its sign: as an integer it is the larger the larger the number is, and infinity and NaN are the largest.
inline std::uint64_t magnitude(double number) {
  return std::bit_cast<std::uint64_t>(number) << 1U;
}
constexpr std::uint64_t limit = std::bit_cast<std::uint64_t>(std::numeric_limits<double>::infinity()) << 1U;

/// Maxima side by side, so that none waits for the one before it. The numbers fill a vector, at least.
RUBATO_WIDE_VECTORS std::uint64_t largest_magnitude(std::span<const double> numbers) {
  using EightWords [[gnu::vector_size(64)]] = std::uint64_t;
  constexpr std::size_t words = 8, vectors = 4;
  std::array<EightWords, vectors> largest{};
  const auto take = [&](EightWords& of, std::size_t first) {
    EightWords bits;
    std::memcpy(&bits, &numbers[first], sizeof bits);
    bits <<= 1U;
    of = of > bits ? of : bits;
  };
  std::size_t i = 0;
  for (; i + vectors * words <= numbers.size(); i += vectors * words) {
    for (std::size_t k = 0; k < vectors; ++k) {
      take(largest[k], i + k * words);
    }
  }
  for (; i + words <= numbers.size(); i += words) {
    take(largest[0], i);
  }
  take(largest[1], numbers.size() - words);
  for (std::size_t k = 1; k < vectors; ++k) {
    largest[0] = largest[0] > largest[k] ? largest[0] : largest[k];
  }
  std::uint64_t of_all = 0;
  for (std::size_t k = 0; k < words; ++k) {
    of_all = of_all > largest[0][k] ? of_all : largest[0][k];
  }
  return of_all;
}

}  // namespace

bool all_finite(std::span<const double> numbers) {
  // To begin with vectors takes longer than to look at a few one by one.
  constexpr std::size_t few = 48;
  if (numbers.size() >= few) {
    return largest_magnitude(numbers) < limit;
  }
  bool all = true;
  for (const double number : numbers) {
    all = all && magnitude(number) < limit;
  }
  return all;
}

}  // namespace rubato
