#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/hdf5.hpp>
#include <rubato/record/detail/structure.hpp>
#include <rubato/record/writer.hpp>

namespace rubato::record {

namespace {

using Clock = std::chrono::steady_clock;

/// A growing dataset on its way to the file. Rows [0, flushed) are in the working file, the rest is in `waiting`.
struct Column {
  Dataset description;
  std::size_t row_size;
  std::size_t row_bytes;
  std::size_t chunk_rows;
  std::size_t flushed = 0;
  std::size_t complete = 0;  ///< rows of whole levels
  std::size_t appended = 0;
  std::vector<std::byte> waiting = {};

  /// Rows of whole levels that also fill whole chunks. Only these enter the working file: every chunk in it is
  /// compressed and written once, so that versions do not pile up dead space in it.
  [[nodiscard]] std::size_t flushable() const { return complete - complete % chunk_rows; }
};

std::vector<Column> columns_of(const Layout& layout) {
  std::vector<Column> columns;
  for (const auto& dataset : layout.datasets) {
    const std::size_t bytes = detail::size_of(dataset.type);
    const std::size_t row_size = detail::row_size(layout, dataset);
    const auto chunk = detail::chunk_shape(detail::row_shape(layout, dataset), bytes);
    columns.push_back({dataset, row_size, row_size * bytes, chunk.front()});
  }
  return columns;
}

void write_column(hid_t dataset, const Column& column, std::size_t end) {
  auto sizes = detail::extent(dataset);
  sizes.front() = end;
  detail::check(H5Dset_extent(dataset, sizes.data()), "extending a dataset");
  detail::write_rows(dataset, detail::memory_type(column.description.type), column.flushed, end - column.flushed,
                     column.waiting.data());
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

}  // namespace

class Writer::Implementation {
public:
  Implementation(const std::filesystem::path& file, const Layout& layout, CommitPolicy policy)
      : path_(std::filesystem::weakly_canonical(
            std::filesystem::absolute(file))),  // a symbolic link stays, what it leads to is replaced
        working_(with_suffix(".partial")),
        next_(with_suffix(".next")),
        policy_(policy),
        layout_(layout),
        columns_(columns_of(layout)),
        lock_(working_) {}

  ~Implementation() {
    if (closed_)
      return;
    std::error_code ignored;
    std::filesystem::remove(next_, ignored);
    std::filesystem::remove(working_, ignored);
  }

  void start() {
    detail::Handle file = detail::create_file(working_);
    detail::reserve(working_, structure_bytes());
    detail::create_structure(file, layout_);
    file.close("writing the working file");
    detail::trim(working_);
  }

  void take_over() {
    detail::copy_contents(path_, working_);
    detail::Handle file = detail::open_file(working_, H5F_ACC_RDWR);
    detail::check_format(file);
    detail::compare_structure(file, layout_);
    detail::reserve(working_, structure_bytes());
    for (auto& column : columns_)
      take_over(file, column);
    detail::write_root_attributes(file, layout_);
    detail::write_attribute(file, "finished", Type::u8, 0);
    file.close("writing the working file");
    detail::trim(working_);
    if (const std::string contradiction = different_rows(); !contradiction.empty())
      throw detail::Failure(contradiction);
  }

  void append(std::size_t dataset, std::span<const double> row) {
    Column& column = column_for(dataset, row.size());
    if (column.description.type != Type::f64)
      throw std::invalid_argument(fmt::format("record: '{}' takes integers", column.description.path));
    if (!column.description.may_be_undefined)
      for (std::size_t i = 0; i < row.size(); ++i)
        if (!std::isfinite(row[i]))
          throw std::invalid_argument(fmt::format("record: value {} of row {} of '{}' is {}", i, column.appended,
                                                  column.description.path, row[i]));
    std::memcpy(grow(column), row.data(), column.row_bytes);
    ++column.appended;
  }

  void append(std::size_t dataset, std::span<const std::int64_t> row) {
    Column& column = column_for(dataset, row.size());
    const std::string& path = column.description.path;
    std::vector<std::byte> converted(column.row_bytes);
    switch (column.description.type) {
      case Type::f64: throw std::invalid_argument(fmt::format("record: '{}' takes floating-point numbers", path));
      case Type::i64: store<std::int64_t>(row, path, converted.data()); break;
      case Type::i32: store<std::int32_t>(row, path, converted.data()); break;
      case Type::u8: store<std::uint8_t>(row, path, converted.data()); break;
    }
    std::memcpy(grow(column), converted.data(), column.row_bytes);
    ++column.appended;
  }

