#pragma once

#include <optional>
#include <string>
#include <vector>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/mirror_signs.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// Levels with their fields at the nodes. One-sided differences along an axis leave algebraic fields half a cell off,
/// w_i = (u_{i+1} - u_i)/Δx; at a node such a field is the mean of both sides, which is of order 2 in Δx. Fields whose
/// row of the equation names other algebraic fields, or differences along several axes, stay as they are.
class NodalView {
public:
  /// \param collocation of the scheme: with corners there are such fields
  NodalView(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation);

  /// True if any of these fields is between nodes.
  [[nodiscard]] bool moves(const std::vector<int>& fields) const;
  /// Valid until the next call; `level` itself where nothing is between nodes. On the part of a slab collective.
  [[nodiscard]] const LatticeLevel& operator()(const LatticeLevel& level);

private:
  /// A field between nodes.
  struct Moved {
    int field = 0, axis = 0;
    bool forward = true;  ///< half a cell after its node along the axis; else before it
  };
  void average(const Moved& moved);

  grids::Grid grid_;
  std::optional<FieldMirrors> mirrors_;  ///< where a field is moved
  std::vector<Moved> moved_;
  std::vector<int> fields_;  ///< of moved_
  std::optional<LatticeLevel> at_nodes_;
  std::vector<double> line_;
};

}  // namespace rubato
