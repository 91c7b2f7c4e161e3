#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/lines.hpp>

/// What is asked of a lattice once, when a run begins: of the whole, whether this thread has all of it or a slab
/// (grids/slab.hpp). All ranks have to ask the same; they get the same answers but where it says otherwise. Nodes go by
/// their numbers in the whole lattice.
namespace rubato::grids {

/// The grid that a grid is a part of.
[[nodiscard]] const Grid& whole_of(const Grid& grid);
/// True if all ranks say so.
[[nodiscard]] bool agreed_by_all(const Grid& grid, bool said);
/// What rank 0 says.
[[nodiscard]] bool agreed(const Grid& grid, bool said);
/// The fields at one node.
[[nodiscard]] std::vector<double> values_at(const FieldSet& fields, std::size_t node);
/// The first node of the least value, and the last one of the greatest. Hypothesis: values are numbers.
[[nodiscard]] std::pair<std::size_t, std::size_t> extreme_nodes(std::span<const double> values);
/// The first node whose value is not finite, and the value.
[[nodiscard]] std::optional<std::pair<std::size_t, double>> first_undefined(std::span<const double> values);
/// Calls use(array, line, first) for every line along an axis, in the order of lines_along(): a line of an array, and
/// its first node. Of a slab at rank 0 alone, which gets some of the lines at a time.
void for_each_line(const Grid& grid, int axis, std::span<const double> values,
                   const std::function<void(const double*, const Line&, std::size_t)>& use);

}  // namespace rubato::grids
