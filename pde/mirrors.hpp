#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// The signs R = diag(±1) of the fields in a mirror normal to one axis (theory, section 12): RMR = M, RK_aR = -K_a and
/// RK_bR = K_b for the other axes, so that R z(-x) solves the equation with z(x) where S(Rz) = S(z).
struct MirrorSigns {
  std::vector<int> of_field;  ///< in a free wall; of fields that `couples`, the opposite in a fixed one
  std::vector<bool> couples;  ///< fields that K_a joins with others, through any of them

  /// \throws SchemeRefusal, naming the fields, if no signs fit M and K
  MirrorSigns(const MultisymplecticSystem& system, int axis, const std::string& name);
  [[nodiscard]] int at(int field, grids::End wall) const {
    const auto f = static_cast<std::size_t>(field);
    return wall == grids::End::fixed && couples[f] ? -of_field[f] : of_field[f];
  }
};

/// The space between walls as a part of a ring on which z goes on in mirrors: about a node 0 of a wall
///
///     z_f(-x) = r_f z_f(x) where r_f = 1,    z_f(-x) = 2 z_f(0) - z_f(x) where r_f = -1.
///
/// Two walls with the same signs make a ring of twice the length, others of four times. A solution on the ring that
/// begins so stays so if the scheme is the same in the mirror, and is the solution between the walls.
class Mirrors {
public:
  /// \param collocation of the scheme: with corners fields that follow by differences live between nodes
  /// \throws SchemeRefusal as MirrorSigns
  Mirrors(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation);

  [[nodiscard]] const grids::Grid& grid() const { return grid_; }
  [[nodiscard]] const grids::Grid& ring() const { return ring_; }
  /// How often the space between the walls is in the ring.
  [[nodiscard]] double copies() const { return copies_; }
  /// +1, or -1 where the wall holds the field at its value there.
  [[nodiscard]] int sign(int axis, int field, grids::End wall) const {
    return signs_[static_cast<std::size_t>(axis)]->at(field, wall);
  }
  /// True if the field has values on the walls of the axis.
  [[nodiscard]] bool is_at_nodes(int axis, int field) const { return offset(axis, field) == 0; }

  void extend(int field, std::span<const double> between, std::span<double> ring) const;
  void extend(const grids::FieldSet& between, grids::FieldSet& ring) const;
  [[nodiscard]] LatticeLevel extended(const LatticeLevel& between) const;
  void restrict(std::span<const double> ring, std::span<double> between) const;
  void restrict(const grids::FieldSet& ring, grids::FieldSet& between) const;
  /// The same but for the values that walls hold, which stay as they are.
  void restrict_within(const grids::FieldSet& ring, grids::FieldSet& between) const;

private:
  [[nodiscard]] int offset(int axis, int field) const {
    return offsets_[static_cast<std::size_t>(axis)][static_cast<std::size_t>(field)];
  }
  void extend_blocks(int axis, int field, std::size_t block, std::span<double> values) const;

  grids::Grid grid_, ring_;
  std::vector<std::optional<MirrorSigns>> signs_;  ///< of each axis; none where it is periodic
  /// 1 for fields half a cell after their node along the axis, -1 before it, 0 at it.
  std::vector<std::vector<int>> offsets_;
  double copies_ = 1.0;
  std::vector<std::pair<int, std::size_t>> held_;  ///< fields and nodes
};

/// A term of S that is not the same at z and in the mirror.
struct ChangedTerm {
  std::string term;
  double before = 0.0, after = 0.0;
};
/// Looks at random z for a term that z_f -> 2 c_f - z_f changes, for the fields f whose sign is -1; nothing where S is
/// the same.
[[nodiscard]] std::optional<ChangedTerm> find_changed_term(const MultisymplecticSystem& system,
                                                           std::span<const int> signs, std::span<const double> centre);

}  // namespace rubato
