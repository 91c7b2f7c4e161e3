#pragma once

// The instruction set of a machine's narrowest kernels, whose vectors have two doubles: its name in xsimd.

#if defined(__x86_64__)
#define RUBATO_XSIMD_PAIR sse2
#else
#define RUBATO_XSIMD_PAIR neon64
#endif
