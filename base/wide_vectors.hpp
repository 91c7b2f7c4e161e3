#pragma once

// RUBATO_WIDE_VECTORS before a function that loops over arrays: compiled for the wide vectors of several machines, one
// of which is chosen when the program is loaded. Without fused multiply-add all give the same bits.

#if defined(__x86_64__)
#define RUBATO_WIDE_VECTORS [[gnu::target_clones("avx512f", "avx2", "default")]]
#else
#define RUBATO_WIDE_VECTORS
#endif

namespace rubato {

/// Eight numbers that loops add to: the compiler keeps these in registers, and an array of eight often not. Loaded with
/// std::memcpy, from wherever.
using EightLanes [[gnu::vector_size(64)]] = double;

}  // namespace rubato
