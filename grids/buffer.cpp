#include <rubato/grids/buffer.hpp>

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <limits>
#include <new>

namespace rubato::grids {

namespace {

/// Bytes from which an array is a mapping of its own, with pages of 2 MiB where the system has them: several of them
/// have to fit, or most of the last one is wasted.
constexpr std::size_t large = std::size_t{1} << 22;

}  // namespace

Buffer::Buffer(std::size_t size) : size_(size) {
  if (size == 0) {
    return;
  }
  if (size > std::numeric_limits<std::size_t>::max() / sizeof(double) - alignment) {
    throw std::bad_alloc();
  }
  const std::size_t bytes = size * sizeof(double);
  if (bytes >= large) {
    void* const block = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (block == MAP_FAILED) {
      throw std::bad_alloc();
    }
#ifdef MADV_HUGEPAGE
    static_cast<void>(::madvise(block, bytes, MADV_HUGEPAGE));  // a wish: without it pages are small
#endif
    data_ = Owned(static_cast<double*>(block), Free{block, bytes});
    return;
  }
  void* const block = std::calloc(bytes + alignment, 1);
  if (block == nullptr) {
    throw std::bad_alloc();
  }
  const auto place = reinterpret_cast<std::uintptr_t>(block);
  const std::size_t to_boundary = (alignment - place % alignment) % alignment;
  data_ = Owned(reinterpret_cast<double*>(static_cast<char*>(block) + to_boundary), Free{block, 0});
}

void Buffer::forget(std::size_t first, std::size_t count) {
  if (!data_ || data_.get_deleter().of_system == 0) {
    return;
  }
  const auto page = static_cast<std::uintptr_t>(::sysconf(_SC_PAGESIZE));
  const auto begin = (reinterpret_cast<std::uintptr_t>(data_.get() + first) + page - 1) / page * page;
  const auto end = reinterpret_cast<std::uintptr_t>(data_.get() + first + count) / page * page;
  if (begin < end) {
    static_cast<void>(::madvise(reinterpret_cast<void*>(begin), end - begin, MADV_DONTNEED));
  }
}

void Buffer::Free::operator()(double*) const {
  if (of_system > 0) {
    ::munmap(block, of_system);
  } else {
    std::free(block);
  }
}

}  // namespace rubato::grids
