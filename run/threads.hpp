#pragma once

namespace rubato {

inline constexpr int most_threads = 1024;

/// Lets what follows in this thread run on so many threads; 0 leaves OpenMP's choice, which OMP_NUM_THREADS makes.
/// \throws std::invalid_argument if there are more than `most_threads` (OpenMP would end the process when it cannot
/// have them)
void use_threads(int threads);

}  // namespace rubato
