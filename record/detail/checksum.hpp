#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace rubato::record::detail {

/// CRC-64/XZ (ECMA-182, reflected), as the tools `xz` and `7z` compute it: finds every error of up to 64 neighbouring
/// bits, and others but for one in 2^64.
class Checksum {
public:
  void add(std::span<const std::byte> bytes);
  [[nodiscard]] std::uint64_t value() const { return ~state_; }

private:
  std::uint64_t state_ = ~std::uint64_t{0};
};

/// What is known of a whole file by the mark at its end: 24 bytes behind all that HDF5 knows of, which HDF5 passes over
/// and takes away when it writes to the file. They are "RUBATO\0" 1, the number of bytes before them, and the checksum
/// of those, both little-endian.
enum class Integrity {
  unknown,  ///< no mark: an older version or another program wrote it last
  intact,
  damaged,
};

/// Reads all of the file. Throws Failure.
[[nodiscard]] Integrity integrity_of(int descriptor);

class TemporaryFile;

/// Appends the mark. Throws Failure.
void mark(TemporaryFile& file);

}  // namespace rubato::record::detail
