#include <rubato/grids/parallel.hpp>

#include <omp.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>

namespace rubato::grids {

void detail::for_each_index(std::size_t count, bool worth_threads, void (*call)(void*, std::size_t, std::size_t),
                            void* function) {
  // A parallel region costs about a microsecond even where it has one thread, whose barrier is a call of the system.
  // Within a region of others (members of an ensemble) every thread has work of its own.
  if (!worth_threads || omp_get_max_threads() == 1 || omp_in_parallel() != 0) {
    for (std::size_t index = 0; index < count; ++index) {
      call(function, index, 0);
    }
    return;
  }
#pragma omp parallel for schedule(static)
  for (std::ptrdiff_t index = 0; index < static_cast<std::ptrdiff_t>(count); ++index) {
    call(function, static_cast<std::size_t>(index), static_cast<std::size_t>(omp_get_thread_num()));
  }
}

void parallel_fill(double* values, std::size_t count, double value) {
  const bool all_bits_zero = std::bit_cast<std::uint64_t>(value) == 0;
  for_each_block(count, nodes_per_block, [&](std::size_t begin, std::size_t end) {
    if (all_bits_zero) {
      std::memset(values + begin, 0, (end - begin) * sizeof(double));
    } else {
      std::fill(values + begin, values + end, value);
    }
  });
}

int thread_count() {
  return omp_get_max_threads();
}

}  // namespace rubato::grids
