#include <algorithm>
#include <array>
#include <cerrno>
#include <random>
#include <string>
#include <system_error>
#include <vector>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fmt/format.h>

#include <rubato/record/detail/failure.hpp>
#include <rubato/record/detail/files.hpp>

namespace rubato::record::detail {

namespace {

constexpr std::size_t random_digits = 12;

[[noreturn]] void fail_with_errno(const std::string& doing) {
  throw Failure(doing + ": " + std::generic_category().message(errno));
}

std::filesystem::path folder_of(const std::filesystem::path& file) {
  return file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
}

/// A new file cannot be made.
[[noreturn]] void fail_to_make(const std::filesystem::path& file, const std::string& doing) {
  const int error = errno;
  std::error_code ignored;
  if (error == ENOENT && !std::filesystem::exists(folder_of(file), ignored))
    throw Failure(fmt::format("the folder '{}' does not exist; create it", folder_of(file).string()));
  errno = error;
  fail_with_errno(doing);
}

/// Whether flock() failed since the file system has no locks.
bool has_no_locks(int error) {
  constexpr int not_supported = 524;  // ENOTSUPP, which some file systems let through from the kernel
  return error == ENOLCK || error == ENOSYS || error == EOPNOTSUPP || error == not_supported;
}

struct stat status_of(int descriptor) {
  struct stat status {};
  if (::fstat(descriptor, &status) != 0)
    fail_with_errno("looking at a file");
  return status;
}

/// The mode of a new file where the user's wishes (umask) decide, found without changing them.
mode_t mode_of_new_files(const std::filesystem::path& folder) {
  const int probe = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
  if (probe < 0)  // not every file system knows nameless files
    return 0644;
  const Descriptor descriptor(probe);
  return status_of(probe).st_mode & 0777;
}

std::string random_name() {
  std::random_device random;
  std::string name;
  while (name.size() < random_digits)
    name += "0123456789abcdef"[random() % 16];
  return name;
}

/// Whether `name` is "NAME.<random>.ENDING" as TemporaryFile makes it.
bool is_temporary(std::string_view name, std::string_view target) {
  if (!name.starts_with(target) || !name.substr(target.size()).starts_with('.'))
    return false;
  name.remove_prefix(target.size() + 1);
  const std::string_view digits = name.substr(0, std::min(name.size(), random_digits));
  const std::string_view ending = name.substr(digits.size());
  return digits.size() == random_digits && digits.find_first_not_of("0123456789abcdef") == std::string_view::npos &&
         (ending == ".partial" || ending == ".next");
}

/// Opens the file of a lock, made by this program or by nobody: regular and empty.
Descriptor open_lock(const std::filesystem::path& file) {
  const std::string name = "'" + file.filename().string() + "'";
  constexpr int flags = O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC;
  int number = ::open(file.c_str(), flags | O_CREAT | O_EXCL, 0666);
  if (number < 0 && errno == EEXIST) {
    struct stat status {};
    const bool is_lock = ::lstat(file.c_str(), &status) == 0 ? S_ISREG(status.st_mode) && status.st_size == 0
                                                             : errno == ENOENT;  // gone meanwhile
    if (!is_lock)
      throw Failure(name + " is in the way, and is no lock of this program: move it elsewhere");
    number = ::open(file.c_str(), flags | O_CREAT, 0666);
  }
  if (number < 0)
    fail_to_make(file, "making the lock " + name);
  Descriptor descriptor(number);
  const struct stat status = status_of(number);
  if (!S_ISREG(status.st_mode) || status.st_size != 0)
    throw Failure(name + " is in the way, and is no lock of this program: move it elsewhere");
  return descriptor;
}

/// For file systems that cannot copy by themselves.
void copy_by_hand(int source, int target) {
  std::vector<char> block(std::size_t{1} << 20);
  off_t place = 0;
  for (;;) {
    const ssize_t count = ::pread(source, block.data(), block.size(), place);
    if (count == 0)
      return;
    if (count < 0 && errno != EINTR)
      fail_with_errno("copying the file");
    for (ssize_t done = 0; done < count;) {
      const ssize_t written =
          ::pwrite(target, block.data() + done, static_cast<std::size_t>(count - done), place + done);
      if (written < 0 && errno != EINTR)
        fail_with_errno("copying the file");
      done += std::max<ssize_t>(written, 0);
    }
    place += std::max<ssize_t>(count, 0);
  }
}

}  // namespace

Descriptor::~Descriptor() {
  if (number_ >= 0)
    ::close(number_);
}

Descriptor open_regular(const std::filesystem::path& file) {
  const int number = ::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
  if (number < 0)
    throw Failure(errno == ENOENT ? "no such file" : "cannot be opened: " + std::generic_category().message(errno));
  Descriptor descriptor(number);
  if (!S_ISREG(status_of(number).st_mode))
    throw Failure("is not a regular file");
  return descriptor;
}

bool leads_to(const std::filesystem::path& file, int descriptor) {
  const struct stat opened = status_of(descriptor);
  struct stat named {};
  return ::stat(file.c_str(), &named) == 0 && opened.st_dev == named.st_dev && opened.st_ino == named.st_ino;
}

bool same_file(int descriptor, int other) {
  const struct stat one = status_of(descriptor);
  const struct stat two = status_of(other);
  return one.st_dev == two.st_dev && one.st_ino == two.st_ino;
}

std::uint64_t size_of(int descriptor) {
  return static_cast<std::uint64_t>(status_of(descriptor).st_size);
}

FileLock::FileLock(std::filesystem::path file) : file_(std::move(file)) {
  for (;;) {
    Descriptor descriptor = open_lock(file_);
    if (::flock(descriptor.number(), LOCK_EX | LOCK_NB) != 0) {
      if (errno == EWOULDBLOCK)
        throw Failure("another run is writing this record");
      if (has_no_locks(errno)) {
        ::unlink(file_.c_str());
        throw Failure(
            "the file system of its folder has no locks; --no-lock writes without one (then let no other run write "
            "this record)");
      }
      fail_with_errno("locking '" + file_.filename().string() + "'");
    }
    // The one who had it may have removed the file between our opening and locking it.
    if (leads_to(file_, descriptor.number())) {
      descriptor_ = std::move(descriptor);
      return;
    }
  }
}

FileLock::~FileLock() {
  if (descriptor_.number() >= 0)
    ::unlink(file_.c_str());  // while it is held, so that nobody locks a file that has no name any more
}

Access access_of(int descriptor) {
  const struct stat status = status_of(descriptor);
  return {status.st_mode & 0777, status.st_uid, status.st_gid};
}

TemporaryFile::TemporaryFile(const std::filesystem::path& target, std::string_view ending) {
  for (;;) {
    path_ = target;
    path_ += fmt::format(".{}.{}", random_name(), ending);
    const int number = ::open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (number >= 0) {
      descriptor_ = Descriptor(number);
      static_cast<void>(::flock(number, LOCK_EX | LOCK_NB));  // says that somebody is at work on it
      return;
    }
    if (errno != EEXIST)
      fail_to_make(target, "making a working file beside it");
  }
}

TemporaryFile::~TemporaryFile() {
  if (!is_published_)
    ::unlink(path_.c_str());
}

std::string TemporaryFile::name_of_descriptor() const {
  std::string name = fmt::format("/proc/self/fd/{}", descriptor());
  return leads_to(name, descriptor()) ? name : path_.string();
}

void TemporaryFile::copy_from(int source) {
  for (off_t place = 0;;) {
    const ssize_t copied = ::copy_file_range(source, &place, descriptor(), nullptr, std::size_t{1} << 30, 0);
    if (copied == 0)
      break;
    if (copied < 0 && (errno == EXDEV || errno == ENOSYS || errno == EOPNOTSUPP || errno == EINVAL)) {
      copy_by_hand(source, descriptor());
      break;
    }
    if (copied < 0 && errno != EINTR)
      fail_with_errno("copying the file");
  }
  if (size_of(descriptor()) != size_of(source))  // some file systems copy nothing and say nothing
    copy_by_hand(source, descriptor());
}

void TemporaryFile::reserve(std::uint64_t bytes) {
  const std::string doing = "setting aside " + std::to_string(bytes) + " bytes";
  if (::fallocate(descriptor(), FALLOC_FL_KEEP_SIZE, static_cast<off_t>(size_of(descriptor())),
                  static_cast<off_t>(bytes)) == 0)
    return;
  if (errno != EOPNOTSUPP && errno != ENOSYS)
    fail_with_errno(doing);
  if (std::filesystem::space(path_).available < bytes) {
    errno = ENOSPC;
    fail_with_errno(doing);
  }
}

void TemporaryFile::trim() {
  if (::ftruncate(descriptor(), static_cast<off_t>(size_of(descriptor()))) != 0)
    fail_with_errno("giving back disk space");
}

void TemporaryFile::append(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(descriptor(), bytes.data(), bytes.size(), static_cast<off_t>(size_of(descriptor())));
    if (written < 0 && errno != EINTR)
      fail_with_errno("writing the file");
    bytes.remove_prefix(static_cast<std::size_t>(std::max<ssize_t>(written, 0)));
  }
}

