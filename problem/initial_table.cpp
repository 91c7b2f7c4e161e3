#include <rubato/problem/initial_table.hpp>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// Coordinates are written with a few digits: a node is where it is to so much of a spacing.
constexpr double misplaced = 1e-3;

std::string_view without_spaces(std::string_view text) {
  const auto is_space = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && is_space(text.front())) {
    text.remove_prefix(1);
  }
  while (!text.empty() && is_space(text.back())) {
    text.remove_suffix(1);
  }
  return text;
}

/// The cells of a line, with the column where each begins.
std::vector<std::pair<std::string_view, std::size_t>> cells_of(std::string_view line) {
  std::vector<std::pair<std::string_view, std::size_t>> cells;
  for (std::size_t begin = 0; begin <= line.size();) {
    const std::size_t end = std::min(line.find(',', begin), line.size());
    cells.emplace_back(without_spaces(line.substr(begin, end - begin)), begin + 1);
    begin = end + 1;
  }
  return cells;
}

std::optional<double> number_of(std::string_view text) {
  if (text.starts_with('+')) {
    text.remove_prefix(1);
  }
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && std::isfinite(value) ? std::optional(value) : std::nullopt;
}

/// Reads one file, and knows where in it it is.
class TableReader {
public:
  TableReader(const std::string& file, const Location& location) : file_(file), location_(location) {
    // Without opening what may never end, or be waited for.
    if (std::filesystem::exists(file_) && !std::filesystem::is_regular_file(file_)) {
      throw FileError(ProblemError(location_, fmt::format("from: {} is not a regular file", file_)).what());
    }
    in_.open(file_);
    if (!in_) {
      throw FileError(
          ProblemError(location_, fmt::format("from: {} cannot be read: {}", file_, std::strerror(errno))).what());
    }
  }

  InitialTable read() {
    InitialTable table;
    std::string line;
    for (number_ = 1; std::getline(in_, line); ++number_) {
      std::string_view text = line;
      if (number_ == 1 && text.starts_with("\xEF\xBB\xBF")) {
        text.remove_prefix(3);  // what spreadsheets put before UTF-8
      }
      if (without_spaces(text).empty() || without_spaces(text).starts_with('#')) {
        continue;
      }
      table.names.empty() ? take_names(text, table) : take_row(text, table);
    }
    if (table.lines.empty()) {
      throw ProblemError(location_, fmt::format("from: {} has no row of numbers below a line of names", file_));
    }
    return table;
  }

private:
  [[noreturn]] void refuse(std::size_t column, const std::string& what) const {
    throw ProblemError(location_, fmt::format("from: {}:{}:{}: {}", file_, number_, column, what));
  }

  void take_names(std::string_view line, InitialTable& table) const {
    for (auto [name, column] : cells_of(line)) {
      if (name.size() > 1 && name.front() == '"' && name.back() == '"') {
        name = name.substr(1, name.size() - 2);
      }
      if (!is_identifier(name)) {
        refuse(column, fmt::format("\"{}\" is no name; the first line names the columns", name.substr(0, 100)));
      }
      if (std::ranges::find(table.names, name) != table.names.end()) {
        refuse(column, fmt::format("the column {} is there twice", name));
      }
      table.names.emplace_back(name);
    }
    table.columns.resize(table.names.size());
  }

  void take_row(std::string_view line, InitialTable& table) const {
    const auto cells = cells_of(line);
    if (cells.size() != table.names.size()) {
      refuse(1, fmt::format("{} values, and the first line names {} columns", cells.size(), table.names.size()));
    }
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const auto& [text, column] = cells[i];
      const auto value = number_of(text);
      if (!value) {
        refuse(column, fmt::format("\"{}\" is not a finite number", text.substr(0, 100)));
      }
      table.columns[i].push_back(*value);
    }
    table.lines.push_back(number_);
  }

  const std::string& file_;
  const Location& location_;
  std::ifstream in_;
  std::size_t number_ = 0;
};

const std::vector<double>* column_of(const InitialTable& table, std::string_view name) {
  const auto found = std::ranges::find(table.names, name);
  return found == table.names.end() ? nullptr : &table.columns[static_cast<std::size_t>(found - table.names.begin())];
}

