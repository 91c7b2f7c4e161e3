#pragma once

#include <cstddef>
#include <cstdint>

namespace rubato {

/// Eight bytes as a number, the first of them the lowest, on every machine.
inline std::uint64_t little_endian(const std::byte* bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof value; ++i)
    value |= std::to_integer<std::uint64_t>(bytes[i]) << (8 * i);
  return value;
}

}  // namespace rubato
