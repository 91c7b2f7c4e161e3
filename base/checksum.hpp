#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace rubato {

/// CRC-64/XZ (ECMA-182, reflected), as the tools `xz` and `7z` compute it: finds every error of up to 64 neighbouring
/// bits, and others but for one in 2^64. It is no protection against intent. Of bytes that lie in several places it is
/// put together out of those of the pieces.
class Checksum {
public:
  Checksum() = default;
  /// Of `bytes` bytes whose value() was `value`.
  explicit Checksum(std::uint64_t value, std::uint64_t bytes = 0) : state_(~value), bytes_(bytes) {}

  void add(std::span<const std::byte> bytes);
  /// Goes on with bytes that `other` is the checksum of, all of them: appending so many zeros multiplies the remainder
  /// by a power of x modulo the polynomial, and what is not zero in them adds what it leaves by itself.
  void append(const Checksum& other);

  [[nodiscard]] std::uint64_t value() const { return ~state_; }
  /// How many were added, those before the value that it began with only if they were told.
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

private:
  std::uint64_t state_ = ~std::uint64_t{0};
  std::uint64_t bytes_ = 0;
};

}  // namespace rubato
