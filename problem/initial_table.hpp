#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/jumps.hpp>
#include <rubato/problem/document.hpp>

/// [initial] from = "start.csv": a table of numbers as the start.
namespace rubato {

/// True if a file is read as a table, by its name: it ends with .csv.
[[nodiscard]] bool is_table(std::string_view file);

/// Numbers by columns, as many in each.
struct InitialTable {
  std::vector<std::string> names;
  std::vector<std::vector<double>> columns;
  std::vector<std::size_t> lines;  ///< of the file, for each row
};

/// Reads a table: a first line of names, then rows of as many numbers, separated by commas. Lines that are empty or
/// begin with # are passed over; so are quotes around names.
/// \throws ProblemError at `location`, with line and column of the file
[[nodiscard]] InitialTable read_table(const std::string& file, const Location& location);

/// The column `name` of a table. Columns x (y, z) say where each row is: the rows have to be the nodes of a grid of the
/// same box as `grid`, of any numbers of cells, in any order. Without them there is one row for each node of `grid`, x
/// fastest.
/// \throws ProblemError at `location`
[[nodiscard]] FieldOnGrid field_of_table(const InitialTable& table, const std::string& file, const std::string& name,
                                         const grids::Grid& grid, const Location& location);

}  // namespace rubato
