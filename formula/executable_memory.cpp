#include <rubato/formula/executable_memory.hpp>

#include <cstring>

#include <sys/mman.h>

namespace rubato::formula {

std::optional<ExecutableMemory> ExecutableMemory::with(std::span<const std::byte> code) {
  void* const pages = mmap(nullptr, code.size(), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (pages == MAP_FAILED) {
    return std::nullopt;
  }
  ExecutableMemory memory(pages, code.size());
  std::memcpy(pages, code.data(), code.size());
  if (mprotect(pages, code.size(), PROT_READ | PROT_EXEC) != 0) {
    return std::nullopt;
  }
  return memory;
}

ExecutableMemory::~ExecutableMemory() {
  if (pages_ != nullptr) {
    munmap(pages_, size_);
  }
}

}  // namespace rubato::formula
