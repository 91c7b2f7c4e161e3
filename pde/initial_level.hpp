#pragma once

#include <optional>
#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// One level of a lattice: a value of each field at each node (of a field that exists at midpoints only, that of the
/// step that led here; 0 at the start), and the slopes of potentials, which no step changes.
struct LatticeLevel {
  grids::FieldSet fields;
  PotentialSlopes slopes;
};

/// What the user gives at the start: per field one value for each node, or nothing.
using InitialFields = std::vector<std::optional<std::vector<double>>>;

/// The first level from the user's data: fields that the constraints of a level determine are computed from the others
/// by the *discrete* constraints nᵀ(Σ K_a D_a z - ∇S(A z)) = 0 of the placement (theory, section 5, "Algebraic
/// fields"), whatever the user wrote for them; a potential φ with φ_x = u is split into m·x + periodic part, so that u
/// is used as given, whatever its mean, and the periodic part has mean 0.
///
/// \throws std::invalid_argument if a size does not fit, a value is not finite, a field is missing that nothing
/// determines, or data given for a field that is computed differ from it by more than truncation error explains (half
/// the largest second differences of the data along the axes, for Placement::corners three quarters of the first ones)
[[nodiscard]] LatticeLevel initial_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given, Placement placement = Placement::cells);

}  // namespace rubato