/// The grid that the rows are the nodes of, and which node each of them is.
class Nodes {
public:
  Nodes(const InitialTable& table, const std::string& file, const grids::Grid& grid, const Location& location)
      : table_(table), file_(file), location_(location) {
    std::vector<grids::Axis> axes;
    for (const grids::Axis& axis : grid.axes()) {
      const std::vector<double>* x = column_of(table, axis.name);
      if (x == nullptr) {
        throw ProblemError(location, fmt::format("from: {} has no column {}; name the place of each row by {}", file,
                                                 axis.name, names_of_axes(grid)));
      }
      axes.push_back(axis);
      axes.back().cells = count_of(*x, axis);
    }
    grid_.emplace(std::move(axes));
    place_rows();
  }

  [[nodiscard]] const grids::Grid& grid() const { return *grid_; }
  [[nodiscard]] std::vector<double> in_order(const std::vector<double>& column) const {
    std::vector<double> values(grid_->size());
    for (std::size_t row = 0; row < column.size(); ++row) {
      values[node_[row]] = column[row];
    }
    return values;
  }

private:
  static std::string names_of_axes(const grids::Grid& grid) {
    std::vector<std::string> names;
    for (const grids::Axis& axis : grid.axes()) {
      names.push_back(axis.name);
    }
    return fmt::format("{}", fmt::join(names, ", "));
  }

  /// How many different places there are along an axis.
  [[nodiscard]] std::size_t count_of(const std::vector<double>& x, const grids::Axis& axis) const {
    std::vector<double> sorted = x;
    std::ranges::sort(sorted);
    const double same = misplaced * axis.length() / static_cast<double>(sorted.size());
    std::size_t count = 1;
    for (std::size_t i = 1; i < sorted.size(); ++i) {
      count += sorted[i] - sorted[i - 1] > same ? 1 : 0;
    }
    if (count < 3) {
      throw ProblemError(
          location_, fmt::format("from: {} has {} places along {}; a grid has at least 3", file_, count, axis.name));
    }
    return count;
  }

  void place_rows() {
    const std::size_t rows = table_.lines.size();
    if (rows != grid_->size()) {
      throw ProblemError(location_, fmt::format("from: {} has {} rows, and its places make a grid of {} nodes", file_,
                                                rows, grid_->size()));
    }
    node_.assign(rows, 0);
    std::vector<bool> taken(rows, false);
    for (std::size_t row = 0; row < rows; ++row) {
      for (int a = 0; a < grid_->dimensions(); ++a) {
        const grids::Axis& axis = grid_->axis(a);
        const double x = (*column_of(table_, axis.name))[row];
        const double place = (x - axis.from) / axis.spacing();
        const double nearest = std::round(place);
        if (std::abs(place - nearest) > misplaced || nearest < 0.0 || nearest >= static_cast<double>(axis.cells)) {
          throw ProblemError(
              location_,
              fmt::format("from: {}:{}: {} = {} is not one of the {} nodes from {} on, {} apart, before {}", file_,
                          table_.lines[row], axis.name, x, axis.cells, axis.from, axis.spacing(), axis.to));
        }
        node_[row] += static_cast<std::size_t>(nearest) * grid_->stride(a);
      }
      if (taken[node_[row]]) {
        throw ProblemError(location_, fmt::format("from: {}:{}: this place is there twice", file_, table_.lines[row]));
      }
      taken[node_[row]] = true;
    }
  }

  const InitialTable& table_;
  const std::string& file_;
  const Location& location_;
  std::optional<grids::Grid> grid_;
  std::vector<std::size_t> node_;
};

}  // namespace

bool is_table(std::string_view file) {
  return file.ends_with(".csv") || file.ends_with(".CSV");
}

InitialTable read_table(const std::string& file, const Location& location) {
  return TableReader(file, location).read();
}

FieldOnGrid field_of_table(const InitialTable& table, const std::string& file, const std::string& name,
                           const grids::Grid& grid, const Location& location) {
  const std::vector<double>* values = column_of(table, name);
  if (values == nullptr) {
    throw ProblemError(location,
                       fmt::format("from: {} has no column {}; it has {}", file, name, fmt::join(table.names, ", ")));
  }
  const auto is_there = [&](const grids::Axis& axis) { return column_of(table, axis.name) != nullptr; };
  if (std::ranges::none_of(grid.axes(), is_there)) {
    if (values->size() != grid.size()) {
      throw ProblemError(
          location, fmt::format("from: {} has {} rows, and the grid {} nodes; give columns of places, {}, too", file,
                                values->size(), grid.size(), grid.axes().front().name));
    }
    return {*values, grid};
  }
  const Nodes nodes(table, file, grid, location);
  return {nodes.in_order(*values), nodes.grid()};
}

}  // namespace rubato
