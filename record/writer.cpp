#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/chunks.hpp>
#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/gate.hpp>
#include <rubato/record/detail/hdf5.hpp>
#include <rubato/record/detail/seal.hpp>
#include <rubato/record/detail/structure.hpp>
#include <rubato/record/detail/waiting_bytes.hpp>
#include <rubato/record/together.hpp>
#include <rubato/record/writer.hpp>

namespace rubato::record {

namespace {

using Clock = std::chrono::steady_clock;

/// Fewer bytes are not worth looking whether their chunks can be written as they are.
constexpr std::size_t least_directly = std::size_t{16} << 10;

/// Checksums of chunks that were written whole, as they are in the file, by where they begin behind the begin of all
/// rows.
using ChunkSums = std::map<std::size_t, Checksum>;

/// Where chunk number k is in the file HDF5 finds by looking at those before it, in 20 ns each; to read a chunk takes
/// 0.12 ns a byte (both measured). So many chunks are found sooner than they are read.
constexpr std::size_t chunks_worth_finding(std::size_t chunk_bytes) {
  return chunk_bytes / 160;
}

/// A growing dataset on its way to the file. The bytes of its rows, one row after the other, are in the working file up
/// to `flushed`; the rest is in `waiting`.
struct Gathered {
  Dataset description;
  std::size_t row_size;
  std::size_t row_bytes;
  std::size_t chunk_rows = 1;
  std::size_t block_bytes = 1;    ///< of a row: what chunks divide it into along its slowest dimension
  std::size_t first_of_axis = 0;  ///< number of the first dataset along its axis
  bool together = false;          ///< ranks can write its rows
  std::size_t flushed = 0;
  std::size_t complete = 0;  ///< rows of whole levels
  Checksum checksum = {};    ///< of these
  std::size_t appended = 0;
  Checksum checksum_of_all = {};  ///< of these, and of what has come of the next one unless rows are long
  Checksum checksum_of_row = {};  ///< of what has come of a long row
  std::vector<Checksum> checksums_of_rows = {};  ///< of long ones that wait
  detail::WaitingBytes waiting{};
  ChunkSums chunk_sums = {};  ///< of what is in the working file, as far as they are known

  [[nodiscard]] std::size_t end() const { return flushed + waiting.size(); }
  /// What has come of a row that is not whole yet.
  [[nodiscard]] std::size_t begun() const { return end() - appended * row_bytes; }

  /// Rows whose checksums are found once, for the dataset and for the file.
  [[nodiscard]] bool has_long_rows() const { return block_bytes == row_bytes && row_bytes >= least_directly; }

  void add(std::span<const std::byte> bytes, const Checksum* known) {
    Checksum& checksum_so_far = has_long_rows() ? checksum_of_row : checksum_of_all;
    if (known != nullptr)
      checksum_so_far.append(*known);
    else
      checksum_so_far.add(bytes);
    waiting.append(bytes);
    appended = end() / row_bytes;
    if (has_long_rows() && begun() == 0) {
      checksum_of_all.append(checksum_of_row);
      checksums_of_rows.push_back(std::exchange(checksum_of_row, {}));
    }
  }

  /// Of whole rows that wait, from `place` on; of nothing where those of rows are not kept.
  [[nodiscard]] Checksum checksum_of_rows(std::size_t place, std::size_t bytes) const {
    Checksum sum;
    if (has_long_rows())
      for (std::size_t at = place; at < place + bytes; at += row_bytes)
        sum.append(checksums_of_rows.at((at - flushed) / row_bytes));
    return sum;
  }

  /// What waits up to there is in the working file.
  void flush_to(std::size_t place) {
    waiting.drop_front(place - flushed);
    if (has_long_rows())
      checksums_of_rows.erase(checksums_of_rows.begin(),
                              checksums_of_rows.begin() + static_cast<std::ptrdiff_t>((place - flushed) / row_bytes));
    flushed = place;
  }

  /// Up to where bytes go into the working file. Every chunk in it is compressed and written once, so that versions do
  /// not pile up dead space in it: rows of whole levels that fill whole chunks, and of rows so long that a chunk has no
  /// two of them, whole blocks as they come. \return `flushed` if there is nothing
  enum class Of { whole_levels, all };
  [[nodiscard]] std::size_t flushable(Of of) const {
    if (chunk_rows > 1 || of == Of::whole_levels)
      return std::max(flushed, (complete - complete % chunk_rows) * row_bytes);
    const std::size_t rows = appended * row_bytes;
    return std::max(flushed, rows + begun() / block_bytes * block_bytes);
  }

