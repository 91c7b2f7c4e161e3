#include "audit/stored.hpp"

#include <stdexcept>

#include <fmt/format.h>
#include <hdf5.h>

namespace audit {

namespace {

void read_dataset(hid_t dataset, const std::string& path, Stored& stored) {
  const hid_t type = H5Dget_type(dataset), space = H5Dget_space(dataset);
  const H5T_class_t kind = H5Tget_class(type);
  if (kind == H5T_FLOAT || kind == H5T_INTEGER) {
    std::vector<hsize_t> sizes(static_cast<std::size_t>(H5Sget_simple_extent_ndims(space)));
    H5Sget_simple_extent_dims(space, sizes.data(), nullptr);
    std::vector<double> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
    if (H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0) {
      throw std::runtime_error("cannot read " + path);
    }
    stored.shapes[path] = {sizes.begin(), sizes.end()};
    stored.datasets[path] = std::move(values);
  }
  H5Sclose(space);
  H5Tclose(type);
}

/// By links, not by objects: a dataset may have several names.
herr_t read_link(hid_t root, const char* name, const H5L_info_t*, void* data) {
  const hid_t object = H5Oopen(root, name, H5P_DEFAULT);
  if (H5Iget_type(object) == H5I_DATASET) {
    read_dataset(object, fmt::format("/{}", name), *static_cast<Stored*>(data));
  }
  H5Oclose(object);
  return 0;
}

herr_t read_attribute(hid_t root, const char* name, const H5A_info_t*, void* data) {
  auto& stored = *static_cast<Stored*>(data);
  const hid_t attribute = H5Aopen(root, name, H5P_DEFAULT);
  const hid_t type = H5Aget_type(attribute), space = H5Aget_space(attribute);
  const H5T_class_t kind = H5Tget_class(type);
  if ((kind == H5T_FLOAT || kind == H5T_INTEGER) && H5Sget_simple_extent_npoints(space) == 1) {
    double value = 0.0;
    H5Aread(attribute, H5T_NATIVE_DOUBLE, &value);
    stored.attributes[name] = value;
  }
  H5Sclose(space);
  H5Tclose(type);
  H5Aclose(attribute);
  return 0;
}

}  // namespace

const std::vector<double>& Stored::operator[](const std::string& path) const {
  const auto found = datasets.find(path);
  if (found == datasets.end()) {
    throw std::runtime_error("the record has no " + path);
  }
  return found->second;
}

std::vector<double> Stored::row(const std::string& path, std::size_t i) const {
  const std::vector<double>& values = (*this)[path];
  const std::size_t width = values.size() / shapes.at(path).at(0);
  const auto begin = values.begin() + static_cast<std::ptrdiff_t>(i * width);
  return {begin, begin + static_cast<std::ptrdiff_t>(width)};
}

Stored read_record(const std::filesystem::path& file) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (id < 0) {
    throw std::runtime_error("HDF5 cannot open " + file.string());
  }
  Stored stored;
  H5Lvisit(id, H5_INDEX_NAME, H5_ITER_NATIVE, read_link, &stored);
  H5Aiterate2(id, H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, read_attribute, &stored);
  H5Fclose(id);
  return stored;
}

}  // namespace audit
