#include <rubato/record/detail/waiting_bytes.hpp>

#include <algorithm>
#include <cstdint>

#include <sys/mman.h>
#include <unistd.h>

namespace rubato::record::detail {

namespace {

constexpr std::size_t least_ahead = std::size_t{16} << 10, most_ahead = std::size_t{256} << 10;

/// Asks for the whole pages among these bytes. What the system does not know or has not comes when it is written to.
void ask_for_pages([[maybe_unused]] std::byte* bytes, [[maybe_unused]] std::size_t count) {
#ifdef MADV_POPULATE_WRITE
  static const auto page = static_cast<std::uintptr_t>(::sysconf(_SC_PAGESIZE));
  const auto begin = reinterpret_cast<std::uintptr_t>(bytes);
  const std::uintptr_t first = (begin + page - 1) / page * page, end = (begin + count) / page * page;
  if (first < end)
    static_cast<void>(::madvise(reinterpret_cast<void*>(first), end - first, MADV_POPULATE_WRITE));
#endif
}

}  // namespace

void WaitingBytes::make_room(std::size_t count) {
  const std::size_t size = bytes_.size() + count;
  if (size > bytes_.capacity()) {
    bytes_.reserve(std::max({size, expected_, 2 * bytes_.capacity()}));
    asked_for_ = bytes_.size();
  }
  if (size > asked_for_) {
    const std::size_t ahead = std::clamp(bytes_.size(), least_ahead, most_ahead);
    const std::size_t end = std::min(size + ahead, bytes_.capacity());
    ask_for_pages(bytes_.data() + asked_for_, end - asked_for_);
    asked_for_ = end;
  }
}

void WaitingBytes::append(std::span<const std::byte> bytes) {
  make_room(bytes.size());
  bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
}

std::byte* WaitingBytes::append(std::size_t count) {
  make_room(count);
  bytes_.resize(bytes_.size() + count);
  return bytes_.data() + (bytes_.size() - count);
}

void WaitingBytes::drop_front(std::size_t count) {
  bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(count));
}

}  // namespace rubato::record::detail
