#pragma once

#include <array>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/variation/lattice_action.hpp>
#include <rubato/variation/node_code.hpp>
#include <rubato/variation/node_variation.hpp>

namespace rubato {

/// The variation of an action in the place of its nodes (theory, section 5, "Local laws"), from slab to slab: what
/// LatticeVariation::coordinates() says of one, for the level between two of them, by two formulas of a node and its
/// neighbours. The first has the currents J^ν_ρ of a cell, the second what nodes get of those:
///
///     ∂𝕊/∂x^ν(node) = -Σ_ρ D_ρᵀ h ΔV J^ν_ρ + Σ_j (L_j)ᵀ h ΔV ∂L/∂(L_j x^ν),   the sum over both slabs,
///
/// j the places that the action names. For stencils of box operators.
class CoordinateVariation {
public:
  /// \throws std::invalid_argument if the dimensions of action and grid differ, or the stencil has a spectral
  /// derivative
  CoordinateVariation(LatticeAction action, const grids::Grid& grid);

  [[nodiscard]] const LatticeAction& action() const { return variation_.action(); }
  /// Takes the next slab, from `before` to `after`, h apart. \param follows `before` is the level that was `after`
  void take(const grids::FieldSet& before, const grids::FieldSet& after, double h, const PotentialSlopes& slopes,
            bool follows);
  /// ∂𝕊/∂x^ν at the nodes between the slab taken last and the one before it, row ν, 0 for time.
  void between(grids::FieldSet& out);

private:
  struct Slab {
    grids::FieldSet in_cells;  ///< of each row
    double h = 0.0;
  };
  /// What of a cell goes to its nodes, with which weights, in time as an operator does, for which ν.
  struct Row {
    int nu = 0;
    InTime time = InTime::mean;
    NodeFormulas::Weights weights;

    bool operator==(const Row&) const = default;
  };

  void find_rows();
  void find_balance();

  NodeVariation variation_;
  grids::Grid grid_;
  std::vector<Row> rows_;
  LevelValues levels_;
  NodeCode in_cells_, between_;
  Slab last_, earlier_;
};

}  // namespace rubato
