#pragma once

#include <filesystem>
#include <string>

namespace rubato {

/// Memory that this process can still take, in bytes, and what limits it.
struct AvailableMemory {
  double bytes = 0.0;
  std::string limit;
};

/// Returns the least of the machine's free memory, the room in the control groups (versions 1 and 2) of the process,
/// and that under `ulimit -v` and `ulimit -d`. \param root the folder that has /proc and /sys
[[nodiscard]] AvailableMemory available_memory(const std::filesystem::path& root = "/");

/// \throws std::invalid_argument if `bytes` exceed available_memory(). The message begins with `what`.
void require_memory(double bytes, const std::string& what);

/// The most memory that this process has held so far, in bytes.
[[nodiscard]] double peak_memory();

/// Lowers `ulimit -d` to the memory that is available, with swap: an allocation beyond it then fails with
/// std::bad_alloc, where the kernel would kill the process when it writes there.
void fail_beyond_available_memory();

}  // namespace rubato
