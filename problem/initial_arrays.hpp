#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/jumps.hpp>
#include <rubato/problem/document.hpp>

/// [initial] from = "data.h5": datasets of an HDF5 file of another program as the start.
namespace rubato {

/// What `from` names: "data.h5", or a group of it, "data.h5:/final".
struct ArraySource {
  std::string file, group = "/";
};
/// True if it is an HDF5 file, or a group of one, that is no record. \throws record::Error if it cannot be read
[[nodiscard]] bool is_array_source(const std::string& from);
[[nodiscard]] ArraySource read_array_source(const std::string& from);

/// The level nearest to `at` of those in the dataset t, or the last one; none where there is no such dataset.
/// \throws ProblemError at `location`
[[nodiscard]] std::optional<double> level_of_arrays(const std::string& from, const std::optional<double>& at,
                                                    const Location& location);
/// Those of `names` that it has.
[[nodiscard]] std::vector<std::string> names_in_arrays(const std::string& from, std::span<const std::string> names);
/// The names of all its arrays, for messages.
[[nodiscard]] std::string list_of_arrays(const std::string& from);

/// As many numbers as `count` of the dataset `name` of an orbit, or a single one; with a dataset t, those of the level
/// `at`. \throws ProblemError at `location`
[[nodiscard]] std::vector<double> numbers_of_array(const std::string& from, const std::string& name, std::size_t count,
                                                   const std::optional<double>& at, const Location& location);

/// The dataset `name`, of shape [x], [y][x] or [z][y][x], with one index more in front where there is a dataset t of as
/// many levels: the nodes are those of so many cells of the box of `grid`. Where there are datasets x (y, z) they have
/// to be these nodes.
/// \throws ProblemError at `location`
[[nodiscard]] FieldOnGrid field_of_arrays(const std::string& from, const std::string& name, double at,
                                          const grids::Grid& grid, const Location& location);

}  // namespace rubato
