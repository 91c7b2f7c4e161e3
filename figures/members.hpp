#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/figures/text.hpp>

/// The figures of an ensemble: how each is distributed over the members, as the table and the page show it.
namespace rubato::figures {

/// Of the values that are finite; quartiles lie between neighbours in proportion. Not numbers where there is none.
struct Distribution {
  double min = std::numeric_limits<double>::quiet_NaN();
  double lower = min, median = min, upper = min;  ///< quartiles
  double max = min, mean = min;
  std::size_t defined = 0, undefined = 0;
  std::size_t worst = 0;  ///< the number of the first member with the largest value

  [[nodiscard]] bool any() const { return defined > 0; }
};
[[nodiscard]] Distribution distribution_of(std::span<const double> values);

/// What the table calls a figure of a run, by its keys in JSON ("discrete_energy/max_deviation"); empty for those that
/// it leaves to JSON.
[[nodiscard]] std::string label_of_figure(const std::string& name);

/// Its place in the table: the less, the earlier.
[[nodiscard]] std::size_t rank_of_figure(const std::string& name);

/// A line of the table of an ensemble.
[[nodiscard]] Line line_of(const std::string& label, const Distribution& distribution);

}  // namespace rubato::figures
