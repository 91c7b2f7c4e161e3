#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>

namespace rubato {

/// Bounds of the rounding errors of formulas over all nodes.
class LargestRounding {
public:
  LargestRounding() = default;
  explicit LargestRounding(const formula::Bytecode& code)
      : evaluator_(code), point_(code.input_count()), error_(point_) {}

  /// Raises largest[i] to the largest bound of output i over ½ε (formula::RoundingEvaluator), of inputs rounded twice.
  /// Collective.
  void operator()(std::size_t nodes, std::span<const double* const> inputs, std::span<double> largest);

private:
  formula::RoundingEvaluator evaluator_;
  std::vector<double> point_, error_;
};

/// Bounds of the rounding errors, over ε, of the rows R = M δ/h + Σ K_a D_a z - ∇S(z) that a linear solver has
/// corrected.
///
/// The terms of a row at the solution are no such bound. They vanish in a step from z to -z and where a field is 0,
/// while values of normal size are rounded on the way, and elimination mixes the rows. The bound of row i is
///
///     b_i = t_i + Σ_j A_ij X_j,   t_i = g_i + Σ_j (|M_ij| |δ_j|/h + B_ij |z_j|),   X_j = max_k t_k/A_kj
///
/// with g_i what the evaluation of ∂S/∂z_i rounds at beyond that (0 unless it was measured), B = Σ |K_a| 2/Δx_a +
/// |S''|, A = 2|M|/h + B, and the largest values over the grid. X_j is the largest change of field j that rounding of
/// any row may cause, over ε. Elimination mixes rows of fields that do not act on each other, too: where X_j is next to
/// nothing beside D_j max_k X_k/D_k, with the natural sizes D by A (natural_sizes.hpp), it is that. Other units change
/// b_i as they change R_i.
class RowRounding {
public:
  RowRounding(const MultisymplecticSystem& system, const grids::Grid& grid);

  /// One number for each field, or for each row.
  using Sizes = std::array<double, MultisymplecticSystem::most_fields>;
  /// max |z| of the values that a point is computed from, of the slopes that are added to D_x z, max |δ|, and g.
  struct Values {
    Sizes point{}, slope{}, increment{}, gradient{};
  };
  /// Measures g at node values: an evaluation at every node, several times as expensive as that of ∇S. Collective.
  void measure_gradient(const grids::FieldSet& point, Values& values);

  /// The b_i. `hessian` holds the varying entries of S''; `inverse_h` is 0 for the constraints of a level.
  [[nodiscard]] Sizes operator()(const Values& values, double inverse_h, const grids::FieldSet& hessian) const;
  /// Those of the constraints of a level, with g measured there. Collective.
  [[nodiscard]] Sizes of_constraints(const LatticeLevel& level, const grids::Grid& grid,
                                     const grids::FieldSet& hessian);

private:
  std::size_t fields_;
  Eigen::MatrixXd M_, along_, constant_;  ///< |M|, |K_x|, and the constants of B
  std::vector<HessianEntry> varying_;
  LargestRounding gradient_;
  PlacedCoordinates places_;
  std::vector<const double*> inputs_;
};

}  // namespace rubato
