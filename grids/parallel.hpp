#pragma once

#include <algorithm>
#include <cstddef>
#include <type_traits>

namespace rubato::grids {

/// A block of work on one value per node: 32 KiB, what a first-level cache holds.
inline constexpr std::size_t nodes_per_block = 4096;

namespace detail {
void for_each_index(std::size_t count, bool worth_threads, void (*call)(void*, std::size_t, std::size_t),
                    void* function);
}

/// Calls f(index, thread) for all indices of [0, count): spread over OpenMP's threads if that is `worth_threads`, else,
/// and within a parallel region of others, by the caller as thread 0, without a region. Threads count from 0 to
/// thread_count() - 1. f must not throw.
template <class F>
void for_each_index(std::size_t count, bool worth_threads, F&& f) {
  using Function = std::remove_reference_t<F>;
  detail::for_each_index(
      count, worth_threads,
      [](void* function, std::size_t index, std::size_t thread) { (*static_cast<Function*>(function))(index, thread); },
      const_cast<void*>(static_cast<const void*>(&f)));
}

/// Calls f(begin, end), or f(begin, end, thread), for consecutive pieces of `block` indices of [0, count), spread over
/// OpenMP's threads. The pieces do not depend on the number of threads, so that what f computes for an index cannot
/// either. f must not throw.
template <class F>
void for_each_block(std::size_t count, std::size_t block, F&& f) {
  const std::size_t blocks = (count + block - 1) / block;
  for_each_index(blocks, blocks > 1, [&](std::size_t number, std::size_t thread) {
    const std::size_t begin = number * block, end = std::min(begin + block, count);
    if constexpr (std::is_invocable_v<F&, std::size_t, std::size_t, std::size_t>) {
      f(begin, end, thread);
    } else {
      f(begin, end);
    }
  });
}

/// Sets all values to `value`, each page first by the thread that `for_each_block` gives it to later.
void parallel_fill(double* values, std::size_t count, double value);

/// OpenMP's number of threads, for callers compiled without OpenMP.
int thread_count();

}  // namespace rubato::grids