void TemporaryFile::synchronize() {
  if (::fsync(descriptor()) != 0)
    fail_with_errno("flushing to the disk");
}

bool TemporaryFile::publish(const std::filesystem::path& target, const Access* access, Replace replace) {
  mode_t mode = access ? access->mode : mode_of_new_files(folder_of(target));
  if (access) {
    const Access own = access_of(descriptor());
    if (own.owner != access->owner && ::fchown(descriptor(), access->owner, static_cast<gid_t>(-1)) != 0)
      errno = 0;  // somebody else's record is replaced by one's own
    // Where the group cannot be kept, its rights must not go to another one.
    if (own.group != access->group && ::fchown(descriptor(), static_cast<uid_t>(-1), access->group) != 0)
      mode &= ~static_cast<mode_t>(0070);
  }
  if (::fchmod(descriptor(), mode) != 0)
    fail_with_errno("setting the permissions of the file");
  const char* const doing = "putting the file into its place";
  static_cast<void>(::flock(descriptor(), LOCK_UN));  // HDF5's own readers lock what they open
  int result = 0;
  if (replace == Replace::yes) {
    result = ::rename(path_.c_str(), target.c_str());
  } else {
    result = ::renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, target.c_str(), RENAME_NOREPLACE);
    if (result != 0 && (errno == EINVAL || errno == ENOSYS)) {
      // A file system that cannot: a second name is refused where there is one, too.
      result = ::link(path_.c_str(), target.c_str());
      if (result == 0)
        ::unlink(path_.c_str());
    }
    if (result != 0 && errno == EEXIST)
      return false;
  }
  if (result != 0)
    fail_with_errno(doing);
  is_published_ = true;
  return true;
}

void remove_leftovers(const std::filesystem::path& target) {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folder_of(target), ignored)) {
    if (!is_temporary(entry.path().filename().string(), target.filename().string()))
      continue;
    const Descriptor left(::open(entry.path().c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
    if (left.number() >= 0 && S_ISREG(status_of(left.number()).st_mode) &&
        ::flock(left.number(), LOCK_EX | LOCK_NB) == 0)
      ::unlink(entry.path().c_str());
  }
}

void synchronize_folder(const std::filesystem::path& folder) {
  const Descriptor descriptor(
      ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_NONBLOCK | O_CLOEXEC));
  if (descriptor.number() < 0)
    return;  // a folder that may be entered and written to, but not read
  // Some file systems cannot flush a folder and say EINVAL; there is nothing more to be done there.
  if (::fsync(descriptor.number()) != 0 && errno != EINVAL)
    fail_with_errno("flushing to the disk");
}

}  // namespace rubato::record::detail