  void complete_all() {
    checksum = checksum_of_all;
    complete = appended;
  }
  void drop_incomplete() {
    const std::size_t left = complete * row_bytes;
    waiting.keep_front(left > flushed ? left - flushed : 0);  // what is in the file already is written again
    flushed = std::min(flushed, left);
    appended = complete;
    checksum_of_all = checksum;
    checksum_of_row = {};
    if (has_long_rows())
      checksums_of_rows.resize(waiting.size() / row_bytes);
  }
};

/// What the chunks of a dataset divide its rows into.
void set_chunk(Gathered& column, const Layout& layout, const std::vector<hsize_t>& chunk) {
  column.chunk_rows = chunk.front();
  const auto shape = detail::row_shape(layout, column.description);
  if (!shape.empty())
    column.block_bytes = chunk.at(1) * (column.row_bytes / shape.front());
}

/// \param buffer_bytes how much waits of all of them before it is written
std::vector<Gathered> columns_of(const Layout& layout, std::size_t buffer_bytes) {
  std::vector<Gathered> columns;
  for (const auto& dataset : layout.datasets) {
    const std::size_t bytes = detail::size_of(dataset.type);
    const std::size_t row_size = detail::row_size(layout, dataset);
    columns.push_back({dataset, row_size, row_size * bytes});
    columns.back().together = dataset.together && layout.compression == 0 && is_long(layout, dataset);
    set_chunk(columns.back(), layout, detail::chunk_shape(layout, dataset));
  }
  std::map<std::string_view, std::size_t> first;
  for (std::size_t i = 0; i < columns.size(); ++i)
    columns[i].first_of_axis = first.try_emplace(columns[i].description.axis, i).first->second;
  std::size_t level_bytes = 0;
  for (const Gathered& column : columns)
    level_bytes += column.row_bytes;
  // Each a share of that, the row that is too many, and the rows of a chunk that is not whole.
  for (Gathered& column : columns)
    column.waiting = detail::WaitingBytes(
        std::min(buffer_bytes,
                 (buffer_bytes / std::max<std::size_t>(level_bytes, 1) + 1 + column.chunk_rows) * column.row_bytes));
  return columns;
}

/// Leaves those of chunks that end at `place` or before.
void forget_from(std::size_t place, ChunkSums& sums) {
  auto first = sums.lower_bound(place);
  if (first != sums.begin())
    if (const auto last = std::prev(first);
        last->first + last->second.bytes() - detail::ChunkWriter::room_behind > place)
      first = last;
  sums.erase(first, sums.end());
}

/// Lets a dataset have `rows` rows, and writes what waits of their bytes up to `end`.
/// \param sums those of the dataset's chunks in this file, which are kept true
void write_column(hid_t dataset, Gathered& column, std::size_t rows, std::size_t end, ChunkSums& sums) {
  static_assert(detail::ChunkWriter::room_behind <= detail::WaitingBytes::room_behind);
  auto sizes = detail::extent(dataset);
  sizes.front() = rows;
  detail::check(H5Dset_extent(dataset, sizes.data()), "extending a dataset");
  const hid_t memory = detail::memory_type(column.description.type);
  const std::size_t value_bytes = column.row_bytes / column.row_size;
  auto chunks =
      end - column.flushed < least_directly ? std::nullopt : detail::ChunkWriter::of(dataset, column.description.type);
  forget_from(column.flushed, sums);
  for (std::size_t place = column.flushed; place < end;) {
    std::byte* const bytes = column.waiting.data() + (place - column.flushed);
    if (const std::size_t count = chunks ? chunks->bytes_at(place) : 0; count > 0 && place + count <= end) {
      const bool keep = sums.size() < chunks_worth_finding(count);
      Checksum sum = keep ? column.checksum_of_rows(place, count) : Checksum();
      chunks->write(place, std::span(bytes, count), keep ? &sum : nullptr);
      if (keep)
        sums[place] = sum;
      place += count;
      continue;
    }
    const std::size_t row = place / column.row_bytes, begin = place % column.row_bytes;
    std::size_t whole = (end - place) / column.row_bytes;
    if (chunks)
      whole = std::min(whole, column.chunk_rows - row % column.chunk_rows);  // and on with whole chunks
    if (begin == 0 && whole > 0) {
      detail::write_rows(dataset, memory, row, whole, bytes);
      place += whole * column.row_bytes;
    } else {
      const std::size_t count = std::min(column.row_bytes - begin, end - place);
      detail::write_part(dataset, memory, row, begin / value_bytes, count / value_bytes, bytes);
      place += count;
    }
  }
}

/// Where the chunks are in the file of which the checksums are known.
void find_chunks(hid_t dataset, const Gathered& column, const ChunkSums& sums, std::vector<detail::KnownPiece>& found) {
  if (sums.empty())
    return;
  const auto chunks = detail::ChunkWriter::of(dataset, column.description.type);
  for (const auto& [place, sum] : sums)
    if (const auto piece = chunks ? chunks->find(place, sum) : std::nullopt)
      found.push_back(*piece);
}

template <class Integer>
void store(std::span<const std::int64_t> values, const std::string& path, std::byte* out) {
  for (const std::int64_t value : values) {
    if (!std::in_range<Integer>(value))
      throw std::invalid_argument(fmt::format("record: {} does not fit into the integers of '{}'", value, path));
    const auto number = static_cast<Integer>(value);
    std::memcpy(out, &number, sizeof number);
    out += sizeof number;
  }
}

/// What is at the place of a record: nothing, or a regular file.
bool is_there(const std::filesystem::path& file) {
  const auto status = std::filesystem::symlink_status(file);
  if (!std::filesystem::exists(status))
    return false;
  if (std::filesystem::is_symlink(status) && !std::filesystem::exists(file))
    throw Error(file, "is a symbolic link that leads nowhere");
  if (!std::filesystem::is_regular_file(file))
    throw Error(file, "is not a regular file");
  return true;
}

void require_leave(const std::filesystem::path& file, bool overwrite) {
  if (is_there(file) && !overwrite)
    throw AlreadyExists(file, "already exists");
}

}  // namespace

class Claim::Lock {
public:
  explicit Lock(const std::filesystem::path& file) : lock_(file) {}

private:
  detail::FileLock lock_;
};

Claim::Claim(const std::filesystem::path& file) : file_(file) {
  detail::with_file(file, [&] {
    (void)is_there(file);  // no lock beside a folder or a device
    target_ = std::filesystem::weakly_canonical(std::filesystem::absolute(file));
    std::filesystem::path lock = target_;
    lock += ".lock";
    lock_ = std::make_unique<Lock>(lock);
  });
}
Claim::Claim(Claim&&) noexcept = default;
Claim& Claim::operator=(Claim&&) noexcept = default;
Claim::~Claim() = default;

class Writer::Implementation {
public:
  Implementation(Claim claim, const Layout& layout, bool overwrite, CommitPolicy policy)
      : claim_(std::move(claim)),
        path_(claim_.target()),
        overwrite_(overwrite),
        policy_(policy),
        layout_(layout),
        columns_(columns_of(layout, policy.buffer_bytes)) {
    detail::remove_leftovers(path_);
    working_.emplace(path_, "partial");
  }

