#include <rubato/problem/initial_arrays.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/record/arrays.hpp>

namespace rubato {

namespace {

/// A node is where it is to so much of a spacing: coordinates may be of single precision.
constexpr double misplaced_node = 1e-3;

record::ArrayFile open(const std::string& from) {
  const ArraySource source = read_array_source(from);
  return record::ArrayFile(source.file, source.group);
}

[[noreturn]] void refuse_array(const Location& location, const std::string& from, const std::string& what) {
  throw ProblemError(location, fmt::format("from: {}: {}", from, what));
}

/// The number of the level that is nearest to `at`.
std::optional<std::size_t> level_number(const record::ArrayFile& file, const std::optional<double>& at,
                                        const std::string& from, const Location& location) {
  if (!file.has("t")) {
    return std::nullopt;
  }
  const std::vector<double> t = file.read("t").values;
  if (t.empty() || !all_finite(t)) {
    refuse_array(location, from, "t has no times, or one that is not finite");
  }
  if (!at) {
    return t.size() - 1;
  }
  const auto [least, most] = std::ranges::minmax(t);
  if (const double slack = 1e-9 * (most - least); *at < least - slack || *at > most + slack) {
    throw ProblemError(
        location, fmt::format("at = {} is outside of {}, whose t goes from {} to {}", *at, from, t.front(), t.back()));
  }
  return static_cast<std::size_t>(std::ranges::min_element(t, {}, [&](double time) { return std::abs(time - *at); }) -
                                  t.begin());
}

/// The dataset, or its part at the level, if it has levels: if it has `rank` indices more than one, or is given by t.
record::Array read_level(const record::ArrayFile& file, const std::string& name, std::size_t rank,
                         const std::optional<double>& at, const std::string& from, const Location& location) {
  if (!file.has(name)) {
    refuse_array(location, from, fmt::format("has no dataset {}; it has {}", name, fmt::join(file.names(), ", ")));
  }
  const std::vector<std::size_t> shape = file.shape(name);
  if (shape.size() != rank + 1) {
    return file.read(name);
  }
  const auto level = level_number(file, at, from, location);
  if (!level) {
    return file.read(name);
  }
  const std::size_t levels = file.shape("t").empty() ? 1 : file.shape("t").front();
  if (shape.front() != levels) {
    refuse_array(location, from, fmt::format("{} has {} levels, and t {}", name, shape.front(), levels));
  }
  return file.read(name, *level);
}

void check_nodes(const record::ArrayFile& file, const grids::Axis& axis, const std::string& from,
                 const Location& location) {
  if (!file.has(axis.name)) {
    return;
  }
  const std::vector<double> x = file.read(axis.name).values;
  if (x.size() != axis.cells) {
    refuse_array(location, from, fmt::format("{} has {} places, and the fields {}", axis.name, x.size(), axis.cells));
  }
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!(std::abs(x[i] - axis.node(i)) <= misplaced_node * axis.spacing())) {
      refuse_array(location, from,
                   fmt::format("{}[{}] = {}, and node {} of {} from {} on, {} apart, before {} is at {}", axis.name, i,
                               x[i], i, axis.cells, axis.from, axis.spacing(), axis.to, axis.node(i)));
    }
  }
}

void check_finite(const record::Array& array, const std::string& name, const std::string& from,
                  const Location& location) {
  if (!all_finite(array.values)) {
    refuse_array(location, from, fmt::format("{} has a value that is not finite", name));
  }
}

}  // namespace

ArraySource read_array_source(const std::string& from) {
  const std::size_t colon = from.rfind(":/");
  if (colon == std::string::npos || std::filesystem::exists(from)) {
    return {.file = from};
  }
  return {.file = from.substr(0, colon), .group = from.substr(colon + 1)};
}

bool is_array_source(const std::string& from) {
  return !record::is_record(read_array_source(from).file);
}

std::optional<double> level_of_arrays(const std::string& from, const std::optional<double>& at,
                                      const Location& location) {
  const record::ArrayFile file = open(from);
  const auto level = level_number(file, at, from, location);
  return level ? std::optional(file.read("t").values[*level]) : std::nullopt;
}

std::vector<std::string> names_in_arrays(const std::string& from, std::span<const std::string> names) {
  const record::ArrayFile file = open(from);
  std::vector<std::string> found;
  std::ranges::copy_if(names, std::back_inserter(found), [&](const std::string& name) { return file.has(name); });
  return found;
}

std::string list_of_arrays(const std::string& from) {
  const std::vector<std::string> names = open(from).names();
  return names.empty() ? "nothing" : fmt::format("{}", fmt::join(names, ", "));
}

std::vector<double> numbers_of_array(const std::string& from, const std::string& name, std::size_t count,
                                     const std::optional<double>& at, const Location& location) {
  const record::ArrayFile file = open(from);
  const record::Array array = read_level(file, name, count > 1 ? 1 : 0, at, from, location);
  if (array.values.size() != count) {
    refuse_array(location, from, fmt::format("{} has {} numbers, and is to have {}", name, array.values.size(), count));
  }
  check_finite(array, name, from, location);
  return array.values;
}

FieldOnGrid field_of_arrays(const std::string& from, const std::string& name, double at, const grids::Grid& grid,
                            const Location& location) {
  const record::ArrayFile file = open(from);
  const auto dimensions = static_cast<std::size_t>(grid.dimensions());
  const record::Array array = read_level(file, name, dimensions, at, from, location);
  if (array.shape.size() != dimensions) {
    refuse_array(location, from,
                 fmt::format("{} has {} indices, and a field on this grid {}: [z][y][x], with a level in front where "
                             "there is a dataset t",
                             name, array.shape.size(), dimensions));
  }
  check_finite(array, name, from, location);
  std::vector<grids::Axis> axes;
  for (std::size_t a = 0; a < dimensions; ++a) {
    const grids::Axis& axis = grid.axis(static_cast<int>(a));
    const std::size_t cells = array.shape[dimensions - 1 - a];  // x is the last index
    if (cells < 3) {
      refuse_array(location, from,
                   fmt::format("{} has {} nodes along {}; a grid has at least 3", name, cells, axis.name));
    }
    axes.push_back(axis);
    axes.back().cells = cells;
    check_nodes(file, axes.back(), from, location);
  }
  return {array.values, grids::Grid(axes)};
}

}  // namespace rubato
