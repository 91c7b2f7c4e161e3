#pragma once

#include <cstdint>
#include <vector>

#include <rubato/base/checksum.hpp>

namespace rubato::record::detail {

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
