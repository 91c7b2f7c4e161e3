#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>

#include <sys/types.h>

namespace rubato::record::detail {

/// A file that the system has opened, closed again at the end.
class Descriptor {
public:
  Descriptor() = default;
  explicit Descriptor(int number) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor();

  [[nodiscard]] int number() const { return number_; }

private:
  int number_ = -1;
};

/// Opens an existing regular file for reading, by way of symbolic links too. Anything else (a folder, a device, a pipe
/// that nobody writes to) is refused without waiting for it. Throws Failure.
[[nodiscard]] Descriptor open_regular(const std::filesystem::path& file);

/// True if the name leads to the file that was opened, and not to one that took its place.
[[nodiscard]] bool leads_to(const std::filesystem::path& file, int descriptor);

[[nodiscard]] bool same_file(int descriptor, int other);

[[nodiscard]] std::uint64_t size_of(int descriptor);

/// An exclusive lock (flock) on an empty file of its own, `NAME.lock`, which is made if there is none and removed while
/// the lock is still held: the caller that holds it is the only one who may write the record NAME. The lock of a
/// process that died is gone, and its file is taken over. Throws Failure if another process has it, or if something
/// that is no lock is in its place.
class FileLock {
public:
  explicit FileLock(std::filesystem::path file);
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;
  ~FileLock();

private:
  std::filesystem::path file_;
  Descriptor descriptor_;
};

/// Who may do what with a file.
struct Access {
  mode_t mode;
  uid_t owner;
  gid_t group;
};
[[nodiscard]] Access access_of(int descriptor);

/// A file made beside another one, whose place it may take when it is complete: `NAME.<random>.ENDING`. It is created
/// exclusively, so that no link is followed and nothing that exists is opened, and is removed at the end unless it was
/// published. While it is being written only its owner can read it. All members throw Failure.
class TemporaryFile {
public:
  TemporaryFile(const std::filesystem::path& target, std::string_view ending);
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] int descriptor() const { return descriptor_.number(); }
  /// A name for libraries that open files by name; it leads to this file even if another has taken its place.
  [[nodiscard]] std::string name_of_descriptor() const;

  /// Takes over all contents of another file, sharing blocks where the file system can.
  void copy_from(int source);

  /// Sets disk space aside beyond the end of the file, so that a full disk is found out here: HDF5 1.10 does not
  /// survive a write that fails while a file is being closed.
  void reserve(std::uint64_t bytes);
  /// Gives back what was reserved and not used.
  void trim();
  void append(std::string_view bytes);

  /// Waits until the contents are on the disk.
  void synchronize();

  enum class Replace { yes, no };
  /// Renames it to `target`, with the access given (that of what is replaced), or else that of new files. False, and
  /// nothing is done, with Replace::no where something is there already.
  [[nodiscard]] bool publish(const std::filesystem::path& target, const Access* access, Replace replace);

private:
  std::filesystem::path path_;
  Descriptor descriptor_;
  bool is_published_ = false;
};

/// Removes what TemporaryFile left beside `target` in processes that were killed; those at work keep a lock on theirs.
void remove_leftovers(const std::filesystem::path& target);

/// Waits until the names in a folder are on the disk.
void synchronize_folder(const std::filesystem::path& folder);

}  // namespace rubato::record::detail
