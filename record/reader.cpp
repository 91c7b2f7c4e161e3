#include <fmt/format.h>
#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/gate.hpp>
#include <rubato/record/detail/seal.hpp>
#include <rubato/record/detail/structure.hpp>
#include <rubato/record/reader.hpp>

namespace rubato::record {

namespace {

Header read_header(hid_t file) {
  Header header;
  header.format = detail::read_text_attribute(file, "format");
  header.title = detail::read_text_attribute(file, "title");
  header.problem = detail::read_text_attribute(file, "problem");
  header.version = detail::read_text_attribute(file, "version");
  header.compiler = detail::read_text_attribute(file, "compiler");
  header.threads = static_cast<int>(detail::read_integer_attribute(file, "threads"));
  header.finished = detail::read_integer_attribute(file, "finished") != 0;
  return header;
}

DatasetInfo describe(hid_t file, const std::string& path) {
  const detail::Handle dataset = detail::open_dataset(file, path);
  DatasetInfo info;
  info.path = path;
  const detail::Handle type(H5Dget_type(dataset), H5Tclose, "reading a type");
  info.is_text = H5Tget_class(type) == H5T_STRING;
  if (!info.is_text)
    info.type = detail::type_of(type);
  for (const auto size : detail::extent(dataset))
    info.shape.push_back(size);
  info.dimensions = detail::dimension_names(dataset, path);
  if (detail::has_attribute(dataset, "description"))
    info.description = detail::read_text_attribute(dataset, "description");
  info.grows = detail::has_attribute(dataset, detail::rows_attribute);
  return info;
}

template <class Number>
std::vector<Number> read_numbers(hid_t dataset, hid_t memory, const std::string& path, std::size_t first,
                                 std::size_t count) {
  const auto sizes = detail::extent(dataset);
  if (sizes.empty() || first > sizes.front() || count > sizes.front() - first)
    throw detail::Failure(fmt::format("rows {} to {} of '{}' were asked for; it has {}", first, first + count, path,
                                      sizes.empty() ? 0 : sizes.front()));
  std::size_t values = count;
  for (std::size_t i = 1; i < sizes.size(); ++i)
    values *= sizes[i];
  std::vector<Number> numbers(values);
  detail::read_rows(dataset, memory, first, count, numbers.data());
  return numbers;
}

}  // namespace

std::size_t DatasetInfo::row_size() const {
  std::size_t size = 1;
  for (std::size_t i = 1; i < shape.size(); ++i)
    size *= shape[i];
  return size;
}

class Reader::Implementation {
public:
  Implementation(std::filesystem::path path, Altered altered) : path_(std::move(path)) {
    // A run may put a new version into its place between two looks.
    constexpr int most_tries = 10;
    detail::Descriptor opened;
    for (int i = 0; i < most_tries; ++i) {
      opened = detail::open_regular(path_);
      if (H5Fis_hdf5(path_.c_str()) == 0)
        throw Error(path_, "is not an HDF5 file");
      file_ = detail::open_file(path_, H5F_ACC_RDONLY);
      if (detail::same_file(opened.number(), detail::descriptor_of(file_)))
        break;
    }
    may_be_altered_ = detail::admit(file_, opened.number()) != detail::Integrity::intact;
    if (may_be_altered_ && altered == Altered::refused)
      detail::require_unaltered(file_);
    header_ = read_header(file_);
  }
  Implementation(const Implementation&) = delete;
  Implementation& operator=(const Implementation&) = delete;
  ~Implementation() {
    const detail::Session session;
    file_ = {};
  }

  /// Calls `read` with the file, or with an open dataset of it.
  template <class Read>
  auto in_file(Read&& read) const {
    return detail::with_file(path_, [&] { return read(file_); });
  }
  template <class Read>
  auto in_dataset(const std::string& path, Read&& read) const {
    return detail::with_file(path_, [&] {
      try {
        return read(detail::open_dataset(file_, path));
      } catch (const detail::Failure& failure) {
        const std::string reason = failure.what();
        throw detail::Failure(reason.find(path) != std::string::npos ? reason
                                                                     : fmt::format("dataset '{}': {}", path, reason));
      }
    });
  }

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] const Header& header() const { return header_; }
  [[nodiscard]] std::vector<std::string> altered() const {
    return may_be_altered_ ? in_file([](hid_t file) { return detail::altered_names(file); })
                           : std::vector<std::string>{};
  }

private:
  std::filesystem::path path_;
  detail::Handle file_;
  Header header_;
  bool may_be_altered_ = true;
};

