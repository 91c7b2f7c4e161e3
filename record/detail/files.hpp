#pragma once

#include <cstdint>
#include <filesystem>

namespace rubato::record::detail {

/// Makes a file if there is none, and holds an exclusive lock (flock) on it until destroyed or released: while it is
/// held, no other writer of the same record starts. The lock of a process that died is gone. Throws Failure.
class FileLock {
public:
  explicit FileLock(const std::filesystem::path& file);
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;
  ~FileLock() { release(); }

  void release();

private:
  int descriptor_ = -1;
};

/// Copies the contents, sharing blocks where the file system can. Throws Failure.
void copy_contents(const std::filesystem::path& from, const std::filesystem::path& to);

/// Sets disk space aside beyond the end of the file, so that a full disk is found out here: HDF5 1.10 does not survive
/// a write that fails while a file is being closed. Throws Failure if there is not enough.
void reserve(const std::filesystem::path& file, std::uint64_t bytes);

/// Gives back what was reserved and not used.
void trim(const std::filesystem::path& file);

/// Waits until a file, or the names in a folder, are on the disk. Throws Failure.
void synchronize(const std::filesystem::path& file_or_folder);

}  // namespace rubato::record::detail
