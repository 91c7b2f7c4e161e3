#include "disk.hpp"

#include <algorithm>
#include <cerrno>
#include <span>
#include <stdexcept>
#include <string_view>

#include <sys/mount.h>
#include <sys/stat.h>

#define FUSE_USE_VERSION 31
#include <fuse.h>

namespace {

constexpr std::size_t superblock = 4096;  // a file system relies on its being written as one, or not at all

}

std::vector<char> History::contents_after(std::size_t count, std::size_t piece, double kept,
                                          std::mt19937& random) const {
  const std::span<const Request> done(requests.data(), count);
  const auto is_flush = [](const Request& request) { return request.data.empty(); };
  const auto unsure = std::find_if(done.rbegin(), done.rend(), is_flush).base();

  std::vector<char> contents = start;
  const auto write = [&contents](std::size_t offset, std::span<const char> data) {
    std::ranges::copy(data, contents.begin() + static_cast<std::ptrdiff_t>(offset));
  };
  for (auto request = done.begin(); request != unsure; ++request) {
    write(request->offset, request->data);
  }
  struct Piece {
    std::size_t offset;
    std::span<const char> data;
  };
  std::vector<Piece> pieces;
  std::bernoulli_distribution keep(kept);
  for (auto request = unsure; request != done.end(); ++request) {
    for (std::size_t i = 0, size = 0; i < request->data.size(); i += size) {
      const std::size_t offset = request->offset + i;
      const std::size_t whole = offset < superblock ? superblock : piece;
      size = std::min(whole - offset % whole, request->data.size() - i);
      if (keep(random)) {
        pieces.push_back({offset, std::span(request->data).subspan(i, size)});
      }
    }
  }
  std::ranges::shuffle(pieces, random);
  for (const Piece& one : pieces) {
    write(one.offset, one.data);
  }
  return contents;
}

/// What FUSE calls, in one thread.
struct Disk::Operations {
  static Disk& disk() { return *static_cast<Disk*>(fuse_get_context()->private_data); }

  static int getattr(const char* path, struct stat* status, fuse_file_info* /*file*/) {
    if (std::string_view(path) == "/") {
      status->st_mode = S_IFDIR | 0700;
      return 0;
    }
    if (std::string_view(path) != "/disk") {
      return -ENOENT;
    }
    const std::lock_guard lock(disk().mutex_);
    status->st_mode = S_IFREG | 0600;
    status->st_size = static_cast<off_t>(disk().contents_.size());
    return 0;
  }

  static int open(const char* /*path*/, fuse_file_info* file) {
    file->direct_io = 1;
    return 0;
  }

  /// The part of the contents at `offset`, of at most `size` bytes.
  static std::span<char> part(off_t offset, std::size_t size) {
    const std::span<char> all = disk().contents_;
    const std::size_t first = std::min(static_cast<std::size_t>(offset), all.size());
    return all.subspan(first, std::min(size, all.size() - first));
  }

  static int read(const char* /*path*/, char* data, std::size_t size, off_t offset, fuse_file_info* /*file*/) {
    const std::lock_guard lock(disk().mutex_);
    const std::span<char> from = part(offset, size);
    std::ranges::copy(from, data);
    return static_cast<int>(from.size());
  }

  static int write(const char* /*path*/, const char* data, std::size_t size, off_t offset, fuse_file_info* /*file*/) {
    const std::lock_guard lock(disk().mutex_);
    const std::span<char> to = part(offset, size);
    if (to.empty()) {
      return -ENOSPC;
    }
    std::copy_n(data, to.size(), to.begin());
    disk().history_.requests.push_back({static_cast<std::size_t>(offset), {to.begin(), to.end()}});
    return static_cast<int>(to.size());
  }

  static int fsync(const char* /*path*/, int /*data_only*/, fuse_file_info* /*file*/) {
    const std::lock_guard lock(disk().mutex_);
    disk().history_.requests.push_back({});
    return 0;
  }
};

Disk::Disk(const std::filesystem::path& folder) : folder_(folder) {
  fuse_operations operations{};
  operations.getattr = Operations::getattr;
  operations.open = Operations::open;
  operations.read = Operations::read;
  operations.write = Operations::write;
  operations.fsync = Operations::fsync;
  char name[] = "disk";
  char* arguments[] = {name, nullptr};
  fuse_args list = FUSE_ARGS_INIT(1, arguments);
  fuse_ = fuse_new(&list, &operations, sizeof operations, this);
  if (fuse_ == nullptr || fuse_mount(fuse_, folder.c_str()) != 0) {
    throw std::runtime_error("FUSE cannot show a file in " + folder.string());
  }
  thread_ = std::thread([this] { fuse_loop(fuse_); });
}

Disk::~Disk() {
  ::umount2(folder_.c_str(), MNT_DETACH);  // ends the loop
  thread_.join();
  fuse_unmount(fuse_);
  fuse_destroy(fuse_);
}

void Disk::insert(std::vector<char> contents) {
  const std::lock_guard lock(mutex_);
  contents_ = contents;
  history_ = {std::move(contents), {}};
}

History Disk::history() const {
  const std::lock_guard lock(mutex_);
  return history_;
}

std::size_t Disk::requests() const {
  const std::lock_guard lock(mutex_);
  return history_.requests.size();
}