Reader::Reader(const std::filesystem::path& file, Altered altered)
    : implementation_(detail::with_file(file, [&] { return std::make_unique<Implementation>(file, altered); })) {}
Reader::Reader(Reader&&) noexcept = default;
Reader& Reader::operator=(Reader&&) noexcept = default;
Reader::~Reader() = default;

const std::filesystem::path& Reader::file() const {
  return implementation_->path();
}
const Header& Reader::header() const {
  return implementation_->header();
}

std::vector<std::string> Reader::altered() const {
  return implementation_->altered();
}

std::vector<DatasetInfo> Reader::datasets() const {
  return implementation_->in_file([](hid_t file) {
    std::vector<DatasetInfo> infos;
    for (const auto& path : detail::dataset_paths(file))
      infos.push_back(describe(file, path));
    return infos;
  });
}

bool Reader::has(const std::string& path) const {
  return implementation_->in_file([&](hid_t file) {
    // Each link on the way must exist before HDF5 may be asked about the next one.
    for (std::size_t slash = path.find('/', 1);; slash = path.find('/', slash + 1)) {
      if (H5Lexists(file, path.substr(0, slash).c_str(), H5P_DEFAULT) <= 0)
        return false;
      if (slash == std::string::npos)
        return H5Oexists_by_name(file, path.c_str(), H5P_DEFAULT) > 0;
    }
  });
}

DatasetInfo Reader::info(const std::string& path) const {
  return implementation_->in_file([&](hid_t file) { return describe(file, path); });
}

std::size_t Reader::rows(const std::string& path) const {
  return implementation_->in_dataset(path, [](hid_t dataset) -> std::size_t {
    const auto sizes = detail::extent(dataset);
    return sizes.empty() ? 1 : sizes.front();
  });
}

std::vector<double> Reader::read(const std::string& path) const {
  return read(path, 0, rows(path));
}

std::vector<double> Reader::read(const std::string& path, std::size_t first, std::size_t count) const {
  return implementation_->in_dataset(
      path, [&](hid_t dataset) { return read_numbers<double>(dataset, H5T_NATIVE_DOUBLE, path, first, count); });
}

std::vector<double> Reader::read_part(const std::string& path, std::size_t row, std::size_t first,
                                      std::size_t count) const {
  return implementation_->in_dataset(path, [&](hid_t dataset) {
    auto sizes = detail::extent(dataset);
    if (sizes.size() < 2 || row >= sizes[0] || first > sizes[1] || count > sizes[1] - first)
      throw detail::Failure(fmt::format("a part of row {} of '{}' was asked for that it has not", row, path));
    sizes[0] = 1;
    sizes[1] = count;
    std::size_t values = 1;
    for (const auto size : sizes)
      values *= size;
    std::vector<double> numbers(values);
    detail::read_block(dataset, H5T_NATIVE_DOUBLE, {row, first}, sizes, numbers.data());
    return numbers;
  });
}

std::vector<std::int64_t> Reader::read_integers(const std::string& path) const {
  return implementation_->in_dataset(path, [&](hid_t dataset) {
    const detail::Handle type(H5Dget_type(dataset), H5Tclose, "reading a type");
    if (H5Tget_class(type) != H5T_INTEGER)
      throw detail::Failure(fmt::format("dataset '{}' does not hold integers", path));
    return read_numbers<std::int64_t>(dataset, H5T_NATIVE_INT64, path, 0, detail::extent(dataset).at(0));
  });
}

std::vector<std::string> Reader::read_strings(const std::string& path) const {
  return implementation_->in_dataset(path, [](hid_t dataset) { return detail::read_texts(dataset); });
}

Checkpoint Reader::checkpoint(const std::string& left_out) const {
  return implementation_->in_file([&](hid_t file) { return detail::read_checkpoint(file, left_out); });
}

}  // namespace rubato::record
