#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>

#include <fmt/format.h>

#include <rubato/record/layout.hpp>

namespace rubato::record {

/// A record could not be read or written: the text names the file and the reason the system or HDF5 gave.
class Error : public std::runtime_error {
public:
  Error(std::filesystem::path file, const std::string& reason)
      : std::runtime_error(file.string() + ": " + reason), file_(std::move(file)) {}

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

private:
  std::filesystem::path file_;
};

/// A new record was to be written where a file already is, without leave to replace it.
class AlreadyExists : public Error {
public:
  using Error::Error;
};

/// A value that is not finite was to be stored where none may be: the text names the dataset, the row and the value.
class NotFinite : public std::invalid_argument {
public:
  NotFinite(const Dataset& dataset, std::size_t row, std::size_t place, double value)
      : std::invalid_argument(fmt::format("record: value {} of row {} of '{}' is {}", place, row, dataset.path, value)),
        what_is_(fmt::format("a value of {} is {}", dataset.path, value)) {}

  /// "a value of /levels/energy is nan"
  [[nodiscard]] const std::string& what_is() const { return what_is_; }

private:
  std::string what_is_;
};

/// Throws NotFinite at the first value that is not finite, unless the dataset may have such values.
/// \param values of rows of `row_size` values each, one row after the other
/// \param before the number of values of the dataset that precede them
void require_finite(const Dataset& dataset, std::span<const double> values, std::size_t row_size, std::size_t before);

}  // namespace rubato::record
