#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// What an equation says of means along x beyond the constraints of a level: conditions that no step can mend.
///
/// Means of fields that linear constraints bind to derivatives by x never change. A row nᵀ(M z_t + Σ K_a z_{x_a}) =
/// nᵀ∇S whose nᵀM holds such fields alone has the mean nᵀ(Σ_{a > x} K_a z_{x_a} - ∇S) = 0: of u_xt = sin(u), that of
/// sin(u). And potentials that grow along x, as their derivative u has a mean, have no periodic equation where ∂S/∂φ
/// depends on fields, or where derivatives by y see them grow at different rates.
class MeanConditions {
public:
  explicit MeanConditions(const MultisymplecticSystem& system);

  /// True if there is any, of rows or of potentials that are not given: all lines have to be looked at together.
  [[nodiscard]] bool any(const std::vector<bool>& given) const;

  /// \throws InitialFieldError, or std::invalid_argument where no given field can be blamed, if a level breaks them by
  /// more than tails of data that are cut off at the ends of a period explain
  void check(const grids::Grid& grid, const InitialFields& given, const LatticeLevel& level) const;

  /// What depends on place and time alone, as a force, at these times. \throws std::invalid_argument with the row whose
  /// mean it gives where that has to be 0
  void check_forces(const grids::Grid& grid, std::span<const double> times) const;

private:
  void check_rows(const grids::Grid& grid, const InitialFields& given, const LatticeLevel& level) const;
  void check_slopes(const grids::Grid& grid, const InitialFields& given, const LatticeLevel& level) const;

  const MultisymplecticSystem& system_;
  std::optional<int> clock_;  ///< the field that is the time of an S of t
  Eigen::MatrixXd of_lines_;  ///< n, as columns: of every line along x
  Eigen::MatrixXd of_grid_;   ///< of the mean over the grid alone
};

}  // namespace rubato