  void start() {
    detail::Handle file = detail::create_file(working_->name_of_descriptor());
    working_->reserve(structure_bytes());
    detail::create_structure(file, layout_);
    file.close("writing the working file");
    working_->trim();
  }

  void take_over(const std::string& left_out) {
    overwrite_ = published_ = true;
    {
      const detail::Descriptor published = detail::open_regular(path_);
      const detail::Handle file = detail::open_file(path_, H5F_ACC_RDONLY);
      if (detail::admit(file, published.number()) != detail::Integrity::intact)
        detail::require_unaltered(file);
      working_->copy_from(published.number());
    }
    detail::Handle file = open(*working_);
    detail::compare_structure(file, layout_);
    checkpoint_ = detail::read_checkpoint(file, left_out);
    working_->reserve(structure_bytes());
    for (auto& column : columns_)
      take_over(file, column);
    detail::write_root_attributes(file, layout_);
    detail::write_attribute(file, "finished", Type::u8, 0);
    file.close("writing the working file");
    working_->trim();
    if (const std::string contradiction = different_rows(); !contradiction.empty())
      throw detail::Failure(contradiction);
  }

  void append(std::size_t dataset, std::span<const double> row, const Checksum* checksum) {
    Gathered& column = column_for(dataset, row.size());
    if (column.description.type != Type::f64)
      throw std::invalid_argument(fmt::format("record: '{}' takes integers", column.description.path));
    add(column, row, checksum);
  }

