#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/record/detail/checksum.hpp>
#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/gate.hpp>
#include <rubato/record/detail/hdf5.hpp>
#include <rubato/record/detail/seal.hpp>
#include <rubato/record/detail/structure.hpp>
#include <rubato/record/together.hpp>
#include <rubato/record/writer.hpp>

namespace rubato::record {

namespace {

using Clock = std::chrono::steady_clock;

/// Longer rows are taken over in parts of so many bytes, so that no more of one waits in memory than may.
constexpr std::size_t most_waiting_of_a_row = std::size_t{1} << 20;

/// A growing dataset on its way to the file. The bytes of its rows, one row after the other, are in the working file up
/// to `flushed`; the rest is in `waiting`. Checksums are computed when bytes leave, of many rows at once.
struct Gathered {
  Dataset description;
  std::size_t row_size;
  std::size_t row_bytes;
  std::size_t chunk_rows = 1;
  std::size_t block_bytes = 1;    ///< of a row: what chunks divide it into along its slowest dimension
  std::size_t first_of_axis = 0;  ///< number of the first dataset along its axis
  bool together = false;          ///< ranks can write its rows
  std::size_t flushed = 0;
  Checksum checksum_of_flushed = {};
  std::size_t complete = 0;            ///< rows of whole levels
  Checksum checksum_of_complete = {};  ///< of these, where more than these is flushed
  std::size_t appended = 0;
  std::vector<std::byte> waiting{};

  [[nodiscard]] std::size_t end() const { return flushed + waiting.size(); }
  /// What has come of a row that is not whole yet.
  [[nodiscard]] std::size_t begun() const { return end() - appended * row_bytes; }

  void add(std::span<const std::byte> bytes) {
    waiting.insert(waiting.end(), bytes.begin(), bytes.end());
    appended = end() / row_bytes;
  }

  /// The checksum of the first `rows` rows, all that are complete or all there are.
  [[nodiscard]] Checksum checksum_of(std::size_t rows) const {
    const std::size_t place = rows * row_bytes;
    if (place < flushed)
      return checksum_of_complete;
    Checksum checksum = checksum_of_flushed;
    checksum.add(std::span(waiting).first(place - flushed));
    return checksum;
  }

