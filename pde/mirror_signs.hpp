#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/node_code.hpp>

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

/// The mirrors of a grid with walls, for all fields and axes.
class FieldMirrors {
public:
  /// \param collocation of the scheme: with corners fields that follow by differences live between nodes
  /// \throws SchemeRefusal as MirrorSigns
  FieldMirrors(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation);

  /// +1, or -1 where the wall holds the field at its value there. Hypothesis: the axis has walls
  [[nodiscard]] int sign(int axis, int field, grids::End wall) const {
    return signs_[static_cast<std::size_t>(axis)]->at(field, wall);
  }
  /// The fields and nodes that walls hold. \param grid between walls, or with ghosts of them
  [[nodiscard]] std::vector<std::pair<int, std::size_t>> held(const grids::Grid& grid) const;
  /// Numbers along the axes of a grid with ghosts of walls, whose product is 0 at nodes on walls that hold a field and
  /// 1 at others; none where no wall holds it.
  [[nodiscard]] std::vector<PlaceNumbers> loose(const grids::Grid& grid, int field) const;
  /// 1 for fields half a cell after their node along the axis, -1 before it, 0 at it.
  [[nodiscard]] int offset(int axis, int field) const {
    return offsets_[static_cast<std::size_t>(axis)][static_cast<std::size_t>(field)];
  }

private:
  std::vector<std::optional<MirrorSigns>> signs_;  ///< of each axis; none where it is periodic
  std::vector<std::vector<int>> offsets_;          ///< [axis][field]
};

}  // namespace rubato