  void append_part(std::size_t dataset, std::span<const double> part) {
    Gathered& column = columns_.at(dataset);
    if (column.description.type != Type::f64)
      throw std::invalid_argument(fmt::format("record: '{}' takes integers", column.description.path));
    if (part.size_bytes() > column.row_bytes - column.begun())
      throw std::invalid_argument(
          fmt::format("record: parts go beyond a row of '{}', of {} values", column.description.path, column.row_size));
    add(column, part);
    if (bytes_since_flush_ > policy_.buffer_bytes)
      detail::with_file(path_, [&] { flush(Gathered::Of::all); });
  }

  void append(std::size_t dataset, std::span<const std::int64_t> row) {
    Gathered& column = column_for(dataset, row.size());
    const std::string& path = column.description.path;
    std::vector<std::byte> converted(column.row_bytes);
    switch (column.description.type) {
      case Type::f64: throw std::invalid_argument(fmt::format("record: '{}' takes floating-point numbers", path));
      case Type::i64: store<std::int64_t>(row, path, converted.data()); break;
      case Type::i32: store<std::int32_t>(row, path, converted.data()); break;
      case Type::u8: store<std::uint8_t>(row, path, converted.data()); break;
    }
    add(column, std::span<const std::byte>(converted));
  }

  [[nodiscard]] std::optional<std::filesystem::path> make_room(std::span<const std::size_t> datasets) {
    std::uint64_t bytes = 0;
    for (const std::size_t dataset : datasets) {
      const Gathered& column = columns_.at(dataset);
      if (!column.together || column.chunk_rows > 1 || column.begun() > 0)
        return std::nullopt;
      bytes += column.row_bytes + column.block_bytes;
    }
    return detail::with_file(path_, [&] {
      flush(Gathered::Of::all);
      detail::Handle file = open(*working_);
      working_->reserve(bytes + structure_bytes());
      for (const std::size_t dataset : datasets) {
        Gathered& column = columns_[dataset];
        write_column(detail::open_dataset(file, column.description.path), column, column.appended + 1, column.flushed,
                     column.chunk_sums);
      }
      file.close("writing the working file");
      return std::optional(working_->path());
    });
  }

  void append_written(std::size_t dataset, const Checksum& row) {
    Gathered& column = columns_.at(dataset);
    if (!column.together || !column.waiting.empty() || row.bytes() != column.row_bytes)
      throw std::invalid_argument(
          fmt::format("record: what was written is not the next row of '{}'", column.description.path));
    column.flushed += column.row_bytes;
    column.appended += 1;
    column.checksum_of_all.append(row);
  }

  [[nodiscard]] std::size_t rows(std::size_t dataset) const { return columns_.at(dataset).appended; }

  void end_level() {
    check_axes();
    for (auto& column : columns_)
      column.complete_all();
    if (bytes_since_flush_ > policy_.buffer_bytes)
      detail::with_file(path_, [&] { flush(); });
  }

  void drop_level() {
    for (auto& column : columns_)
      column.drop_incomplete();
  }

  [[nodiscard]] const Checkpoint& checkpoint() const { return checkpoint_; }

  [[nodiscard]] bool commit_due() const {
    const auto pause =
        published_ ? std::max(policy_.interval, policy_.times_last_commit * commit_duration_) : policy_.first;
    return Clock::now() - last_commit_ >= pause;
  }

  void stage(const CheckpointInParts& checkpoint) {
    detail::with_file(path_, [&] {
      detail::Handle file = open(*working_);
      working_->reserve(structure_bytes() + checkpoint.size * (sizeof(double) + 1));
      is_staged_ = true;
      detail::write_checkpoint(file, checkpoint);
      file.close("writing the working file");
      working_->trim();
    });
  }
  void require_staged() const {
    if (!is_staged_)
      throw std::logic_error("record: there is no checkpoint to publish");
  }

