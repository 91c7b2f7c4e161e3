#include <algorithm>

#include <fmt/format.h>

#include <rubato/record/arrays.hpp>
#include <rubato/record/detail/files.hpp>
#include <rubato/record/detail/hdf5.hpp>

namespace rubato::record {

namespace {

detail::Handle open_hdf5(const std::filesystem::path& file) {
  static_cast<void>(detail::open_regular(file));  // no folder, no pipe
  if (H5Fis_hdf5(file.c_str()) == 0) {
    throw Error(file, "is not an HDF5 file");
  }
  return detail::open_file(file, H5F_ACC_RDONLY);
}

/// The names of all datasets of numbers in a group.
std::vector<std::string> number_arrays(hid_t group) {
  std::vector<std::string> links;
  const auto collect = [](hid_t, const char* name, const H5L_info_t*, void* into) -> herr_t {
    static_cast<std::vector<std::string>*>(into)->emplace_back(name);
    return 0;
  };
  detail::check(H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, nullptr, collect, &links), "listing a group");
  std::erase_if(links, [&](const std::string& name) {
    const hid_t object = H5Oopen(group, name.c_str(), H5P_DEFAULT);
    if (object < 0) {
      return true;  // a link that leads nowhere
    }
    const detail::Handle held(object, H5Oclose, "looking into a group");
    if (H5Iget_type(object) != H5I_DATASET) {
      return true;
    }
    const detail::Handle type(H5Dget_type(object), H5Tclose, "reading a type");
    const H5T_class_t kind = H5Tget_class(type);
    return kind != H5T_FLOAT && kind != H5T_INTEGER;
  });
  return links;
}

/// Deflate makes at most 1032 bytes out of one: what claims more is damaged, or would fill the memory with nothing.
void require_stored(hid_t dataset, const std::filesystem::path& file) {
  constexpr double most_deflation = 1032.0;
  const detail::Handle type(H5Dget_type(dataset), H5Tclose, "reading a type");
  double claimed = static_cast<double>(H5Tget_size(type));
  for (const hsize_t size : detail::extent(dataset)) {
    claimed *= static_cast<double>(size);
  }
  const double stored = std::min(static_cast<double>(H5Dget_storage_size(dataset)),
                                 static_cast<double>(std::filesystem::file_size(file)));
  if (claimed > most_deflation * stored) {
    throw detail::Failure(fmt::format("it claims {:.3g} bytes, but the file holds {:.3g} of it", claimed, stored));
  }
}

}  // namespace

class ArrayFile::Implementation {
public:
  Implementation(std::filesystem::path path, const std::string& group) : path_(std::move(path)) {
    file_ = open_hdf5(path_);
    if (group != "/" && H5Lexists(file_, group.c_str(), H5P_DEFAULT) <= 0) {
      throw NoSuchGroup(path_, fmt::format("has no group {}", group));
    }
    H5O_info_t info;
    if (H5Oget_info_by_name2(file_, group.c_str(), &info, H5O_INFO_BASIC, H5P_DEFAULT) < 0 ||
        info.type != H5O_TYPE_GROUP) {
      throw NoSuchGroup(path_, fmt::format("{} is not a group", group));
    }
    group_ = detail::Handle(H5Gopen2(file_, group.c_str(), H5P_DEFAULT), H5Gclose, "opening the group " + group);
    names_ = number_arrays(group_);
  }
  Implementation(const Implementation&) = delete;
  Implementation& operator=(const Implementation&) = delete;
  ~Implementation() {
    const detail::Session session;
    group_ = {};
    file_ = {};
  }

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  template <class Read>
  auto in_dataset(const std::string& name, Read&& read) const {
    return detail::with_file(path_, [&] {
      const detail::Handle dataset = detail::open_dataset(group_, name);
      try {
        require_stored(dataset, path_);
        return read(dataset);
      } catch (const detail::Failure& failure) {
        throw detail::Failure(fmt::format("dataset {}: {}", name, failure.what()));
      }
    });
  }

private:
  std::filesystem::path path_;
  detail::Handle file_, group_;
  std::vector<std::string> names_;
};

ArrayFile::ArrayFile(const std::filesystem::path& file, const std::string& group)
    : implementation_(detail::with_file(file, [&] { return std::make_unique<Implementation>(file, group); })) {}
ArrayFile::ArrayFile(ArrayFile&&) noexcept = default;
ArrayFile& ArrayFile::operator=(ArrayFile&&) noexcept = default;
ArrayFile::~ArrayFile() = default;

std::vector<std::string> ArrayFile::names() const {
  return implementation_->names();
}

bool ArrayFile::has(const std::string& name) const {
  return std::ranges::find(implementation_->names(), name) != implementation_->names().end();
}

std::vector<std::size_t> ArrayFile::shape(const std::string& name) const {
  return implementation_->in_dataset(name, [](hid_t dataset) {
    const std::vector<hsize_t> sizes = detail::extent(dataset);
    return std::vector<std::size_t>(sizes.begin(), sizes.end());
  });
}

Array ArrayFile::read(const std::string& name) const {
  Array array{.shape = shape(name), .values = {}};
  std::size_t count = 1;
  for (const std::size_t size : array.shape) {
    count *= size;
  }
  array.values.resize(count);
  implementation_->in_dataset(name, [&](hid_t dataset) {
    if (count > 0) {
      detail::check(H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, array.values.data()),
                    "reading the dataset " + name);
    }
    return 0;
  });
  return array;
}

Array ArrayFile::read(const std::string& name, std::size_t row) const {
  Array array{.shape = shape(name), .values = {}};
  array.shape.erase(array.shape.begin());
  std::size_t count = 1;
  for (const std::size_t size : array.shape) {
    count *= size;
  }
  array.values.resize(count);
  implementation_->in_dataset(name, [&](hid_t dataset) {
    detail::read_rows(dataset, H5T_NATIVE_DOUBLE, row, 1, array.values.data());
    return 0;
  });
  return array;
}

bool is_record(const std::filesystem::path& file) {
  return detail::with_file(file, [&] {
    const detail::Handle opened = open_hdf5(file);
    // By their presence: texts of a file that may be damaged are read behind the gate of records only.
    return detail::has_attribute(opened, "format") && detail::has_attribute(opened, "problem") &&
           detail::has_attribute(opened, "compiler");
  });
}

}  // namespace rubato::record
