#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include <rubato/base/spread.hpp>
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

/// A solution of the linearised scheme over one step; for euler-box also one level earlier, for Gauss collocation also
/// its stages.
struct TangentLevels {
  const grids::FieldSet& before;
  const grids::FieldSet& after;
  const grids::FieldSet* earlier = nullptr;
  std::span<const grids::FieldSet> stages = {};
};

class LawEvaluator;
class StageSource;

/// The local conservation laws of a lattice, in the form that its scheme has them (theory, section 5).
///
/// With the directions μ = t, x, y, z, the matrices Λ_t = M, Λ_a = K_a and Λ = Λ₊ - Λ₊ᵀ, every law is
/// Σ_μ D_μ J_μ = 0. Translation in ν = t gives the law of energy, in ν = x, y, z those of momentum. The densities J_t
/// hold no bare potentials, and no multipliers but times a constraint that vanishes at levels.
///
/// **The box** ("Edge residuals"): currents on the faces of cells, J_μ on those normal to μ, where z
/// is averaged in all other directions:
///
///     translation in ν:   J_μ = -(D_ν z)ᵀΛ₊_μ z (μ ≠ ν),   J_ν = S(z) + Σ_{μ≠ν} (D_μ z)ᵀΛ₊_μ z
///     linear symmetry:    J_μ = ½ zᵀΛ_μB z
///     affine symmetry b:  J_μ = bᵀΛ_μ z        (b·∇S = 0)
///
/// The residual is divided by the cell: for S quadratic energy and momentum hold to rounding with any levels; for
/// others energy is O(h²) and momentum O(Δx²); symmetries hold to rounding always.
///
/// With several stages in time, J_a is integrated over them: Σ_i b_i J_a(Z_i, Ż_i); the error of energy is O(h^2m)
/// then. With splittings, over Lobatto's points, of which the levels are two. With several in space, J_t is the mean of
/// the Gauss points of an element in its quadrature, and D_a that of its two faces; its cells share the residual. The
/// error of momentum is O(Δx^2r).
///
/// **Fourier**: the same currents at the nodes, D_a the spectral derivative: laws in space hold to
/// aliasing error only.
///
/// **Euler-box**: the currents of its node laws e = S - zᵀK₊δ_x⁺z, f = zᵀK₊δ_t⁺z, m = zᵀM₊δ_x⁺z,
/// g = S - zᵀM₊δ_t⁺z at the base corner of a cell, with zᵀΛ₊δ⁺z = δ⁺(zᵀΛ₊z) - (δ⁺z)ᵀΛ₊z⁺ put in so that bare potentials
/// drop out, z⁺ the neighbour in the direction of δ⁺:
///
///     J_μ = -(δ_ν⁺z)ᵀΛ₊_μ z⁺ (μ ≠ ν),   J_ν = S(z) + Σ_{μ≠ν} (δ_μ⁺z)ᵀΛ₊_μ z⁺,   δ_t⁺J_t + Σ_a δ_a⁺J_a,
///
/// which leaves the sum of differences as it is. Symmetries as for the box, with z at the base corner. All are of
/// first order only, but for affine symmetries of potentials, which hold to rounding.
///
/// Laws are computed from two levels and h alone, so a run and its record give the same numbers.
class LocalLaws {
public:
  /// Numbers of what has been asked, none of them 0.
  using Question = std::uint64_t;
  static constexpr Question none = 0;

  /// Those of a method: see make_local_laws() of lattice_method.hpp. Their engine, and its arrays, are made when a law
  /// is first asked for.
  LocalLaws(std::vector<std::string> names, std::function<std::unique_ptr<LawEvaluator>()> make);
  ~LocalLaws();
  LocalLaws(LocalLaws&&) noexcept;
  LocalLaws& operator=(LocalLaws&&) noexcept;

  /// See LawEvaluator.
  void share(std::shared_ptr<StageSource> stages);

  /// "energy", "momentum" (in more dimensions "momentum_x", …; "momentum_balance" and "momentum_balance_x" where S
  /// names that coordinate: the residual of Σ_μ D_μ J_μ = ∂S/∂x at fixed z), the linear symmetries' names, then the
  /// affine symmetries with a density: "mass", or "mass_FIELD" where there are several.
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] std::size_t count() const { return names().size(); }

  /// The residual of every law in every cell of the step from `before` to `after`, h apart, into residuals[law], one
  /// value for each cell (an empty span if only sizes are wanted).
  /// \return the magnitudes of each over the cells
  /// \param earlier what last_question() was after the same of the step that led to `before`: then, if nothing else was
  /// asked since, what that found of the level is not found again
  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals = {}, Question earlier = none);
  [[nodiscard]] Question last_question() const { return asked_; }

  /// Σ ΔV J_t over the level: total energy 𝓔(z_k), momenta, charges.
  std::vector<double> totals(const LatticeLevel& level);
  /// The same of the level that was `after` for residuals() the last time, which may have found them.
  std::vector<double> totals_after(const LatticeLevel& after);

  /// D_t(UᵀMV) + Σ D_a(UᵀK_aV) in every cell, for two tangent solutions over the same step: UᵀMV averaged in x at
  /// levels, UᵀK_aV in t on the faces between cells; over the stages, if there are several. For euler-box, at the node
  /// of the level `before`,
  ///
  ///     (W_{k+1} - W_k)/h + Σ_a (X_{i+1} - X_i)/Δx_a,   W_k = U_{k-1}ᵀM₊V_k - V_{k-1}ᵀM₊U_k,
  ///                                                     X_i = U_{i-1}ᵀK₊V_i - V_{i-1}ᵀK₊U_i.
  ///
  /// `residual` may be null. \throws std::invalid_argument for euler-box without the earlier levels, for Gauss
  /// collocation without the stages
  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual = nullptr);

private:
  [[nodiscard]] LawEvaluator& engine();

  std::vector<std::string> names_;
  std::function<std::unique_ptr<LawEvaluator>()> make_;
  std::unique_ptr<LawEvaluator> engine_;
  std::shared_ptr<StageSource> stages_;  ///< for an engine that is not made yet
  Question asked_ = none;
};

}  // namespace rubato
