#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/rounding.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// Natural sizes of fields that an equation couples by the weights W_fg = W_gf >= 0: D_f with max_g W_fg D_f D_g = 1
/// for each field that is coupled at all. z_f/D_f of all fields are comparable: other units of a field change its D_f
/// as they change z_f. Of several such D it is the one reached by equilibration (Ruiz, report RAL-TR-2001-034) from
/// that of least squares of the logarithms (Curtis and Reid, J. Inst. Maths Applics 10, 1972). Where the weights leave
/// a ratio open, as that of two polarisations that do not act on each other, the numbers themselves are compared.
/// \param weights square and symmetric
[[nodiscard]] std::vector<double> natural_sizes(const Eigen::MatrixXd& weights);

/// A field is 0 but for rounding where, in natural sizes, it is so small beside another: far above rounding errors that
/// add up over a long run.
inline constexpr double rounding_beside_others = 1e-10;

/// max_f |z_f|/D_f: the size of all fields together.
[[nodiscard]] double largest_in(std::span<const double> natural, std::span<const double> sizes);

/// S'' of fields that have these values, in the middle of the domain; the constant part alone where that is not finite.
[[nodiscard]] Eigen::MatrixXd hessian_of_sizes(const MultisymplecticSystem& system, const grids::Grid& grid,
                                               std::span<const double> sizes);

/// The natural sizes for waves of the length of the domain: by |S''| + Σ_a 2π/L_a |K_a|. \param hessian S''
[[nodiscard]] std::vector<double> natural_sizes(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                const Eigen::MatrixXd& hessian);

/// Finds lattices whose energy is rounding error alone.
///
/// The size of the terms of the energy says how well it is known, but for one case: each term is a product with a field
/// that is 0 but for rounding, as for a plane wave of Maxwell's equations along an axis. The terms then are as small as
/// that field, and their sum has no correct digit. Therefore terms below rounding_beside_others of the energy that
/// waves of the length of the domain would have, if all fields were as large as the largest (natural_sizes), are
/// rounding.
class EnergyFloor {
public:
  EnergyFloor(const MultisymplecticSystem& system, const grids::Grid& grid);

  /// Raises `size.rounding` to the floor where the magnitudes of the terms are below it. Collective. \param fields of a
  /// level, or at the middle of a step
  void raise(formula::SumSize& size, std::span<const double* const> fields) const;

private:
  const MultisymplecticSystem& system_;
  const grids::Grid& grid_;
};

}  // namespace rubato
