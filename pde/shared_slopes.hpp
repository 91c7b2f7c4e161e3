#pragma once

#include <cstddef>

#include <rubato/base/state.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/variation/potential_slopes.hpp>

/// Slopes of potentials where ranks share a lattice (grids/slab.hpp): each has those of the lines of its part, ghosts
/// and all. `grid` is the part, or the whole where there is one process. All ranks have to call the same.
namespace rubato {

/// Those of this rank's part. Hypothesis: `whole` has those of all lines.
[[nodiscard]] PotentialSlopes part_of(const PotentialSlopes& whole, const grids::Slab& slab);
/// Renews those of ghosts; nothing for a thread without a slab.
void refresh_slopes(PotentialSlopes& slopes, const grids::Grid& grid);
/// True if a line of the whole lattice has one that is not 0, of a field or of any.
///@{
[[nodiscard]] bool has_slope(const PotentialSlopes& slopes, std::size_t field, const grids::Grid& grid);
[[nodiscard]] bool has_slope(const PotentialSlopes& slopes, const grids::Grid& grid);
/// max |slope| of a field over all lines, 0 without any. Collective.
[[nodiscard]] double largest_slope(const PotentialSlopes& slopes, std::size_t field, const grids::Grid& grid);
///@}
/// As grids::save_whole() and grids::restore_whole() do with fields: in a record those of all lines.
///@{
void save_slopes(StateWriter& state, const PotentialSlopes& slopes, const grids::Grid& grid);
void restore_slopes(StateReader& state, PotentialSlopes& slopes, const grids::Grid& grid);
///@}

}  // namespace rubato
