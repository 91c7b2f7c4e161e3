#pragma once

#include <complex>
#include <memory>
#include <span>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/wave_rows.hpp>
#include <rubato/variation/gauss_tableau.hpp>

namespace rubato {

/// How derivatives in space are taken.
struct SpaceRule {
  int stages = 0;  ///< of Gauss collocation on cells; 0: spectral derivatives at the nodes
  [[nodiscard]] bool spectral() const { return stages == 0; }
};

/// Collocation in space on the waves of a periodic grid: the points at which an equation with ∂_a holds, and what ∂_a
/// is there.
///
/// Spectral: the points are the nodes, and ∂_a e^{ik·x} = ik_a e^{ik·x}.
///
/// Gauss (Reich, "Multi-symplectic Runge–Kutta collocation methods for Hamiltonian wave equations", J. Comput. Phys.
/// 157, 2000): on cells of length ℓ, z is a polynomial of degree r that z' = Z' at the r Gauss points Z_i of the cell
/// determines, continuous at the faces. A wave of faces e^{ikx} that solves z' = iκz there has R(iκℓ) = e^{ikℓ}, R the
/// stability function of the tableau (A, b), so that ∂ is a number on each wave again,
///
///     arg R(iκℓ) = kℓ,      Z_i = φ_i e^{ikx},   φ = (1 - iκℓA)⁻¹ 1,   x the lower face,
///
/// for r = 1 κ = (2/Δx) tan(kΔx/2) and φ = cos(kΔx/2) e^{ikΔx/2}: the box. Rows of waves hold the amplitudes of
/// φ/|φ|, |φ|² = Σ b_i |φ_i|², an orthonormal system in the quadrature of the cells, since ∂ is skew in it.
class SpaceCollocation {
public:
  /// \throws std::invalid_argument for a Gauss rule on an even number of cells, where on (-1)^i no κ is finite
  SpaceCollocation(const grids::Grid& grid, SpaceRule rule);

  [[nodiscard]] SpaceRule rule() const { return rule_; }
  [[nodiscard]] bool spectral() const { return rule_.spectral(); }
  /// κ_a of each wave; 0 where ∂_a gives 0.
  [[nodiscard]] const std::vector<std::vector<double>>& derivatives() const { return derivatives_; }

  /// Amplitudes from those of node values ẑ, in place, and back.
  ///@{
  void from_nodes(WaveRows& rows) const;
  void to_nodes(WaveRows& rows) const;
  ///@}
  /// The coordinates that S names, at the points.
  [[nodiscard]] PlacedCoordinates places(const MultisymplecticSystem& system, const grids::Grid& grid) const;

private:
  SpaceRule rule_;
  std::vector<std::vector<double>> derivatives_;
  WaveRows factor_, inverse_;  ///< amplitude over ẑ, and the other way round
};

}  // namespace rubato
