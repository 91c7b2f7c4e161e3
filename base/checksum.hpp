#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace rubato {

/// CRC-64/XZ (ECMA-182, reflected), as the tools `xz` and `7z` compute it. It detects every error of up to 64
/// neighbouring bits, and all but one in 2^64 of the others. It does not protect against intent.
class Checksum {
public:
  Checksum() = default;
  /// The checksum of `bytes` bytes whose value() was `value`.
  explicit Checksum(std::uint64_t value, std::uint64_t bytes = 0) : value_(value), bytes_(bytes) {}

  void add(std::span<const std::byte> bytes);
  /// Continues with the bytes of `other`, all of them: appending n bytes multiplies the remainder by x^(8n) modulo the
  /// polynomial.
  void append(const Checksum& other);

  [[nodiscard]] std::uint64_t value() const { return value_; }
  /// The number of bytes added, including those given at construction.
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

private:
  std::uint64_t value_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace rubato
