#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <rubato/base/status.hpp>
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

/// Initial data of a field that contradict the constraint which determines it.
class InitialFieldError : public std::invalid_argument {
public:
  InitialFieldError(int field, const std::string& message) : std::invalid_argument(message), field_(field) {}
  [[nodiscard]] int field() const { return field_; }

private:
  int field_;
};

/// The first level, and what the user should know about the data it was made of: sentences with the remedy.
struct InitialLevel {
  LatticeLevel level;
  std::vector<std::string> cautions;
};

/// The first level from the user's data: fields that the constraints of a level determine are computed from the others
/// by the *discrete* constraints nᵀ(Σ K_a D_a z - ∇S(A z)) = 0 of the collocation (theory, section 5, "Algebraic
/// fields"), whatever the user wrote for them; a potential φ with φ_x = u is split into m·x + periodic part, so that u
/// is used as given, whatever its mean, and the periodic part has mean 0. With Collocation::nodes and an even number of
/// cells u loses its Nyquist mode, which φ_x cannot have.
///
/// Cautions: data that do not repeat with the period of the grid (find_seam_break), a Nyquist mode that was more than
/// truncation error, data given for a field that exists at midpoints only.
///
/// \throws std::invalid_argument if a size does not fit, a value is not finite, or a field is missing that nothing
/// determines; InitialFieldError if data given for a field that is computed differ from it by more than truncation
/// error explains (check_agreement), or break a condition on means along x (MeanConditions)
[[nodiscard]] InitialLevel prepare_initial_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                 const InitialFields& given,
                                                 Collocation collocation = Collocation::cells);

/// True of a potential that the constraints of a level determine, with its mean slope, from fields with an equation of
/// motion: φ of φ_x = u. False of one that has an equation of motion alone, as u of u_tt = u_xx.
[[nodiscard]] bool follows_from_others(const MultisymplecticSystem& system, int field);

/// True if no field is missing, none given that prepare_initial_level() computes and compares with what is given, and
/// no mean along x has to be looked at: then ranks that share a lattice (of more than one dimension, without
/// Collocation::corners) may each call that with what is given in their parts.
[[nodiscard]] bool determines_no_given_field(const MultisymplecticSystem& system, const std::vector<bool>& given);

/// As prepare_initial_level() where constraints determine the algebraic fields, none of which is given, from all
/// others: `determine` sets them, at each of the ranks that share a lattice in its part. \throws std::invalid_argument
/// if another field is missing
[[nodiscard]] InitialLevel prepare_determined_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                    const InitialFields& given,
                                                    const std::function<void(LatticeLevel&)>& determine);

/// The fields of levels that have no equation of motion, as the constraints give them from the others; once made it
/// allocates nothing.
class ConstrainedFields {
public:
  ConstrainedFields() = default;
  ConstrainedFields(const ConstrainedFields&) = delete;
  ConstrainedFields& operator=(const ConstrainedFields&) = delete;
  virtual ~ConstrainedFields() = default;
  /// Puts them into a level, whose own are where an iteration begins. Fields at midpoints are 0 there.
  [[nodiscard]] virtual Status find(LatticeLevel& level) = 0;
};
/// Those of prepare_initial_level() where all fields with an equation of motion are given, and no others.
/// \throws std::invalid_argument if constraints give one of them
[[nodiscard]] std::unique_ptr<ConstrainedFields> make_constrained_fields(const MultisymplecticSystem& system,
                                                                         const grids::Grid& grid,
                                                                         Collocation collocation);

/// Its level alone.
[[nodiscard]] LatticeLevel initial_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given, Collocation collocation = Collocation::cells);

}  // namespace rubato
