#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace audit {

/// All numbers of a record, as HDF5 gives them: the path of each dataset, and its values in the order of the file.
struct Stored {
  std::map<std::string, std::vector<double>> datasets;
  std::map<std::string, std::vector<std::size_t>> shapes;
  std::map<std::string, double> attributes;  ///< numbers among the attributes of the root

  [[nodiscard]] bool has(const std::string& path) const { return datasets.contains(path); }
  /// Throws if it is absent.
  [[nodiscard]] const std::vector<double>& operator[](const std::string& path) const;
  /// Everything at place i of the first dimension.
  [[nodiscard]] std::vector<double> row(const std::string& path, std::size_t i) const;
};

Stored read_record(const std::filesystem::path& file);

}  // namespace audit
