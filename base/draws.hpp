#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace rubato {

/// Random numbers by their place, not one after the other: D. Lea's finaliser of 64-bit integers (Steele, Lea, Flood,
/// Fast splittable pseudorandom number generators, OOPSLA 2014). The same on every machine, but for what the logarithm
/// and the cosine of normal numbers round.
class Draws {
public:
  explicit Draws(std::uint64_t seed) : seed_(mixed(seed)) {}

  /// Between 0 and 1, exclusive: number `number` of row `row`.
  [[nodiscard]] double at(std::uint64_t row, std::uint64_t number) const {
    const std::uint64_t bits = mixed(mixed(seed_ ^ row) + 0x9E3779B97F4A7C15U * (number + 1));
    return (static_cast<double>(bits >> 12U) + 0.5) * 0x1p-52;
  }

  /// Normal, of mean 0 and deviation 1, by Box and Muller of the numbers 2·number and 2·number + 1 of the row.
  [[nodiscard]] double normal(std::uint64_t row, std::uint64_t number) const {
    return std::sqrt(-2.0 * std::log(at(row, 2 * number))) * std::cos(2.0 * std::numbers::pi * at(row, 2 * number + 1));
  }

private:
  static std::uint64_t mixed(std::uint64_t x) {
    x += 0x9E3779B97F4A7C15U;
    x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
    x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
    return x ^ (x >> 31U);
  }
  std::uint64_t seed_;
};

}  // namespace rubato