  /// What waits up to there is in the working file.
  void flush_to(std::size_t place) {
    keep_checksum_before(place);
    checksum_of_flushed.add(std::span(waiting).first(place - flushed));
    waiting.erase(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(place - flushed));
    if (row_bytes > most_waiting_of_a_row)  // the next one is far away
      waiting.shrink_to_fit();
    flushed = place;
  }
  /// The next row is in the working file, which nothing waits for.
  void flush_written(const Checksum& row) {
    keep_checksum_before(flushed + row_bytes);
    checksum_of_flushed.append(row);
    flushed += row_bytes;
    appended += 1;
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

  void complete_all() { complete = appended; }
  void drop_incomplete() {
    const std::size_t left = complete * row_bytes;
    if (flushed > left) {  // what is in the file already is written again
      checksum_of_flushed = checksum_of_complete;
      flushed = left;
    }
    waiting.resize(left - flushed);
    appended = complete;
  }

private:
  /// Before bytes up to `place` are flushed.
  void keep_checksum_before(std::size_t place) {
    if (place > complete * row_bytes && flushed <= complete * row_bytes)
      checksum_of_complete = checksum_of(complete);
  }
};

/// What the chunks of a dataset divide its rows into.
void set_chunk(Gathered& column, const Layout& layout, const std::vector<hsize_t>& chunk) {
  column.chunk_rows = chunk.front();
  const auto shape = detail::row_shape(layout, column.description);
  if (!shape.empty())
    column.block_bytes = chunk.at(1) * (column.row_bytes / shape.front());
}

std::vector<Gathered> columns_of(const Layout& layout) {
  std::vector<Gathered> columns;
  for (const auto& dataset : layout.datasets) {
    const std::size_t bytes = detail::size_of(dataset.type);
    const std::size_t row_size = record::row_size(layout, dataset);
    columns.push_back({dataset, row_size, row_size * bytes});
    columns.back().together = dataset.together && layout.compression == 0 && is_long(layout, dataset);
    set_chunk(columns.back(), layout, detail::chunk_shape(layout, dataset));
  }
  std::map<std::string_view, std::size_t> first;
  for (std::size_t i = 0; i < columns.size(); ++i)
    columns[i].first_of_axis = first.try_emplace(columns[i].description.axis, i).first->second;
  return columns;
}

/// Lets a dataset have `rows` rows, and writes what waits of their bytes up to `end`.
void write_column(hid_t dataset, const Gathered& column, std::size_t rows, std::size_t end) {
  auto sizes = detail::extent(dataset);
  sizes.front() = rows;
  detail::check(H5Dset_extent(dataset, sizes.data()), "extending a dataset");
  const hid_t memory = detail::memory_type(column.description.type);
  const std::size_t value_bytes = column.row_bytes / column.row_size;
  for (std::size_t place = column.flushed; place < end;) {
    const std::byte* const bytes = column.waiting.data() + (place - column.flushed);
    const std::size_t row = place / column.row_bytes, begin = place % column.row_bytes;
    const std::size_t whole = (end - place) / column.row_bytes;
    if (begin == 0 && whole > 0) {
      detail::write_rows(dataset, memory, row, whole, bytes);
      place += whole * column.row_bytes;
    } else {
      const std::size_t count = std::min(column.row_bytes - begin, end - place);
      detail::write_part(dataset, memory, row, begin / value_bytes, count / value_bytes, bytes);
      place += count;
    }
  }
  detail::check(H5Dflush(dataset), "writing rows");  // what fails when it is closed is not reported
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

Claim::Claim(const std::filesystem::path& file, Locking locking) : file_(file) {
  detail::with_file(file, [&] {
    (void)is_there(file);  // no lock beside a folder or a device
    target_ = std::filesystem::weakly_canonical(std::filesystem::absolute(file));
    std::filesystem::path lock = target_;
    lock += ".lock";
    if (locking == Locking::yes) {
      lock_ = std::make_unique<Lock>(lock);
    }
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
        columns_(columns_of(layout)) {
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

  void append(std::size_t dataset, std::span<const double> values, std::size_t rows) {
    Gathered& column = column_for(dataset, values.size(), rows);
    if (column.description.type != Type::f64)
      throw std::invalid_argument(fmt::format("record: '{}' takes integers", column.description.path));
    require_finite(column.description, values, column.row_size, column.end() / sizeof(double));
    if (rows > 1 || column.row_bytes <= most_waiting_of_a_row) {
      add(column, std::as_bytes(values));
      return;
    }
    for (std::size_t place = 0; place < values.size(); place += most_waiting_of_a_row / sizeof(double))
      add_part(column, values.subspan(place, std::min(most_waiting_of_a_row / sizeof(double), values.size() - place)));
  }

  void append_part(std::size_t dataset, std::span<const double> part) {
    Gathered& column = columns_.at(dataset);
    if (column.description.type != Type::f64)
      throw std::invalid_argument(fmt::format("record: '{}' takes integers", column.description.path));
    if (part.size_bytes() > column.row_bytes - column.begun())
      throw std::invalid_argument(
          fmt::format("record: parts go beyond a row of '{}', of {} values", column.description.path, column.row_size));
    require_finite(column.description, part, column.row_size, column.end() / sizeof(double));
    add_part(column, part);
  }

  void append(std::size_t dataset, std::span<const std::int64_t> values, std::size_t rows) {
    Gathered& column = column_for(dataset, values.size(), rows);
    const std::string& path = column.description.path;
    converted_.resize(rows * column.row_bytes);
    switch (column.description.type) {
      case Type::f64: throw std::invalid_argument(fmt::format("record: '{}' takes floating-point numbers", path));
      case Type::i64: store<std::int64_t>(values, path, converted_.data()); break;
      case Type::i32: store<std::int32_t>(values, path, converted_.data()); break;
      case Type::u8: store<std::uint8_t>(values, path, converted_.data()); break;
    }
    add(column, std::span<const std::byte>(converted_));
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
        write_column(detail::open_dataset(file, column.description.path), column, column.appended + 1, column.flushed);
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
    column.flush_written(row);
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

  [[nodiscard]] Checkpoint take_checkpoint() { return std::exchange(checkpoint_, {}); }

  [[nodiscard]] bool commit_due() const {
    const auto pause =
        published_ ? std::max(policy_.interval, policy_.times_last_commit * commit_duration_) : policy_.first;
    return Clock::now() - last_commit_ >= pause;
  }

  void stage(const CheckpointInParts& checkpoint) {
    detail::with_file(path_, [&] {
      detail::Handle file = open(*working_);
      working_->reserve(structure_bytes() + bytes_of(checkpoint));
      is_staged_ = true;
      detail::write_checkpoint(file, checkpoint);
      file.close("writing the working file");
      working_->trim();
    });
  }

  /// The checkpoint goes into the version alone: in the working file one after the other would leave dead space.
  template <typename Stored>
  void commit(const Stored& checkpoint) {
    const auto begin = Clock::now();
    detail::with_file(path_, [&] {
      flush();
      detail::TemporaryFile next(path_, "next");
      next.copy_from(working_->descriptor());
      complete_version(next, &checkpoint, Completion::interrupted, false);
      publish(next, policy_.durable);
    });
    published_ = true;
    last_commit_ = Clock::now();
    commit_duration_ = last_commit_ - begin;
  }

  [[nodiscard]] bool published() const { return published_; }

  /// \param checkpoint null: the one that is staged
  void finish(const Checkpoint* checkpoint, Completion completion) {
    if (checkpoint == nullptr && !is_staged_)
      throw std::logic_error("record: there is no checkpoint to publish");
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

  Gathered& column_for(std::size_t dataset, std::size_t size, std::size_t rows) {
    Gathered& column = columns_.at(dataset);
    if (column.begun() > 0)
      throw std::invalid_argument(fmt::format("record: a row of '{}' is begun in parts", column.description.path));
    if (size != rows * column.row_size)
      throw std::invalid_argument(fmt::format("record: a row of '{}' has {} values, not {}", column.description.path,
                                              column.row_size, static_cast<double>(size) / static_cast<double>(rows)));
    return column;
  }

  void add(Gathered& column, std::span<const std::byte> bytes) {
    bytes_since_flush_ += bytes.size();
    column.add(bytes);
  }
  /// Moves what waits to the working file where it is too much.
  void add_part(Gathered& column, std::span<const double> part) {
    add(column, std::as_bytes(part));
    if (bytes_since_flush_ > policy_.buffer_bytes)
      detail::with_file(path_, [&] { flush(Gathered::Of::all); });
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
    column.complete = column.appended = static_cast<std::size_t>(rows);
    column.flushed = column.flushable(Gathered::Of::whole_levels);
    std::uint64_t left = column.flushed;
    detail::read_through(dataset, [&](std::span<const std::byte> bytes) {
      const auto part = bytes.first(std::min<std::uint64_t>(left, bytes.size()));
      column.checksum_of_flushed.add(part);
      left -= part.size();
    });
    const std::size_t in_file = column.flushed / column.row_bytes, left_over = column.complete - in_file;
    column.waiting.resize(left_over * column.row_bytes);
    detail::read_rows(dataset, detail::memory_type(column.description.type), in_file, left_over, column.waiting.data());
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
                     (end + column.row_bytes - 1) / column.row_bytes, end);
    file.close("writing the working file");
    working_->trim();
    for (auto& column : columns_)
      column.flush_to(column.flushable(of));
  }

  [[nodiscard]] static std::uint64_t bytes_of(const Checkpoint& checkpoint) {
    std::uint64_t bytes = 0;
    for (const auto& [name, array] : checkpoint)
      bytes += 4096 + std::visit([](const auto& a) { return a.size() * sizeof(a[0]); }, array);
    return bytes;
  }
  [[nodiscard]] static std::uint64_t bytes_of(const CheckpointInParts& checkpoint) {
    return checkpoint.size * (sizeof(double) + 1);
  }

  /// Adds to a file with whole chunks what makes it a record of all complete levels.
  template <typename Stored>
  void complete_version(detail::TemporaryFile& version, const Stored* checkpoint, Completion completion, bool last) {
    detail::Handle file = open(version);
    version.reserve(waiting_bytes() + structure_bytes() + (checkpoint != nullptr ? bytes_of(*checkpoint) : 0));
    std::map<std::string, Checksum> checksums;
    for (auto& column : columns_) {
      const detail::Handle dataset = detail::open_dataset(file, column.description.path);
      // The last version shows provisional rows too; the attribute shows `resume` where the whole levels end.
      const std::size_t end = last ? column.appended : column.complete;
      write_column(dataset, column, end, end * column.row_bytes);
      checksums[column.description.path] = column.checksum_of(end);
      detail::write_attribute(dataset, detail::rows_attribute, Type::i64, static_cast<std::int64_t>(column.complete));
    }
    if (checkpoint != nullptr)
      detail::write_checkpoint(file, *checkpoint);
    detail::write_attribute(file, "finished", Type::u8, completion == Completion::complete ? 1 : 0);
    detail::write_seal(file, checksums);
    file.close("writing the record");
    version.trim();
    detail::mark(version);
  }

  Claim claim_;
  std::filesystem::path path_;
  bool overwrite_;
  CommitPolicy policy_;
  Layout layout_;
  std::vector<Gathered> columns_;
  std::vector<std::byte> converted_;  ///< rows of integers
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
    Claim claim(file, policy.locking);
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

void Writer::append(std::size_t dataset, std::span<const double> values, std::size_t rows) {
  implementation_->append(dataset, values, rows);
}
void Writer::append(std::size_t dataset, std::span<const std::int64_t> values, std::size_t rows) {
  implementation_->append(dataset, values, rows);
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
Checkpoint Writer::take_checkpoint() {
  return implementation_->take_checkpoint();
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
  implementation_->commit(checkpoint);
}
void Writer::commit(const CheckpointInParts& checkpoint) {
  implementation_->commit(checkpoint);
}
void Writer::stage(const CheckpointInParts& checkpoint) {
  implementation_->stage(checkpoint);
}
void Writer::finish(const Checkpoint& checkpoint, Completion completion) {
  implementation_->finish(&checkpoint, completion);
}
void Writer::finish(Completion completion) {
  implementation_->finish(nullptr, completion);
}

}  // namespace rubato::record
