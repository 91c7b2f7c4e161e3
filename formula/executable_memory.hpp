#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <utility>

namespace rubato::formula {

/// Machine code that can be called: copied to pages that are never writable where they are executable. Codes share
/// them, and give them back when the last one ends. From all threads at once.
class ExecutableMemory {
public:
  /// A copy of `code`, at a multiple of 64 bytes, which must run wherever it stands; nothing where the system allows no
  /// such pages.
  [[nodiscard]] static std::optional<ExecutableMemory> with(std::span<const std::byte> code);

  [[nodiscard]] const std::byte* begin() const { return begin_.get(); }

private:
  explicit ExecutableMemory(std::shared_ptr<const std::byte> begin) : begin_(std::move(begin)) {}
  std::shared_ptr<const std::byte> begin_;  ///< which keeps its pages
};

}  // namespace rubato::formula
