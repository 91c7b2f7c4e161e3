#pragma once

#include <cstddef>
#include <type_traits>

namespace rubato::grids {

/// A block of work on one value per node: 32 KiB, what a first-level cache holds.
inline constexpr std::size_t nodes_per_block = 4096;

namespace detail {
void for_each_block(std::size_t count, std::size_t block, void (*call)(void*, std::size_t, std::size_t),
                    void* function);
void for_each_index(std::size_t count, void (*call)(void*, std::size_t, std::size_t), void* function);
}  // namespace detail

/// Calls f(begin, end) for consecutive pieces of `block` indices of [0, count), spread over OpenMP's threads. The
/// pieces do not depend on the number of threads, so that what f computes for an index cannot either. f must not throw.
template <class F>
void for_each_block(std::size_t count, std::size_t block, F&& f) {
  using Function = std::remove_reference_t<F>;
  detail::for_each_block(
      count, block,
      [](void* function, std::size_t begin, std::size_t end) { (*static_cast<Function*>(function))(begin, end); },
      const_cast<void*>(static_cast<const void*>(&f)));
}

/// Calls f(index, thread) for all indices of [0, count): spread over OpenMP's threads if that is `worth_threads`, else
/// by the caller as thread 0, without a parallel region. Threads count from 0 to thread_count() - 1. f must not throw.
template <class F>
void for_each_index(std::size_t count, bool worth_threads, F&& f) {
  if (!worth_threads) {
    for (std::size_t index = 0; index < count; ++index) {
      f(index, std::size_t{0});
    }
    return;
  }
  using Function = std::remove_reference_t<F>;
  detail::for_each_index(
      count,
      [](void* function, std::size_t index, std::size_t thread) { (*static_cast<Function*>(function))(index, thread); },
      const_cast<void*>(static_cast<const void*>(&f)));
}

/// Sets all values to `value`, each page first by the thread that `for_each_block` gives it to later.
void parallel_fill(double* values, std::size_t count, double value);

/// OpenMP's number of threads and this thread's number among them, for callers compiled without OpenMP.
int thread_count();
int thread_number();

}  // namespace rubato::grids
