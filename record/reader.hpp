#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <rubato/record/error.hpp>
#include <rubato/record/layout.hpp>

namespace rubato::record {

/// The attributes of a record's root.
struct Header {
  std::string format;  ///< "rubato-1"
  std::string title;
  std::string problem;
  std::string version;
  std::string compiler;
  int threads = 0;
  bool finished = false;
};

/// What a dataset is like. `dimensions` has the names of its axes ("t", "x", …), as many as `shape` has sizes.
struct DatasetInfo {
  std::string path;
  bool is_text = false;
  Type type = Type::f64;
  std::vector<std::size_t> shape;
  std::vector<std::string> dimensions;
  std::string description;
  bool grows = false;  ///< false for scales of fixed extent and for arrays of the checkpoint

  /// The number of values in one row: the product of all sizes but the first.
  [[nodiscard]] std::size_t row_size() const;
};

/// What becomes of a record that another program has altered, by the checksums in its attribute `checksums`.
enum class Altered {
  refused,   ///< it is an Error, with the first attribute or dataset that is not what was written
  reported,  ///< it is read, and Reader::altered() names them all: for those who look for the place
};

/// Reads a record, which may be one that a run is still writing: the version at the time of opening is seen throughout.
/// All functions throw Error, with the reason: no such file, not HDF5 or damaged, not a record, a later format.
class Reader {
public:
  explicit Reader(const std::filesystem::path& file, Altered altered = Altered::refused);
  Reader(Reader&&) noexcept;
  Reader& operator=(Reader&&) noexcept;
  ~Reader();

  [[nodiscard]] const std::filesystem::path& file() const;
  [[nodiscard]] const Header& header() const;

  /// What another program has altered or replaced: names of attributes of the root, paths of datasets, "/checkpoint".
  /// Empty for records of versions without the checksums. Reads all values of a file that another program wrote to.
  [[nodiscard]] std::vector<std::string> altered() const;

  /// Every dataset in alphabetical order of paths. An axis is listed under each path that it is linked from.
  [[nodiscard]] std::vector<DatasetInfo> datasets() const;
  [[nodiscard]] bool has(const std::string& path) const;
  [[nodiscard]] DatasetInfo info(const std::string& path) const;

  /// The extent along the first dimension.
  [[nodiscard]] std::size_t rows(const std::string& path) const;

  /// All values, the last dimension fastest. Integers are converted.
  [[nodiscard]] std::vector<double> read(const std::string& path) const;
  /// Rows first, …, first + count - 1.
  [[nodiscard]] std::vector<double> read(const std::string& path, std::size_t first, std::size_t count) const;
  /// Of one row, the places first, …, first + count - 1 along the second dimension.
  [[nodiscard]] std::vector<double> read_part(const std::string& path, std::size_t row, std::size_t first,
                                              std::size_t count) const;
  /// All values of a dataset of an integer type.
  [[nodiscard]] std::vector<std::int64_t> read_integers(const std::string& path) const;
  /// All values of a scale of names.
  [[nodiscard]] std::vector<std::string> read_strings(const std::string& path) const;

  /// All that belongs to the last complete level; without the array `left_out`, which is looked at all the same, and
  /// can be read as the dataset "/checkpoint/NAME".
  [[nodiscard]] Checkpoint checkpoint(const std::string& left_out = {}) const;

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace rubato::record
