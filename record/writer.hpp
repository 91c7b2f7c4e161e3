#pragma once

#include <chrono>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <rubato/base/checksum.hpp>
#include <rubato/record/error.hpp>
#include <rubato/record/layout.hpp>

namespace rubato::record {

/// About how many bytes the rows of a record take uncompressed, events left out, in whole chunks. Empty if the number
/// of rows is unknown. \param rows of each dataset; none: those that it expects
[[nodiscard]] std::optional<double> expected_bytes(const Layout& layout,
                                                   std::span<const std::optional<std::size_t>> rows = {});

/// Whether a writer takes the lock of its record: file systems without locks have writers without one.
enum class Locking { yes, no };

/// When a run publishes what it has computed.
struct CommitPolicy {
  /// At least this long between two commits, …
  std::chrono::duration<double> interval = std::chrono::seconds(2);
  /// … and at least this many times the duration of the last commit: at most 1/20 of the time goes into commits.
  double times_last_commit = 20.0;
  /// Whole chunks wait in memory for at most about this many bytes; beyond, they move to the working file. As many as
  /// caches still hold: four times as many make a run that stores all it does a sixth slower.
  std::size_t buffer_bytes = std::size_t{16} << 20;
  /// Waits at every commit until the version is on the disk (fsync of the file before it is renamed, and of the folder
  /// after): a version then survives a crash of the whole machine, too, on every file system. The waiting counts as
  /// part of the commit, and so is bounded by `times_last_commit`.
  bool durable = true;
  /// The first commit of a new record is due after so long.
  std::chrono::duration<double> first = std::chrono::seconds(2);
  /// Of Writer::create(); those who resume have a Claim.
  Locking locking = Locking::yes;
};

/// The right to write a record: while it lasts, no other process or thread that asks for it gets it, so that what is
/// seen of the record does not change. It is a lock on the file `NAME.lock` beside the record, which ends with the
/// process at the latest. Throws Error if another one has it, if no file can be made there, or if the file system has
/// no locks; with Locking::no the caller sees to it that there is one writer.
class Claim {
public:
  explicit Claim(const std::filesystem::path& file, Locking locking = Locking::yes);
  Claim(Claim&&) noexcept;
  Claim& operator=(Claim&&) noexcept;
  ~Claim();

  /// As it was named.
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// Where it lies: a symbolic link stays, and what it leads to is replaced.
  [[nodiscard]] const std::filesystem::path& target() const { return target_; }

private:
  class Lock;
  std::filesystem::path file_, target_;
  std::unique_ptr<Lock> lock_;
};

/// Writes the record of a run, level by level.
///
/// The file at the record's path is at any moment a complete, closed HDF5 file that holds whole levels only: rows
/// gather in memory and in a working file beside it (`NAME.<random>.partial`), and `commit` makes a new version of the
/// whole file (`NAME.<random>.next`) and renames it over the old one. A process killed at any moment thus leaves the
/// last version committed, which any reader opens and `resume` continues; files left beside it are removed by the next
/// writer. A reader that has the old version open keeps it. Disk space for two further copies is needed during a run.
/// The permissions of a record that is replaced stay, and until then only its owner can read what is written.
///
/// The last version, made by `finish`, is waited for until it is on the disk, and so are those before it unless
/// CommitPolicy says otherwise.
///
/// A record has one writer at a time (see Claim); a second one is refused. Different writers may be used by different
/// threads.
///
/// All operations that touch files throw Error; the published version then stays as it was, and the writer must not be
/// used further. An unfinished writer that goes out of scope publishes nothing more.
///
///     auto writer = Writer::create("pendulum.h5", layout);
///     writer.append(0, t); …; writer.end_level(); writer.commit(checkpoint);
///     while (…) {
///       writer.append(0, t); …; writer.end_level();
///       if (writer.commit_due()) writer.commit(checkpoint);
///     }
///     writer.finish(checkpoint, Completion::complete);
class Writer {
public:
  /// Prepares a new record; nothing is at `file` before the first commit. Throws std::invalid_argument if the layout
  /// contradicts itself, AlreadyExists if the file exists and `overwrite` is false.
  [[nodiscard]] static Writer create(const std::filesystem::path& file, const Layout& layout, bool overwrite = false,
                                     CommitPolicy policy = {});

