#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <vector>

#include <rubato/grids/field_set.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/wave_rows.hpp>

namespace rubato {

/// How derivatives in space are taken.
struct SpaceRule {
  int stages = 0;  ///< of Gauss collocation on cells; 0: spectral derivatives at the nodes
  [[nodiscard]] bool spectral() const { return stages == 0; }
};

/// Why Gauss collocation with so many stages cannot take a periodic line of so many cells; empty where it can. Some
/// wave of the nodes alternates at its points then, and no κ is finite there.
[[nodiscard]] std::string_view space_rule_objection(SpaceRule rule, std::size_t cells);
inline constexpr int most_space_stages = 4;

/// Collocation in space on the waves of a periodic grid: the points at which an equation with ∂_a holds, and what ∂_a
/// is there.
///
/// Spectral: the points are the nodes, and ∂_a e^{ik·x} = ik_a e^{ik·x}.
///
/// Gauss (Reich, "Multi-symplectic Runge–Kutta collocation methods for Hamiltonian wave equations", J. Comput. Phys.
/// 157, 2000): r cells make an element of length ℓ = rΔx. There z is a polynomial of degree r, continuous at the faces,
/// and its derivatives at the r Gauss points are what the equation names: Z_i = z_face + ℓ Σ_j a_ij Z'_j with the
/// tableau (A, b). A wave that takes the values e^{ikx} at the faces and solves z' = iκz has R(iκℓ) = e^{ikℓ}, R the
/// stability function, so that ∂ is a number on each wave again,
///
///     arg R(iκℓ) = kℓ,      Z_i = φ_i e^{ikx},   φ = (1 - iκℓA)⁻¹ 1,   x the lower face,
///
/// and arg R rises from -rπ to rπ with κ: each of the waves |k| < π/Δx that the nodes distinguish has one κ = k +
/// O(Δx^2r), and is one solution. For r = 1 κ = (2/Δx) tan(kΔx/2) and φ = cos(kΔx/2) e^{ikΔx/2}: the box. So a level
/// may be reported at the nodes, all Δx apart: ẑ(k) is the amplitude of the solution k, z its values at the faces, and
/// between them (r > 1) their smooth continuation, which is as accurate as they are, where the polynomial is not.
///
/// ∂ is skew in the quadrature of the elements, its waves orthogonal: rows hold the amplitudes of φ/|φ|, |φ|² = Σ b_i
/// |φ_i|² (for r = 1 of e^{ikx} in the middle of the cells). Several dimensions for r = 1 only.
class SpaceCollocation {
public:
  /// \throws std::invalid_argument for what space_rule_objection() names, or r > 1 in several dimensions
  SpaceCollocation(const grids::Grid& grid, SpaceRule rule);

  [[nodiscard]] SpaceRule rule() const { return rule_; }
  [[nodiscard]] bool spectral() const { return rule_.spectral(); }
  /// κ_a of each wave; 0 where ∂_a gives 0.
  [[nodiscard]] const std::vector<std::vector<double>>& derivatives() const { return derivatives_; }
  /// Amplitude of a row over ẑ, one row.
  [[nodiscard]] const WaveRows& factor() const { return factor_; }
  /// φ_i/|φ|, for r > 1.
  [[nodiscard]] const WaveRows& modes() const { return modes_; }

  /// Amplitudes from those of node values ẑ, in place, and back.
  ///@{
  void from_nodes(WaveRows& rows) const;
  void to_nodes(WaveRows& rows) const;
  ///@}
  /// The coordinates that S names, at the points.
  [[nodiscard]] PlacedCoordinates places(const MultisymplecticSystem& system, const grids::Grid& grid) const;
  /// Of each point beside ΔV in sums over the grid; empty where all are 1.
  [[nodiscard]] std::span<const double> weights() const { return weights_; }

private:
  void add_elements(const grids::Grid& grid);

  SpaceRule rule_;
  std::vector<std::vector<double>> derivatives_;
  WaveRows factor_, inverse_, modes_;
  std::vector<double> weights_, fractions_;  ///< r b_i of each point, c_i of each stage
};

/// Rows of waves from values at the points of a SpaceCollocation, and back: up to `fields` at once. Points follow each
/// other along a line.
class PointTransform {
public:
  PointTransform(const SpaceCollocation& space, const grids::Grid& grid, int fields);

  /// Into the first rows.
  void from_points(std::span<const double* const> fields, WaveRows& rows);
  /// Of rows number `which`.
  void to_points(const WaveRows& rows, std::span<const int> which, std::span<double* const> fields);

private:
  struct Branch {
    std::size_t wave;
    double sign;  ///< -1: of the conjugate
  };
  int stages_;
  grids::Fourier fourier_;
  std::vector<Branch> branches_;  ///< r for each wave of the elements
  WaveRows modes_;
  std::vector<double> b_;
  grids::FieldSet values_;  ///< of each field at each stage, one for each element
};

/// A z and D z at the points of elements of a line, of node values z.
class ElementOperators {
public:
  ElementOperators(const grids::Grid& grid, int stages);

  [[nodiscard]] const SpaceCollocation& space() const { return space_; }
  /// Null pointers are left out.
  void operator()(const double* nodes, double* mean, double* derivative);
  /// The grid function whose transform is the row of values at the points; in and out may be the same.
  void to_row(const double* points, double* out);

private:
  SpaceCollocation space_;
  grids::Fourier fourier_;
  PointTransform points_;
  WaveRows row_, derived_;
};

}  // namespace rubato
