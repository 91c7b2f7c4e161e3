#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/wall_drives.hpp>

namespace rubato {

/// What closes the box scheme on a line between walls (theory, section 12). N cells have N rows of each of d fields for
/// N + 1 values. With K₊ as in the energy, varying the values at the ends as well leaves [δzᵀK₊z̄] of the action, which
/// vanishes where a wall holds z_f or its partner in K: rank K conditions at both ends together. A field in ker K has
/// its own row at one end, M D_t z - ∇S(z) there. These d rows take the place of those of the cell that would join the
/// last node and the first one on a ring, so that elimination stays cyclic.
///
/// For u_tt = u_xx the homogeneous step, (4/h²) A u = D w and D u = A w with A the mean and D the difference of
/// neighbours, has Σ (4/h²)(A u)² + (A w)² = [u w̄]/Δx = 0: it has the solution 0 alone, for any number of cells and any
/// two walls, since a sawtooth that A does not see is seen by D or held. So the rows are those of a well-posed scheme.
/// Where a held field is not 0, or a wall drives it, nothing changes but the right-hand side.
///
/// The energy of the cells changes by [z_tᵀK₊z] at the ends, which is 0 but for the work of walls that drive z.
class WallConditions {
public:
  using Held = std::pair<int, std::size_t>;  ///< field and node

  /// \throws SchemeRefusal unless the grid is a line, and there are as many conditions as the fields in K have; as
  /// DrivenNodes
  WallConditions(const MultisymplecticSystem& system, const grids::Grid& grid,
                 const std::shared_ptr<const WallDrives>& drives = nullptr);

  /// The fields in K and the nodes where walls hold them.
  [[nodiscard]] const std::vector<Held>& held() const { return held_; }
  [[nodiscard]] bool drives() const { return driven_.has_value(); }
  [[nodiscard]] bool drives(int field, std::size_t node) const {
    return driven_ && std::ranges::any_of(driven_->nodes(), [&](const DrivenNodes::Node& at) {
             return at.u == field && at.node == node;
           });
  }
  /// t_0 of a drive.
  [[nodiscard]] double start() const { return driven_->start(); }

  /// Sets the changes of held values to 0.
  void hold(grids::FieldSet& change) const {
    for (const auto& [field, node] : held_) {
      change.field(field)[node] = 0.0;
    }
  }
  /// The same, but to what walls change a level's fields by that lead to time t. \param high + low the level
  void hold(const grids::FieldSet& high, const grids::FieldSet& low, double t, grids::FieldSet& delta);
  /// What driven walls do in a step with these changes, the others' fields in the middle of it as in `point`.
  [[nodiscard]] double work(const grids::FieldSet& point, const grids::FieldSet& delta) const;
  /// The last rows of the step's matrix for the free fields, with the constant part in matrix.mean, and those of
  /// `residual` at the middle of the step: 0 for what is held, -R at the left end for others.
  void close(const std::vector<int>& free, const grids::FieldSet& point, const grids::FieldSet& delta, double inverse_h,
             CellMatrix& matrix, grids::FieldSet& residual);

private:
  MultisymplecticSystem system_;
  std::vector<Held> held_;
  std::optional<DrivenNodes> driven_;
  std::vector<double> place_;  ///< the coordinates of S at the left end
  formula::ScalarEvaluator evaluate_;
  std::vector<double> inputs_, outputs_;
};

/// Takes from each field with an equation of motion that is even about both walls its sawtooth (-1)^i, as far as
/// Σ_c (-1)^c (D z)_c = 0 asks for it: what A makes of a field that both walls hold has no part in the kernel of Aᵀ.
/// Of smooth data this is of fourth order in the spacing.
void remove_wall_sawtooths(const MultisymplecticSystem& system, const grids::Grid& grid, grids::FieldSet& fields);

/// Takes the sawtooth from values on a line such that their third differences are as small as they can be: the
/// constraints of a level leave it open in fields that no wall holds. Of smooth values it leaves O(Δx⁴).
void smooth_sawtooth(std::span<double> values);

}  // namespace rubato
