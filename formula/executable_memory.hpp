#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <utility>

namespace rubato::formula {

/// Pages with machine code: written first, then made executable and no longer writable, and given back at the end.
class ExecutableMemory {
public:
  /// A copy of `code`, which must run wherever it stands; nothing where the system allows no such pages.
  [[nodiscard]] static std::optional<ExecutableMemory> with(std::span<const std::byte> code);

  ExecutableMemory(ExecutableMemory&& other) noexcept
      : pages_(std::exchange(other.pages_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  ExecutableMemory& operator=(ExecutableMemory&& other) noexcept {
    std::swap(pages_, other.pages_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~ExecutableMemory();

  [[nodiscard]] void* begin() const { return pages_; }

private:
  ExecutableMemory(void* pages, std::size_t size) : pages_(pages), size_(size) {}
  void* pages_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace rubato::formula
