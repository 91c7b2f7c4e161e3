#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/record/reader.hpp>
#include <rubato/report/budget.hpp>
#include <rubato/report/packing.hpp>
#include <rubato/report/thinning.hpp>

/// What the maps of a line and the films of planes and volumes have in common. Not part of the library's interface.
namespace rubato::report {

/// What is drawn of one grid function over all stored levels.
struct Drawing {
  std::string name;
  std::string group;                 ///< "field", "quantity", "error", "exact", "residual"
  bool logarithmic = false;          ///< log10 of its magnitude
  bool starts_late = false;          ///< no value before the first step: not to be counted as undefined
  bool has_gaps = false;             ///< no value at some levels, likewise
  std::optional<double> rounding{};  ///< size of what rounding alone leaves of it
  bool is_first = false;             ///< of the field that comes first: drawn in full where the page has room
};

/// How many values there are, and how many of them are none.
struct Census {
  std::size_t values = 0, undefined = 0;
  void add(std::span<const double> more);
};

/// "name", "group", "count", "undefined", "starts_late", "has_gaps", "rounding" of a drawing.
void write_drawing(Json& json, const Drawing& drawing, const Census& census);

/// True if these are the values of a level at which `drawing` has none yet, or none at all.
[[nodiscard]] bool is_before_start(const Drawing& drawing, std::size_t level, std::span<const double> values);

/// How many arrays the maps of a lattice need, and what surrounds them.
struct MapCounts {
  explicit MapCounts(const Contents& contents);
  std::size_t fields, exact, residuals;
  std::size_t frames;  ///< bytes
};

struct Extremes {
  double low = std::numeric_limits<double>::infinity(), high = -std::numeric_limits<double>::infinity();
  void add(std::span<const double> values) {
    for (const double value : values) {
      low = value < low ? value : low;
      high = value > high ? value : high;
    }
  }
  [[nodiscard]] bool is_empty() const { return low > high; }
};

/// Writes of each block the value that a picture must not lose: of a field with both signs, and of errors, the one
/// farthest from zero, of a field with a single sign the one farthest from its mean, of logarithms the largest. Keys
/// "logarithmic", "centre" (absent for logarithms) and "values".
void write_blocks(Json& json, const Drawing& drawing, std::vector<double> low, std::vector<double> high);

/// "x": {"name", "first", "last", "count", "parts"} of an axis of the grid that is divided so.
void write_axis(Json& json, std::string_view key, const record::Reader& reader, const std::string& dimension,
                const Partition& partition);

/// The middles of cells lie along the same axis as the nodes: "x_cell" is shown as "x".
[[nodiscard]] std::string_view display_name(std::string_view dimension);

}  // namespace rubato::report