  [[nodiscard]] std::size_t rows(std::size_t dataset) const { return columns_.at(dataset).appended; }

  void end_level() {
    check_axes();
    for (auto& column : columns_)
      column.complete = column.appended;
    if (bytes_since_flush_ > policy_.buffer_bytes)
      detail::with_file(path_, [&] { flush(); });
  }

  [[nodiscard]] bool commit_due() const {
    return Clock::now() - last_commit_ >= std::max(policy_.interval, policy_.times_last_commit * commit_duration_);
  }

  void commit(const Checkpoint& checkpoint) {
    const auto begin = Clock::now();
    detail::with_file(path_, [&] {
      flush();
      detail::copy_contents(working_, next_);
      complete_version(next_, checkpoint, Completion::interrupted, false);
      std::filesystem::rename(next_, path_);
    });
    last_commit_ = Clock::now();
    commit_duration_ = last_commit_ - begin;
  }

  void finish(const Checkpoint& checkpoint, Completion completion) {
    detail::with_file(path_, [&] {
      flush();
      check_axes();
      complete_version(working_, checkpoint, completion, true);
      detail::synchronize(working_);
      // An ordinary reader takes a shared lock, which ours would refuse.
      lock_.release();
      std::filesystem::rename(working_, path_);
      closed_ = true;
      std::filesystem::remove(next_);  // left by a writer that was killed
      detail::synchronize(path_.parent_path());
    });
  }

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
  [[nodiscard]] std::filesystem::path with_suffix(const char* suffix) const {
    std::filesystem::path sibling = path_;
    sibling += suffix;
    return sibling;
  }

  /// Generous bounds of what is written besides rows: object headers, indices of chunks, scales, attributes.
  [[nodiscard]] std::uint64_t structure_bytes() const {
    std::uint64_t bytes = (std::uint64_t{64} << 10) + 2 * layout_.problem.size();
    for (const auto& scale : layout_.scales)
      bytes += std::visit([](const auto& values) { return 64 * values.size(); }, scale.values) + 4096;
    return bytes + (std::uint64_t{16} << 10) * layout_.datasets.size();
  }

  [[nodiscard]] std::uint64_t waiting_bytes() const {
    std::uint64_t bytes = 0;
    for (const auto& column : columns_)
      bytes += column.waiting.size() + column.waiting.size() / 16 + column.chunk_rows * column.row_bytes;
    return bytes;
  }

  Column& column_for(std::size_t dataset, std::size_t size) {
    Column& column = columns_.at(dataset);
    if (size != column.row_size)
      throw std::invalid_argument(
          fmt::format("record: a row of '{}' has {} values, not {}", column.description.path, column.row_size, size));
    return column;
  }

  std::byte* grow(Column& column) {
    bytes_since_flush_ += column.row_bytes;
    column.waiting.resize(column.waiting.size() + column.row_bytes);
    return column.waiting.data() + column.waiting.size() - column.row_bytes;
  }

