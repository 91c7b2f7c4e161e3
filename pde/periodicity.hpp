#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include <rubato/grids/grid.hpp>

namespace rubato {

/// Where and how node values do not go on across the periodic seam of an axis.
struct SeamBreak {
  int axis = 0;
  std::size_t node = 0;  ///< the first node of the line along that axis that shows it most
  bool jump = true;      ///< of the value; else of the slope
  double across = 0.0;   ///< first value less last one and less what their neighbours lead on to; change of slope
  double inside = 0.0;   ///< the largest of the same between neighbours inside
};

/// Looks for the axis across whose seam node values are broken most, if they are.
///
/// With D⁴ the fourth differences along a line, a node stands out by |D⁴_i| - 10 max |D⁴_j|, the maximum over the nodes
/// at a distance of 4 to 10 cells. Smooth data that repeat stand out nowhere, nor do random ones, whose neighbours are
/// as rough; a jump J gives 3 J at the seam and a jump J' of the slope 2 Δx J'. The seam is broken if a node next to it
/// stands out, 4.5 times as much as any inside (data may have fronts and cusps there, too), and by more than a
/// fiftieth of the largest second difference: less is lost in the truncation error. Lines shorter than 20 cells say
/// too little. Where this thread has a slab (grids/whole.hpp) rank 0 gets what is found, others nothing.
[[nodiscard]] std::optional<SeamBreak> find_seam_break(const grids::Grid& grid, std::span<const double> values);

using UseOfLine = std::function<void(std::span<const double> line, std::size_t first)>;
/// The same of values that are read line by line. \param largest of their magnitudes
/// \param for_each_line calls use(line, its first node) for each line along an axis
[[nodiscard]] std::optional<SeamBreak> find_seam_break(
    const grids::Grid& grid, double largest, const std::function<void(int axis, const UseOfLine& use)>& for_each_line);

/// The same in words: "across the seam, where …, `what` jumps by …".
[[nodiscard]] std::string describe_break(const SeamBreak& broken, const grids::Grid& grid, const std::string& what);
/// Of initial data, as a sentence for people with the remedy.
[[nodiscard]] std::string describe(const SeamBreak& broken, const grids::Grid& grid, const std::string& field);

}  // namespace rubato
