#pragma once

// The only header that shows HDF5; not installed.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <hdf5.h>

#include <rubato/record/detail/failure.hpp>
#include <rubato/record/error.hpp>
#include <rubato/record/layout.hpp>
#include <rubato/record/no_memory.hpp>

namespace rubato::record::detail {

/// Debian's serial HDF5 is not safe for threads: every use of it holds this one lock of the process. While it is held,
/// HDF5 prints nothing on its own; the printing that the host program chose is restored afterwards.
class Session {
public:
  Session();
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

private:
  std::lock_guard<std::recursive_mutex> lock_;
  H5E_auto2_t print_ = nullptr;
  void* print_data_ = nullptr;
};

/// Throws a Failure "doing: reason" with the innermost reason on HDF5's error stack.
[[noreturn]] void fail(const std::string& doing);

/// Passes on what an HDF5 function returned, unless it says failure (negative).
template <class T>
T check(T returned, const std::string& doing) {
  if (returned < 0)
    fail(doing);
  return returned;
}

/// An HDF5 identifier with its closing function.
class Handle {
public:
  using Close = herr_t (*)(hid_t);

  Handle() = default;
  Handle(hid_t id, Close closing, const std::string& doing) : id_(check(id, doing)), close_(closing) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, H5I_INVALID_HID)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Handle() {
    if (id_ >= 0)
      close_(id_);
  }

  /// Leaves it open.
  void release() { id_ = H5I_INVALID_HID; }
  /// Closes now, and reports failure: closing a file is what writes the rest of it.
  void close(const std::string& doing) { check(close_(std::exchange(id_, H5I_INVALID_HID)), doing); }

  operator hid_t() const { return id_; }  // NOLINT(google-explicit-constructor): made to be passed to HDF5

private:
  hid_t id_ = H5I_INVALID_HID;
  Close close_ = nullptr;
};

/// Runs `action` inside a Session; what fails becomes an Error about `file`.
template <class Action>
auto with_file(const std::filesystem::path& file, Action&& action) {
  const Session session;
  try {
    return std::forward<Action>(action)();
  } catch (const NoMemoryFailure& failure) {
    throw NoMemory(file, failure.what());
  } catch (const Failure& failure) {
    throw Error(file, failure.what());
  } catch (const std::filesystem::filesystem_error& failure) {
    throw Error(file, failure.code().message());
  }
}

/// Files are opened without HDF5's own locks: a published file is never written to, and a file being written is known
/// to nobody else. New ones are of the format of HDF5 1.8, whose bookkeeping has checksums.
[[nodiscard]] Handle create_file(const std::filesystem::path& file);
[[nodiscard]] Handle open_file(const std::filesystem::path& file, unsigned flags);
/// What the system opened for it.
[[nodiscard]] int descriptor_of(hid_t file);

[[nodiscard]] Handle open_dataset(hid_t file, const std::string& path);
[[nodiscard]] std::vector<hsize_t> extent(hid_t dataset);

[[nodiscard]] hid_t stored_type(Type type);
[[nodiscard]] hid_t memory_type(Type type);
/// The one that is stored like `stored`. Throws Failure if there is none.
[[nodiscard]] Type type_of(hid_t stored);
[[nodiscard]] bool is_number(hid_t stored);
/// In bytes; does without HDF5, and so without a Session.
[[nodiscard]] std::size_t size_of(Type type);

/// UTF-8 of variable length, which h5py, netCDF and MATLAB read as strings.
[[nodiscard]] Handle text_type();

/// Attributes of one value: created or replaced. Reading throws Failure, with the attribute, if it has another type or
/// shape than the one asked for.
void write_attribute(hid_t object, const std::string& name, const std::string& text);
void write_attribute(hid_t object, const std::string& name, Type type, std::int64_t value);
[[nodiscard]] bool has_attribute(hid_t object, const std::string& name);
[[nodiscard]] std::string read_text_attribute(hid_t object, const std::string& name);
[[nodiscard]] std::int64_t read_integer_attribute(hid_t object, const std::string& name);
/// One of `count` texts.
[[nodiscard]] std::vector<std::string> read_text_list(hid_t object, const std::string& name, std::size_t count);

/// Rows first, …, first + count - 1 of a dataset, as `memory` numbers; `data` has room for them.
void read_rows(hid_t dataset, hid_t memory, hsize_t first, hsize_t count, void* data);
/// A block of `sizes` from `first` on, 0 along the dimensions that it does not name.
void read_block(hid_t dataset, hid_t memory, std::vector<hsize_t> first, const std::vector<hsize_t>& sizes, void* data);
/// Passes all values of a dataset of numbers, as they are stored, through `use`, a few megabytes at a time.
void read_through(hid_t dataset, const std::function<void(std::span<const std::byte>)>& use);
/// Writes them into an extent that already has room.
void write_rows(hid_t dataset, hid_t memory, hsize_t first, hsize_t count, const void* data);

/// A part of row `row`, from its value `first` on, as the row lies in memory; it has to begin where a place along the
/// slowest dimension begins, and to end where one ends.
/// \param transfer how: by this process, or by all ranks together
void write_part(hid_t dataset, hid_t memory, hsize_t row, hsize_t first, hsize_t count, const void* data,
                hid_t transfer = H5P_DEFAULT);
/// How many values a place along the slowest dimension of a row has.
[[nodiscard]] hsize_t plane_of(const std::vector<hsize_t>& extent);

void write_checkpoint(hid_t file, const Checkpoint& checkpoint);
/// The same of an array that comes in parts, and of others, which are asked for when it has come.
void write_checkpoint(hid_t file, const CheckpointInParts& checkpoint);
/// Without the values of `left_out`, which have to be those that were written all the same.
[[nodiscard]] Checkpoint read_checkpoint(hid_t file, const std::string& left_out = {});
/// Compares the checkpoint with its checksum, in parts: it may be much larger than all else that is read. Fails as
/// read_checkpoint().
void examine_checkpoint(hid_t file);
/// What is stored as the checksum of its arrays, with which they are compared whenever they are read; 0 if there is
/// none.
[[nodiscard]] std::int64_t stored_checkpoint_checksum(hid_t file);

}  // namespace rubato::record::detail