  /// \param checkpoint null: the one that is staged
  void commit(const Checkpoint* checkpoint) {
    const auto begin = Clock::now();
    detail::with_file(path_, [&] {
      flush();
      detail::TemporaryFile next(path_, "next");
      next.copy_from(working_->descriptor());
      complete_version(next, checkpoint, Completion::interrupted, false);
      publish(next, policy_.durable);
    });
    published_ = true;
    last_commit_ = Clock::now();
    commit_duration_ = last_commit_ - begin;
  }

  [[nodiscard]] bool published() const { return published_; }

  void finish(const Checkpoint* checkpoint, Completion completion) {
    detail::with_file(path_, [&] {
      flush();
      check_axes();
      complete_version(*working_, checkpoint, completion, true);
      publish(*working_, true);
    });
  }

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
  [[nodiscard]] static detail::Handle open(const detail::TemporaryFile& file) {
    return detail::open_file(file.name_of_descriptor(), H5F_ACC_RDWR);
  }

  /// Gives a version its name. What it replaces keeps its owner and permissions.
  void publish(detail::TemporaryFile& version, bool durable) {
    using Replace = detail::TemporaryFile::Replace;
    if (durable)
      version.synchronize();
    std::optional<detail::Access> access;
    // Open until the new name is on the disk: until then a file system may give its space to others, where a power
    // failure would bring the old name back.
    std::optional<detail::Descriptor> replaced;
    if (overwrite_ && is_there(path_))
      access = detail::access_of(replaced.emplace(detail::open_regular(path_)).number());
    if (!version.publish(path_, access ? &*access : nullptr, overwrite_ ? Replace::yes : Replace::no))
      throw AlreadyExists(claim_.file(), "already exists, since a moment ago");
    overwrite_ = true;  // from now on it is this run's own
    if (durable)
      detail::synchronize_folder(path_.parent_path());
  }

  /// Generous bounds of what is written besides rows: object headers, indices of chunks, scales, attributes.
  [[nodiscard]] std::uint64_t structure_bytes() const {
    std::uint64_t bytes = (std::uint64_t{64} << 10) + 2 * layout_.problem.size();
    for (const auto& scale : layout_.scales)
      bytes += std::visit([](const auto& values) { return 64 * values.size(); }, scale.values) + 4096;
    return bytes + (std::uint64_t{16} << 10) * layout_.datasets.size();
  }

  /// A sixteenth more is for what cannot be compressed, and a little for the empty part of a chunk, which is all zeros;
  /// all of that without compression.
  [[nodiscard]] std::uint64_t waiting_bytes() const {
    std::uint64_t bytes = 0;
    for (const auto& column : columns_)
      bytes += column.waiting.size() + column.waiting.size() / 16 + 4096 +
               column.chunk_rows * column.row_bytes / (layout_.compression > 0 ? 500 : 1);
    return bytes;
  }

  Gathered& column_for(std::size_t dataset, std::size_t size) {
    Gathered& column = columns_.at(dataset);
    if (column.begun() > 0)
      throw std::invalid_argument(fmt::format("record: a row of '{}' is begun in parts", column.description.path));
    if (size != column.row_size)
      throw std::invalid_argument(
          fmt::format("record: a row of '{}' has {} values, not {}", column.description.path, column.row_size, size));
    return column;
  }

  void add(Gathered& column, std::span<const std::byte> bytes, const Checksum* checksum = nullptr) {
    bytes_since_flush_ += bytes.size();
    column.add(bytes, checksum);
  }
  /// A row, or a part of one.
  void add(Gathered& column, std::span<const double> values, const Checksum* checksum = nullptr) {
    if (!column.description.may_be_undefined && !all_finite(values))
      for (std::size_t i = 0; i < values.size(); ++i)
        if (!std::isfinite(values[i]))
          throw NotFinite(column.description, column.appended, column.begun() / sizeof(double) + i, values[i]);
    add(column, std::as_bytes(values), checksum);
  }

