#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace rubato::record {

/// How the numbers of a dataset are stored (little-endian IEEE 754 and two's complement, whatever wrote them).
enum class Type { f64, i64, i32, u8 };

/// A dataset of fixed extent in one dimension that names the places along an axis: node coordinates, or the names of
/// coordinates. It is an HDF5 dimension scale, so that other datasets may use it as one of their dimensions.
struct Scale {
  std::string path;  ///< absolute, such as "/grid/x"
  std::variant<std::vector<double>, std::vector<std::string>> values;
  std::string description = {};
};

/// A dataset that grows by whole rows along an axis. Datasets with the same axis have the same number of rows whenever
/// a level ends.
struct Dataset {
  std::string path;  ///< absolute, such as "/states/q"
  /// Path of the growing dataset whose rows are the places along the first dimension: "/levels/t" for what lives on
  /// levels, "/levels/step" for what lives on steps, "/states/t" for what lives on stored levels. A dataset that is
  /// its own axis has one number per row.
  std::string axis;
  /// Paths of the scales along the further dimensions, slowest first; their sizes are the shape of a row. Empty: one
  /// number per row.
  std::vector<std::string> dimensions = {};
  Type type = Type::f64;
  std::string description = {};
  bool may_be_undefined = false;  ///< allows values that are not finite, which `Writer::append` refuses otherwise
  /// About how many rows there will be, if that is known: the last chunk of a dataset is in the file whole, however few
  /// of its rows are used, so that chunks of short datasets are small.
  std::optional<std::size_t> expected_rows = std::nullopt;
  /// Ranks write its rows together if they are long and not compressed (record/together.hpp).
  bool together = false;
};

/// A dataset of a Layout, as rows are appended to it.
struct Column {
  std::size_t number = static_cast<std::size_t>(-1);
};

/// Levels of zlib: none unless asked for.
///@{
inline constexpr int usual_compression = 0;
inline constexpr int most_compression = 9;
///@}

/// All that a record holds, except the numbers. The strings become attributes of the root (UTF-8).
///
/// In every group that uses a scale or an axis living elsewhere a hard link of the same name is made, so that readers
/// that open one group (xarray, netCDF) find the coordinates of its dimensions in it. Hence the last parts of the paths
/// of the axes and dimensions used in one group must differ from each other and from those of its other datasets.
struct Layout {
  std::string title;
  std::string problem;   ///< the whole effective problem text
  std::string version;   ///< of the writing library
  std::string compiler;  ///< that built it, with the flags that matter
  int threads = 1;
  int compression = usual_compression;  ///< of the rows: 0, none, to most_compression
  std::vector<Scale> scales = {};
  std::vector<Dataset> datasets = {};

  /// Adds a dataset. \return what its rows are appended by
  Column add(Dataset dataset) {
    datasets.push_back(std::move(dataset));
    return {datasets.size() - 1};
  }
};

/// The number of values in one row of a dataset. Throws std::invalid_argument if the layout has none of its scales.
[[nodiscard]] std::size_t row_size(const Layout& layout, const Dataset& dataset);

/// Named arrays that `resume` needs, stored under /checkpoint and replaced as a whole. A string is stored as bytes.
using CheckpointArray = std::variant<std::vector<double>, std::vector<std::int64_t>, std::string>;
using Checkpoint = std::map<std::string, CheckpointArray>;

/// A checkpoint of which one array, of `size` numbers, does not have to fit into memory.
struct CheckpointInParts {
  using Take = std::function<void(std::span<const double>)>;
  std::string name;
  std::size_t size = 0;
  std::function<void(const Take&)> hand_over;  ///< calls what it is given with part after part
  std::function<Checkpoint()> others;          ///< all other arrays; called after that
};

}  // namespace rubato::record
