#pragma once

#include <functional>
#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/variation/node_pass.hpp>

namespace rubato {

/// 𝓔 = Σ ΔV [S + Σ_a (δ_a⁻z)ᵀK₊z] of a level with its equation at corners (Collocation::corners), what CellSweep says,
/// by one formula of a node and the one before it along each axis. Fields that levels do not have are zero.
class CornerEnergy {
public:
  CornerEnergy(const MultisymplecticSystem& system, const grids::Grid& grid);

  /// S + Σ_a (δ_a⁻z)ᵀK₊z by formulas of what the system's variables are, and δ_a⁻ of fields with the slope of a
  /// potential: difference(f, a). Empty if one of these is (there is none).
  using Variables = std::span<const formula::Expression>;
  using Difference = std::function<formula::Expression(int field, int axis)>;
  [[nodiscard]] static formula::Expression density(const MultisymplecticSystem& system, Variables z,
                                                   const Difference& difference);

  [[nodiscard]] double operator()(const grids::FieldSet& fields, const PotentialSlopes& slopes);

private:
  double volume_;  ///< of a cell
  grids::FieldSet coordinates_;
  NodePass pass_;
};

}  // namespace rubato