  /// Which datasets of one axis are not of one length; empty if none.
  [[nodiscard]] std::string different_rows() const {
    for (const auto& column : columns_) {
      if (column.begun() > 0)
        return fmt::format("a part of a row of '{}' is missing", column.description.path);
      const Gathered& first = columns_[column.first_of_axis];
      if (first.appended != column.appended)
        return fmt::format("'{}' has {} rows, but '{}' has {}", first.description.path, first.appended,
                           column.description.path, column.appended);
    }
    return {};
  }

  void check_axes() const {
    if (const std::string contradiction = different_rows(); !contradiction.empty())
      throw std::logic_error("record: " + contradiction);
  }

  void take_over(hid_t file, Gathered& column) const {
    const detail::Handle dataset = detail::open_dataset(file, column.description.path);
    auto sizes = detail::extent(dataset);
    const auto rows = detail::read_integer_attribute(dataset, detail::rows_attribute);
    if (rows < 0 || static_cast<hsize_t>(rows) > sizes.front())
      throw detail::Failure(
          fmt::format("dataset '{}' should have {} rows, but has {}", column.description.path, rows, sizes.front()));
    set_chunk(column, layout_, detail::chunk_of(dataset));
    column.together = is_long(layout_, column.description) && detail::is_for_ranks(dataset);
    std::uint64_t left = static_cast<std::uint64_t>(rows) * column.row_bytes;
    detail::read_through(dataset, [&](std::span<const std::byte> bytes) {  // provisional rows are behind the others
      const auto part = bytes.first(std::min<std::uint64_t>(left, bytes.size()));
      column.checksum.add(part);
      left -= part.size();
    });
    column.checksum_of_all = column.checksum;
    column.complete = column.appended = static_cast<std::size_t>(rows);
    column.flushed = column.flushable(Gathered::Of::whole_levels);
    const std::size_t in_file = column.flushed / column.row_bytes, left_over = column.complete - in_file;
    std::byte* const left_rows = column.waiting.append(left_over * column.row_bytes);
    detail::read_rows(dataset, detail::memory_type(column.description.type), in_file, left_over, left_rows);
    for (std::size_t i = 0; column.has_long_rows() && i < left_over; ++i)
      column.checksums_of_rows.emplace_back().add(std::span(left_rows + i * column.row_bytes, column.row_bytes));
    sizes.front() = in_file;
    detail::check(H5Dset_extent(dataset, sizes.data()), "shortening a dataset");
  }

  /// Moves whole chunks into the working file.
  void flush(Gathered::Of of = Gathered::Of::whole_levels) {
    bytes_since_flush_ = 0;
    if (std::ranges::none_of(columns_, [&](const Gathered& column) { return column.flushable(of) > column.flushed; }))
      return;
    detail::Handle file = open(*working_);
    working_->reserve(waiting_bytes() + structure_bytes());
    for (auto& column : columns_)
      if (const std::size_t end = column.flushable(of); end > column.flushed)
        write_column(detail::open_dataset(file, column.description.path), column,
                     (end + column.row_bytes - 1) / column.row_bytes, end, column.chunk_sums);
    file.close("writing the working file");
    working_->trim();
    for (auto& column : columns_)
      column.flush_to(column.flushable(of));
  }

  /// Adds to a file with whole chunks what makes it a record of all complete levels.
  void complete_version(detail::TemporaryFile& version, const Checkpoint* checkpoint, Completion completion,
                        bool last) {
    detail::Handle file = open(version);
    std::uint64_t checkpoint_bytes = 0;
    if (checkpoint != nullptr)
      for (const auto& [name, array] : *checkpoint)
        checkpoint_bytes += 4096 + std::visit([](const auto& a) { return a.size() * sizeof(a[0]); }, array);
    version.reserve(waiting_bytes() + structure_bytes() + checkpoint_bytes);
    std::map<std::string, Checksum> checksums;
    std::vector<detail::KnownPiece> known;
    for (auto& column : columns_) {
      const detail::Handle dataset = detail::open_dataset(file, column.description.path);
      // The last version shows provisional rows too; the attribute tells `resume` where the whole levels end.
      const std::size_t end = last ? column.appended : column.complete;
      ChunkSums sums = column.chunk_sums;  // of this version, while those of the working file stay
      write_column(dataset, column, end, end * column.row_bytes, sums);
      find_chunks(dataset, column, sums, known);
      checksums[column.description.path] = last ? column.checksum_of_all : column.checksum;
      detail::write_attribute(dataset, detail::rows_attribute, Type::i64, static_cast<std::int64_t>(column.complete));
    }
    if (checkpoint != nullptr)
      detail::write_checkpoint(file, *checkpoint);
    detail::write_attribute(file, "finished", Type::u8, completion == Completion::complete ? 1 : 0);
    detail::write_seal(file, checksums);
    file.close("writing the record");
    version.trim();
    detail::mark(version, std::move(known));
  }

