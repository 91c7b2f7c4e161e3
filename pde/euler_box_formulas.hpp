#pragma once

#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

/// The rows of a step of euler-box that give their field explicitly, and its energy, each as one formula of a node and
/// its neighbours. With R(z) = ∇S - Σ_a (K₊δ_a⁺ - K₊ᵀδ_a⁻) z:
///
///     kick:   z_c at the new level = z_c + h R_r(z)/M₊(r, c)                  where M₊ has the entry (r, c),
///
/// of which R_r is a formula of one level, and
///
///     solve:  z_f at the new level = z_f - R_r(z')/(S''(r, f) + M₊(f, r)/h)   where S'' is constant there:
///
/// z' is the new level, in which z_f is still that of the old one, so that one correction is the solution.
class EulerBoxFormulas {
public:
  EulerBoxFormulas(const MultisymplecticSystem& system, const grids::Grid& grid);

  /// Of the level `before`: R of each of these rows, and the density of energy S - Σ_a zᵀK₊δ_a⁺z, which are made of the
  /// same functions.
  [[nodiscard]] NodeCode at_level(std::span<const int> rows);
  [[nodiscard]] NodeCode solve(int row, int field);

  /// Lets code read two levels; `inverse`: 1/(S'' + M₊/h) of a solve.
  void read(NodeCode& code, double inverse, const grids::FieldSet& before, const grids::FieldSet& after) const;

private:
  /// R of a row, with the fields at these places among the arrays of both levels.
  [[nodiscard]] formula::Expression row(int number, const std::vector<int>& arrays);
  [[nodiscard]] formula::Expression energy_density();
  [[nodiscard]] std::vector<formula::Expression> values(const std::vector<int>& arrays);
  [[nodiscard]] std::vector<int> arrays_of(int level) const;

  MultisymplecticSystem system_;
  NodeFormulas formulas_;
  std::vector<formula::Expression> gradient_;  ///< ∇S
  grids::FieldSet coordinates_;
};

}  // namespace rubato