  /// Which datasets of one axis are not of one length; empty if none.
  [[nodiscard]] std::string different_rows() const {
    std::map<std::string_view, const Column*> axes;
    for (const auto& column : columns_) {
      const Column& first = *axes.try_emplace(column.description.axis, &column).first->second;
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

  void take_over(hid_t file, Column& column) const {
    const detail::Handle dataset = detail::open_dataset(file, column.description.path);
    auto sizes = detail::extent(dataset);
    const auto rows = detail::read_integer_attribute(dataset, detail::rows_attribute);
    if (rows < 0 || static_cast<hsize_t>(rows) > sizes.front())
      throw detail::Failure(
          fmt::format("dataset '{}' should have {} rows, but has {}", column.description.path, rows, sizes.front()));
    column.complete = column.appended = static_cast<std::size_t>(rows);
    column.flushed = column.flushable();
    column.waiting.resize((column.complete - column.flushed) * column.row_bytes);
    detail::read_rows(dataset, detail::memory_type(column.description.type), column.flushed,
                      column.complete - column.flushed, column.waiting.data());
    sizes.front() = column.flushed;
    detail::check(H5Dset_extent(dataset, sizes.data()), "shortening a dataset");
  }

  /// Moves whole chunks into the working file.
  void flush() {
    bytes_since_flush_ = 0;
    if (std::ranges::none_of(columns_, [](const Column& column) { return column.flushable() > column.flushed; }))
      return;
    detail::Handle file = detail::open_file(working_, H5F_ACC_RDWR);
    detail::reserve(working_, waiting_bytes() + structure_bytes());
    for (const auto& column : columns_)
      if (column.flushable() > column.flushed)
        write_column(detail::open_dataset(file, column.description.path), column, column.flushable());
    file.close("writing the working file");
    detail::trim(working_);
    for (auto& column : columns_) {
      const std::size_t done = (column.flushable() - column.flushed) * column.row_bytes;
      column.waiting.erase(column.waiting.begin(), column.waiting.begin() + static_cast<std::ptrdiff_t>(done));
      column.flushed = column.flushable();
    }
  }

  /// Adds to a file with whole chunks what makes it a record of all complete levels.
  void complete_version(const std::filesystem::path& version, const Checkpoint& checkpoint, Completion completion,
                        bool last) {
    detail::Handle file = detail::open_file(version, H5F_ACC_RDWR);
    std::uint64_t checkpoint_bytes = 0;
    for (const auto& [name, array] : checkpoint)
      checkpoint_bytes += 1024 + std::visit([](const auto& a) { return a.size() * sizeof(a[0]); }, array);
    detail::reserve(version, waiting_bytes() + structure_bytes() + checkpoint_bytes);
    for (const auto& column : columns_) {
      const detail::Handle dataset = detail::open_dataset(file, column.description.path);
      // The last version shows provisional rows too; the attribute tells `resume` where the whole levels end.
      write_column(dataset, column, last ? column.appended : column.complete);
      detail::write_attribute(dataset, detail::rows_attribute, Type::i64, static_cast<std::int64_t>(column.complete));
    }
    detail::write_checkpoint(file, checkpoint);
    detail::write_attribute(file, "finished", Type::u8, completion == Completion::complete ? 1 : 0);
    file.close("writing the record");
    detail::trim(version);
  }

  std::filesystem::path path_;
  std::filesystem::path working_;
  std::filesystem::path next_;
  CommitPolicy policy_;
  Layout layout_;
  std::vector<Column> columns_;
  detail::FileLock lock_;
  std::size_t bytes_since_flush_ = 0;
  Clock::time_point last_commit_ = Clock::now();
  std::chrono::duration<double> commit_duration_{0};
  bool closed_ = false;
};

Writer::Writer(std::unique_ptr<Implementation> implementation) : implementation_(std::move(implementation)) {}
Writer::Writer(Writer&&) noexcept = default;
Writer& Writer::operator=(Writer&&) noexcept = default;
Writer::~Writer() = default;

Writer Writer::create(const std::filesystem::path& file, const Layout& layout, bool overwrite, CommitPolicy policy) {
  detail::validate(layout);
  return detail::with_file(file, [&] {
    if (std::filesystem::exists(file)) {
      if (!std::filesystem::is_regular_file(file))
        throw Error(file, "is not a regular file");
      if (!overwrite)
        throw AlreadyExists(file, "already exists");
    }
    auto implementation = std::make_unique<Implementation>(file, layout, policy);
    implementation->start();
    return Writer(std::move(implementation));
  });
}

Writer Writer::resume(const std::filesystem::path& file, const Layout& layout, CommitPolicy policy) {
  detail::validate(layout);
  return detail::with_file(file, [&] {
    {
      const detail::Handle published = detail::open_file(file, H5F_ACC_RDONLY);
      detail::check_format(published);
    }
    auto implementation = std::make_unique<Implementation>(file, layout, policy);
    implementation->take_over();
    return Writer(std::move(implementation));
  });
}

void Writer::append(std::size_t dataset, std::span<const double> row) {
  implementation_->append(dataset, row);
}
void Writer::append(std::size_t dataset, std::span<const std::int64_t> row) {
  implementation_->append(dataset, row);
}
std::size_t Writer::rows(std::size_t dataset) const {
  return implementation_->rows(dataset);
}
void Writer::end_level() {
  implementation_->end_level();
}
bool Writer::commit_due() const {
  return implementation_->commit_due();
}
void Writer::commit(const Checkpoint& checkpoint) {
  implementation_->commit(checkpoint);
}
void Writer::finish(const Checkpoint& checkpoint, Completion completion) {
  implementation_->finish(checkpoint, completion);
}

}  // namespace rubato::record