  Claim claim_;
  std::filesystem::path path_;
  bool overwrite_;
  CommitPolicy policy_;
  Layout layout_;
  std::vector<Gathered> columns_;
  Checkpoint checkpoint_;
  bool is_staged_ = false, published_ = false;
  std::optional<detail::TemporaryFile> working_;
  std::size_t bytes_since_flush_ = 0;
  Clock::time_point last_commit_ = Clock::now();
  std::chrono::duration<double> commit_duration_{0};
};

Writer::Writer(std::unique_ptr<Implementation> implementation) : implementation_(std::move(implementation)) {}
Writer::Writer(Writer&&) noexcept = default;
Writer& Writer::operator=(Writer&&) noexcept = default;
Writer::~Writer() = default;

Writer Writer::create(const std::filesystem::path& file, const Layout& layout, bool overwrite, CommitPolicy policy) {
  detail::validate(layout);
  return detail::with_file(file, [&] {
    require_leave(file, overwrite);  // before a lock is made beside it
    Claim claim(file);
    require_leave(file, overwrite);
    auto implementation = std::make_unique<Implementation>(std::move(claim), layout, overwrite, policy);
    implementation->start();
    return Writer(std::move(implementation));
  });
}

Writer Writer::resume(const std::filesystem::path& file, const Layout& layout, CommitPolicy policy) {
  return resume(Claim(file), layout, policy);
}

Writer Writer::resume(Claim claim, const Layout& layout, CommitPolicy policy, const std::string& left_out) {
  detail::validate(layout);
  const std::filesystem::path file = claim.file();
  return detail::with_file(file, [&] {
    if (!is_there(file))
      throw Error(file, "no such file");
    if (H5Fis_hdf5(file.c_str()) == 0)
      throw Error(file, "is not an HDF5 file");
    auto implementation = std::make_unique<Implementation>(std::move(claim), layout, true, policy);
    implementation->take_over(left_out);
    return Writer(std::move(implementation));
  });
}

void Writer::append(std::size_t dataset, std::span<const double> row, const Checksum* checksum) {
  implementation_->append(dataset, row, checksum);
}
void Writer::append(std::size_t dataset, std::span<const std::int64_t> row) {
  implementation_->append(dataset, row);
}
void Writer::append_part(std::size_t dataset, std::span<const double> part) {
  implementation_->append_part(dataset, part);
}
std::optional<std::filesystem::path> Writer::make_room(std::span<const std::size_t> datasets) {
  return implementation_->make_room(datasets);
}
void Writer::append_written(std::size_t dataset, const Checksum& row) {
  implementation_->append_written(dataset, row);
}
std::size_t Writer::rows(std::size_t dataset) const {
  return implementation_->rows(dataset);
}
const Checkpoint& Writer::checkpoint() const {
  return implementation_->checkpoint();
}
void Writer::end_level() {
  implementation_->end_level();
}
void Writer::drop_level() {
  implementation_->drop_level();
}
bool Writer::commit_due() const {
  return implementation_->commit_due();
}
bool Writer::published() const {
  return implementation_->published();
}
void Writer::commit(const Checkpoint& checkpoint) {
  implementation_->commit(&checkpoint);
}
void Writer::commit() {
  implementation_->require_staged();
  implementation_->commit(nullptr);
}
void Writer::stage(const CheckpointInParts& checkpoint) {
  implementation_->stage(checkpoint);
}
void Writer::finish(const Checkpoint& checkpoint, Completion completion) {
  implementation_->finish(&checkpoint, completion);
}
void Writer::finish(Completion completion) {
  implementation_->require_staged();
  implementation_->finish(nullptr, completion);
}

}  // namespace rubato::record
