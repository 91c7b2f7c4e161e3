#include <cerrno>
#include <string>
#include <system_error>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record::detail {

namespace {

[[noreturn]] void fail_with_errno(const std::string& doing) {
  throw Failure(doing + ": " + std::generic_category().message(errno));
}

class Descriptor {
public:
  Descriptor(const std::filesystem::path& file, int flags, const std::string& doing)
      : descriptor_(::open(file.c_str(), flags | O_CLOEXEC, 0666)) {
    if (descriptor_ < 0)
      fail_with_errno(doing);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() { ::close(descriptor_); }

  operator int() const { return descriptor_; }  // NOLINT(google-explicit-constructor): made to be passed on

private:
  int descriptor_;
};

/// Whether the name still leads to the file that was opened: another writer may have finished and renamed it meanwhile.
bool same_file(int descriptor, const std::filesystem::path& file) {
  struct stat opened {};
  struct stat named {};
  return ::fstat(descriptor, &opened) == 0 && ::stat(file.c_str(), &named) == 0 && opened.st_dev == named.st_dev &&
         opened.st_ino == named.st_ino;
}

}  // namespace

FileLock::FileLock(const std::filesystem::path& file) {
  const std::string doing = "making the working file '" + file.filename().string() + "'";
  for (;;) {
    descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor_ < 0)
      fail_with_errno(doing);
    if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
      const bool taken = errno == EWOULDBLOCK;
      const int reason = errno;
      release();
      errno = reason;
      if (taken)
        throw Failure("another run is writing this record");
      fail_with_errno(doing);
    }
    if (same_file(descriptor_, file))
      return;
    release();
  }
}

void FileLock::release() {
  if (descriptor_ >= 0)
    ::close(descriptor_);
  descriptor_ = -1;
}

void copy_contents(const std::filesystem::path& from, const std::filesystem::path& to) {
  const Descriptor source(from, O_RDONLY, "reading '" + from.filename().string() + "'");
  // Truncated, not replaced: the target may be locked by its inode.
  const Descriptor target(to, O_WRONLY | O_CREAT | O_TRUNC, "making '" + to.filename().string() + "'");
  for (;;) {
    const ssize_t copied = ::copy_file_range(source, nullptr, target, nullptr, std::size_t{1} << 30, 0);
    if (copied == 0)
      return;
    if (copied < 0 && (errno == EXDEV || errno == ENOSYS || errno == EOPNOTSUPP || errno == EINVAL))
      break;
    if (copied < 0 && errno != EINTR)
      fail_with_errno("copying '" + from.filename().string() + "'");
  }
  std::filesystem::copy_file(from, to, std::filesystem::copy_options::overwrite_existing);
}

void reserve(const std::filesystem::path& file, std::uint64_t bytes) {
  const std::string doing = "setting aside " + std::to_string(bytes) + " bytes";
  const Descriptor descriptor(file, O_RDWR, doing);
  struct stat status {};
  if (::fstat(descriptor, &status) != 0)
    fail_with_errno(doing);
  if (::fallocate(descriptor, FALLOC_FL_KEEP_SIZE, status.st_size, static_cast<off_t>(bytes)) == 0)
    return;
  if (errno != EOPNOTSUPP && errno != ENOSYS)
    fail_with_errno(doing);
  if (std::filesystem::space(file).available < bytes) {
    errno = ENOSPC;
    fail_with_errno(doing);
  }
}

void trim(const std::filesystem::path& file) {
  std::filesystem::resize_file(file, std::filesystem::file_size(file));
}

void synchronize(const std::filesystem::path& file_or_folder) {
  const Descriptor descriptor(file_or_folder.empty() ? "." : file_or_folder, O_RDONLY, "flushing to the disk");
  // Some file systems cannot flush a folder and say EINVAL; there is nothing more to be done there.
  if (::fsync(descriptor) != 0 && errno != EINVAL)
    fail_with_errno("flushing to the disk");
}

}  // namespace rubato::record::detail
