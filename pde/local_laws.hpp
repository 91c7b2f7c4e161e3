#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/grids/grid.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/multisymplectic_system.hpp>

namespace rubato {

/// A linear symmetry z → z + s B z of a system: MB and all K_aB symmetric, ∇S(z)·Bz = 0 (equations, "Traps"). For the
/// nonlinear Schrödinger equation B sends (p, q, v, w) to (-q, p, -w, v), and its law is that of charge.
struct LinearSymmetry {
  std::string name;
  Eigen::MatrixXd B;
};

/// \throws std::invalid_argument, with the entry or the value of ∇S·Bz, if B is no symmetry of the system
void check_symmetry(const MultisymplecticSystem& system, const LinearSymmetry& symmetry);

/// The size of a residual over cells (and levels).
class LawSize {
public:
  void add(double max, double sum_of_squares, std::size_t count);
  void add(const LawSize& other) { add(other.max_, other.squares_, other.count_); }
  [[nodiscard]] double max() const { return max_; }
  [[nodiscard]] double rms() const;

private:
  double max_ = 0.0;
  double squares_ = 0.0;
  std::size_t count_ = 0;
};

/// The local conservation laws of the box scheme on the edges of its cells (theory, section 5, "Edge residuals").
///
/// With the directions μ = t, x, y, z, the matrices Λ_t = M, Λ_a = K_a and Λ = Λ₊ - Λ₊ᵀ, every law is
/// Σ_μ D_μ J_μ = 0 with the current J_μ on the faces normal to μ, where z is averaged in all other directions:
///
///     translation in ν:   J_μ = -(D_ν z)ᵀΛ₊_μ z (μ ≠ ν),   J_ν = S(z) + Σ_{μ≠ν} (D_μ z)ᵀΛ₊_μ z
///     linear symmetry:    J_μ = ½ zᵀΛ_μB z
///     affine symmetry b:  J_μ = bᵀΛ_μ z        (b·∇S = 0)
///
/// ν = t is the law of energy, ν = x, y, z are those of momentum. The densities J_t hold no bare potentials, and no
/// multipliers but times a constraint that vanishes at levels. The residual is divided by the cell: for S quadratic
/// energy and momentum hold to rounding with any levels; for others energy is O(h²) and momentum O(Δx²); symmetries
/// hold to rounding always.
///
/// With Placement::nodes, for the Fourier scheme, currents are at the nodes and D_a is the spectral derivative: laws in
/// space hold to aliasing error only.
///
/// Laws are computed from two levels and h alone, so a run and its record give the same numbers.
class LocalLaws {
public:
  /// \throws std::invalid_argument if one of `symmetries` is none
  LocalLaws(const MultisymplecticSystem& system, const grids::Grid& grid, std::vector<LinearSymmetry> symmetries = {},
            Placement placement = Placement::cells);
  ~LocalLaws();
  LocalLaws(LocalLaws&&) noexcept;
  LocalLaws& operator=(LocalLaws&&) noexcept;

  /// "energy", "momentum" (in more dimensions "momentum_x", …), the linear symmetries' names, then the affine
  /// symmetries with a density: "mass", or "mass_FIELD" where there are several.
  [[nodiscard]] const std::vector<std::string>& names() const;
  [[nodiscard]] std::size_t count() const { return names().size(); }

  /// The residual of every law in every cell of the step from `before` to `after`, h apart, into residuals[law], one
  /// value for each cell (an empty span if only sizes are wanted).
  /// \return the size of each
  std::vector<LawSize> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                 std::span<double* const> residuals = {});

  /// Σ ΔV J_t over the level: total energy 𝓔(z_k), momenta, charges.
  std::vector<double> totals(const LatticeLevel& level);

  /// The currents of energy (ν = t) and momentum (ν = x, …) in the middle of every cell, J^ν_μ into
  /// currents[ν·(1 + dimensions) + μ]: ½ z̄ᵀΛ_μD_νz for μ ≠ ν, S(z̄) - Σ_{μ≠ν} ½ z̄ᵀΛ_μD_μz for μ = ν; with a potential
  /// in the system -(D_νz)ᵀΛ₊_μz̄ stands for ½ z̄ᵀΛ_μD_νz. See VariationalLaws.
  void cell_currents(const LatticeLevel& before, const LatticeLevel& after, double h,
                     std::span<double* const> currents);

  /// D_t(UᵀMV) + Σ D_a(UᵀK_aV) in every cell, for two tangent solutions over the same step; `residual` may be null.
  LawSize multisymplectic_residual(const grids::FieldSet& u_before, const grids::FieldSet& u_after,
                                   const grids::FieldSet& v_before, const grids::FieldSet& v_after, double h,
                                   double* residual = nullptr);

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato
