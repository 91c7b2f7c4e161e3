#include <rubato/record/detail/waiting_bytes.hpp>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <utility>

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

/// In one call whatever this source is compiled with.
void move_bytes(std::byte* to, const std::byte* from, std::size_t count) {
  if (count > 0)
    std::memmove(to, from, count);
}

}  // namespace

std::byte* WaitingBytes::append(std::size_t count) {
  const std::size_t size = size_ + count;
  if (size > capacity_) {
    capacity_ = std::max({size, expected_, 2 * capacity_});
    auto larger = std::make_unique_for_overwrite<std::byte[]>(capacity_ + room_behind);
    move_bytes(larger.get(), bytes_.get(), size_);
    bytes_ = std::move(larger);
    asked_for_ = size_;
  }
  if (size > asked_for_) {
    const std::size_t ahead = std::clamp(size_, least_ahead, most_ahead);
    const std::size_t end = std::min(size + ahead, capacity_);
    ask_for_pages(bytes_.get() + asked_for_, end - asked_for_);
    asked_for_ = end;
  }
  return bytes_.get() + std::exchange(size_, size);
}

void WaitingBytes::append(std::span<const std::byte> bytes) {
  std::byte* const place = append(bytes.size());
  move_bytes(place, bytes.data(), bytes.size());
}

void WaitingBytes::drop_front(std::size_t count) {
  size_ -= count;
  move_bytes(bytes_.get(), bytes_.get() + count, size_);
}

}  // namespace rubato::record::detail
