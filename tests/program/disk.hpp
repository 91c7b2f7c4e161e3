#pragma once

#include <cstddef>
#include <filesystem>
#include <mutex>
#include <random>
#include <thread>
#include <vector>

struct fuse;

/// What was asked of a disk, in this order.
struct History {
  struct Request {
    std::size_t offset = 0;
    std::vector<char> data;  ///< empty: a flush, after which all that was written before is there for good
  };
  std::vector<char> start;  ///< contents before the first request
  std::vector<Request> requests;

  /// What a power failure after the first `count` requests may leave: all that was written before the last flush among
  /// them, and of what was written since then each piece with probability `kept`, in random order. Pieces end at
  /// multiples of `piece` bytes; the first 4 KiB are one.
  [[nodiscard]] std::vector<char> contents_after(std::size_t count, std::size_t piece, double kept,
                                                 std::mt19937& random) const;
};

/// A disk in memory that keeps its history; FUSE shows it as the file `FOLDER/disk`, for a loop device. The file is
/// there until the destructor; it must not be in use by then. Nothing of it is cached on the way. Throws
/// std::runtime_error.
class Disk {
public:
  explicit Disk(const std::filesystem::path& folder);
  Disk(const Disk&) = delete;
  Disk& operator=(const Disk&) = delete;
  ~Disk();

  [[nodiscard]] std::filesystem::path file() const { return folder_ / "disk"; }

  /// A new history begins. All contents have the same size, that of the first.
  void insert(std::vector<char> contents);
  [[nodiscard]] History history() const;
  [[nodiscard]] std::size_t requests() const;  ///< so far

private:
  struct Operations;

  std::filesystem::path folder_;
  mutable std::mutex mutex_;
  std::vector<char> contents_;
  History history_;
  fuse* fuse_ = nullptr;
  std::thread thread_;
};
