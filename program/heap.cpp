#include "heap.hpp"

#include <cstdint>
#include <cstdlib>

#ifdef __GLIBC__
#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>
#endif

namespace rubato::program {

void prepare_heap() {
#if defined(__GLIBC__) && defined(MADV_POPULATE_WRITE)
  // A run of an orbit touches some 2.4 MB, of which HDF5 clears half a MB twice; from blocks of a MB on the allocator
  // maps each by itself as before.
  constexpr int taken = 2 << 20, mapped_from = 1 << 20, kept = 16 << 20;
  mallopt(M_MMAP_THRESHOLD, mapped_from);
  mallopt(M_TRIM_THRESHOLD, kept);
  mallopt(M_TOP_PAD, taken);
  // More than is free: the heap grows by the padding.
  constexpr std::size_t more_than_free = 256 << 10;
  void* const block = std::malloc(more_than_free);
  void* const end = sbrk(0);
  if (block != nullptr) {
    const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
    const std::uintptr_t first = reinterpret_cast<std::uintptr_t>(block) / page * page;
    const auto last = reinterpret_cast<std::uintptr_t>(end);
    if (first < last && last - first <= 2 * static_cast<std::uintptr_t>(taken)) {
      static_cast<void>(madvise(reinterpret_cast<void*>(first), last - first, MADV_POPULATE_WRITE));
    }
    std::free(block);
  }
  mallopt(M_TOP_PAD, 128 << 10);  // as it was
#endif
}

}  // namespace rubato::program
