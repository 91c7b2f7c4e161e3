#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/mirror_signs.hpp>

namespace rubato {

/// The ghosts of a grid with walls in it (grids::Axis::ghosts): with r_f the sign of a field in the mirror of a wall at
/// x = 0 (theory, section 12),
///
///     z_f(-x) = z_f(x) where r_f = 1,    z_f(-x) = 2 z_f(0) - z_f(x) where r_f = -1,
///
/// and -z_f(x) of fields between nodes, which have no value on the wall. Of a rank's part all nodes beyond a wall are
/// such ghosts. Hypothesis: it has as many within.
class WallGhosts {
public:
  WallGhosts(const FieldMirrors& mirrors, const grids::Grid& grid);

  /// Makes the ghosts of a field, or of some, from the nodes between the walls.
  ///@{
  void renew(int field, std::span<double> values) const;
  void renew(std::span<const int> which, grids::FieldSet& fields) const {
    for (const int f : which) {
      renew(f, fields.field(f));
    }
  }
  ///@}
  /// The ghosts and the nodes on walls, which read them, as ranges of nodes that follow each other.
  [[nodiscard]] std::span<const grids::NodeRange> ranges() const { return ranges_; }

private:
  FieldMirrors mirrors_;
  grids::Grid grid_;
  std::vector<grids::NodeRange> ranges_;
};

}  // namespace rubato