  /// Continues a record after its last complete level; `layout` is that of the run that wrote it, which is read, like
  /// all else, while the claim lasts. Throws Error if there is no such record or if its scales or datasets are not
  /// those of the layout. Title, problem, version, compiler and threads are replaced by those of the layout at the next
  /// commit.
  /// \param left_out an array that checkpoint() is to do without, as large as it may be
  [[nodiscard]] static Writer resume(Claim claim, const Layout& layout, CommitPolicy policy = {},
                                     const std::string& left_out = {});
  [[nodiscard]] static Writer resume(const std::filesystem::path& file, const Layout& layout, CommitPolicy policy = {});

  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;
  ~Writer();

  /// Appends rows, one after the other, to the dataset number `dataset` of the layout. Throws std::invalid_argument if
  /// the size is not that of the rows or if the dataset is of another type; NotFinite if a value is not finite and the
  /// dataset does not say that it may be.
  void append(std::size_t dataset, std::span<const double> values, std::size_t rows = 1);

  /// The same for the integer types; a value outside the stored type's range is refused too.
  void append(std::size_t dataset, std::span<const std::int64_t> values, std::size_t rows = 1);

  /// Appends a row in parts, which follow one another as in the row; it is a row with the last of them. Of long rows
  /// what goes beyond CommitPolicy::buffer_bytes moves to the working file at once. Throws as append, and
  /// std::invalid_argument if the parts are longer than a row; what has come of the row then is for drop_level.
  void append_part(std::size_t dataset, std::span<const double> part);

  /// Room in the working file for one more row of each of these datasets, for write_together(). append_written() has to
  /// follow for those that were written, before anything else of these datasets.
  /// \return the working file; nothing if ranks cannot write rows of one, by how it was made
  [[nodiscard]] std::optional<std::filesystem::path> make_room(std::span<const std::size_t> datasets);

  /// Takes what was written there as the next row. Throws std::invalid_argument if there is no room for one.
  /// \param row checksum of its numbers, all of them
  void append_written(std::size_t dataset, const Checksum& row);

  /// One number, for datasets with one number per row.
  void append(std::size_t dataset, std::floating_point auto value) {
    const double number = value;
    append(dataset, std::span<const double>(&number, 1));
  }
  void append(std::size_t dataset, std::integral auto value) {
    const auto number = static_cast<std::int64_t>(value);
    append(dataset, std::span<const std::int64_t>(&number, 1));
  }

  /// The checkpoint of the record that is resumed, read together with its rows; once.
  [[nodiscard]] Checkpoint take_checkpoint();

  /// The number of rows appended to a dataset so far, those of earlier runs included.
  [[nodiscard]] std::size_t rows(std::size_t dataset) const;

  /// Declares that the rows appended so far describe whole levels; rows appended later are published only after the
  /// next call. Throws std::logic_error if datasets with the same axis differ in their number of rows.
  void end_level();

  /// Forgets the rows appended since then.
  void drop_level();

  /// True if enough time has passed since the last commit, or, of a new record, since it was prepared (see
  /// CommitPolicy).
  [[nodiscard]] bool commit_due() const;

  /// True if there is a version for readers: one that was published, or that is resumed.
  [[nodiscard]] bool published() const;

  /// Publishes everything up to the last `end_level`, with the checkpoint that belongs to it. What functions of the
  /// checkpoint throw is passed on.
  ///@{
  void commit(const Checkpoint& checkpoint);
  void commit(const CheckpointInParts& checkpoint);
  ///@}

  /// Puts a checkpoint into the working file, for finish() without one: what is appended in between is not part of what
  /// it describes. What its functions throw is passed on.
  void stage(const CheckpointInParts& checkpoint);

  enum class Completion { interrupted, complete };

  /// Publishes for the last time and waits until it is on the disk. The attribute `finished` of the record becomes 1 if
  /// the run is complete. Rows appended after the last `end_level` are provisional: readers see them, `resume` drops
  /// them (the last state of a run, where it is not one of every n-th). No other call may follow.
  void finish(const Checkpoint& checkpoint, Completion completion);
  void finish(Completion completion);

private:
  class Implementation;
  explicit Writer(std::unique_ptr<Implementation> implementation);
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace rubato::record
