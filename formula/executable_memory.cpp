#include <rubato/formula/executable_memory.hpp>

#include <algorithm>
#include <cstring>
#include <mutex>
#include <utility>

#include <sys/mman.h>
#include <unistd.h>

namespace rubato::formula {

namespace {

/// To ask for pages, to fill them and to change what may be done with them are calls of the system of 10 to 300 µs
/// each, the last one for all threads at once, and a lattice has a dozen codes.
constexpr std::size_t first_size = std::size_t{1} << 16U, largest_size = std::size_t{1} << 20U;

/// Where vectors are read from memory the code has them at multiples of their size.
constexpr std::size_t alignment = 64;

/// Pages that are written at one address and executed at another.
class Pages {
public:
  /// \return null if the system allows none
  static std::shared_ptr<Pages> of(std::size_t size) {
    const int file = memfd_create("rubato formulas", MFD_CLOEXEC);
    if (file < 0) {
      return nullptr;
    }
    std::shared_ptr<Pages> pages;
    if (ftruncate(file, static_cast<off_t>(size)) == 0) {
      pages =
          std::make_shared<Pages>(mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, file, 0),
                                  mmap(nullptr, size, PROT_READ | PROT_EXEC, MAP_SHARED | MAP_POPULATE, file, 0), size);
    }
    close(file);
    return pages != nullptr && pages->usable() ? pages : nullptr;
  }

  Pages(void* written, void* executed, std::size_t size)
      : written_(static_cast<std::byte*>(written)), executed_(static_cast<std::byte*>(executed)), size_(size) {}
  Pages(const Pages&) = delete;
  Pages& operator=(const Pages&) = delete;
  ~Pages() {
    for (std::byte* const place : {written_, executed_}) {
      if (place != MAP_FAILED) {
        munmap(place, size_);
      }
    }
  }

  [[nodiscard]] std::size_t size() const { return size_; }
  /// A process made by fork() has the same pages, and no room in them.
  [[nodiscard]] bool has_room_for(std::size_t size) const { return size <= size_ - used_ && process_ == getpid(); }

  /// No place is used twice: tools that translate what they find at an address are reported that it is gone when pages
  /// are.
  const std::byte* add(std::span<const std::byte> code) {
    std::memcpy(written_ + used_, code.data(), code.size());
    const std::byte* const begin = executed_ + used_;
    used_ = std::min(size_, (used_ + code.size() + alignment - 1) / alignment * alignment);
    return begin;
  }

private:
  std::byte *written_, *executed_;
  std::size_t size_, used_ = 0;
  pid_t process_ = getpid();

  [[nodiscard]] bool usable() const { return written_ != MAP_FAILED && executed_ != MAP_FAILED; }
};

/// Pages of its own, written first; for systems that do not let pages be at two addresses.
std::shared_ptr<const std::byte> pages_written_before(std::span<const std::byte> code) {
  const std::size_t size = code.size();
  void* const pages = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (pages == MAP_FAILED) {
    return nullptr;
  }
  const std::shared_ptr<const std::byte> begin(static_cast<const std::byte*>(pages),
                                               [pages, size](const std::byte*) { munmap(pages, size); });
  std::memcpy(pages, code.data(), size);
  return mprotect(pages, size, PROT_READ | PROT_EXEC) == 0 ? begin : nullptr;
}

}  // namespace

std::optional<ExecutableMemory> ExecutableMemory::with(std::span<const std::byte> code) {
  static std::mutex one_at_a_time;
  static std::weak_ptr<Pages> last;
  std::shared_ptr<const std::byte> begin;
  {
    const std::lock_guard guard(one_at_a_time);
    std::shared_ptr<Pages> pages = last.lock();
    if (pages == nullptr || !pages->has_room_for(code.size())) {
      const std::size_t usual = pages == nullptr ? first_size : std::min(2 * pages->size(), largest_size);
      pages = Pages::of(std::max(usual, code.size()));
      last = pages;
    }
    if (pages != nullptr) {
      const std::byte* const place = pages->add(code);
      begin = {std::move(pages), place};
    }
  }
  if (begin == nullptr) {
    begin = pages_written_before(code);
  }
  return begin == nullptr ? std::nullopt : std::optional(ExecutableMemory(std::move(begin)));
}

}  // namespace rubato::formula
