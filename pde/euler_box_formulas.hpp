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
///     solve:  z_f at the new level = z_f - R_r(z')/(S''(r, f) + M₊(f, r)/h)   where S'' is constant there:
///
/// z' is the new level, in which z_f is still that of the old one, so that one correction is the solution.
class EulerBoxFormulas {
public:
  EulerBoxFormulas(const MultisymplecticSystem& system, const grids::Grid& grid);

  [[nodiscard]] NodeCode kick(int row, int column, double value);
  [[nodiscard]] NodeCode solve(int row, int field);
  /// S - Σ_a zᵀK₊δ_a⁺z of the level `before`.
  [[nodiscard]] NodeCode energy();

  /// Lets code read two levels, h apart; `inverse`: 1/(S'' + M₊/h) of a solve.
  void read(NodeCode& code, double h, double inverse, const grids::FieldSet& before,
            const grids::FieldSet& after) const;

private:
  /// R of a row, with the fields at these places among the arrays of both levels.
  [[nodiscard]] formula::Expression row(int number, const std::vector<int>& arrays);
  [[nodiscard]] std::vector<formula::Expression> values(const std::vector<int>& arrays);
  [[nodiscard]] std::vector<int> arrays_of(int level) const;

  MultisymplecticSystem system_;
  NodeFormulas formulas_;
  std::vector<formula::Expression> gradient_;  ///< ∇S
  grids::FieldSet coordinates_;
};

}  // namespace rubato
