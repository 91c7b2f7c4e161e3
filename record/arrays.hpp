#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <rubato/record/error.hpp>

namespace rubato::record {

/// Numbers in the order of the file, the last index fastest; no shape for a single number.
struct Array {
  std::vector<std::size_t> shape;
  std::vector<double> values;
};

/// A file has no group of the name that was asked for.
class NoSuchGroup : public Error {
public:
  using Error::Error;
};

/// The arrays of numbers directly in a group of an HDF5 file that need not be a record. Integers and numbers of other
/// precision are read as doubles. All functions throw Error.
class ArrayFile {
public:
  explicit ArrayFile(const std::filesystem::path& file, const std::string& group = "/");
  ArrayFile(ArrayFile&&) noexcept;
  ArrayFile& operator=(ArrayFile&&) noexcept;
  ~ArrayFile();

  [[nodiscard]] std::vector<std::string> names() const;  ///< in the alphabet's order
  [[nodiscard]] bool has(const std::string& name) const;
  [[nodiscard]] std::vector<std::size_t> shape(const std::string& name) const;
  [[nodiscard]] Array read(const std::string& name) const;
  /// One row, by the first index; its shape is without that.
  [[nodiscard]] Array read(const std::string& name, std::size_t row) const;

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// True if a file says of itself that it is a record, of any version. \throws Error if it cannot be read, or is not
/// HDF5
[[nodiscard]] bool is_record(const std::filesystem::path& file);

}  // namespace rubato::record
