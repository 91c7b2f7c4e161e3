#pragma once

#include <memory>
#include <span>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/pde/cell_blocks.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/variation/potential_slopes.hpp>

namespace rubato {

/// Where the equation is imposed, and by which operators A and D_a.
struct Collocation {
  enum class Points { cells, nodes, corners };
  Points points = Points::cells;
  int stages = 1;  ///< of cells: Gauss points of as many cells together, an element

  static const Collocation cells;  ///< in the middle of cells, by averages and differences of the nodes around: the box
  static const Collocation nodes;  ///< at the nodes, A the identity and D_a the spectral derivative: Fourier
  static const Collocation corners;  ///< at the nodes too, by one-sided differences: euler-box
  /// At the Gauss points of elements of several cells, along a line alone: see SpaceCollocation.
  [[nodiscard]] static constexpr Collocation elements(int stages) { return {Points::cells, stages}; }
  [[nodiscard]] constexpr bool has_elements() const { return stages > 1; }

  friend constexpr bool operator==(const Collocation&, const Collocation&) = default;
};
inline constexpr Collocation Collocation::cells{};
inline constexpr Collocation Collocation::nodes{Collocation::Points::nodes};
inline constexpr Collocation Collocation::corners{Collocation::Points::corners};

/// What one sweep over all cells gives.
struct SweepResult {
  double energy = 0.0;     ///< Σ ΔV [S + Σ_a (D_a z)ᵀK₊A z], the split energy density
  double quadratic = 0.0;  ///< Σ ΔV (A v)ᵀ(Σ_a K_a D_a v - S''A v) of the rate v
  double residual = 0.0;   ///< the largest |R| relative to the terms of its row
  /// The largest |R| relative to what the node values' last digits may change of its row, over ε: to the terms of the
  /// row and to S''|z|. Where it is a small multiple of ε the values solve the equation as exactly as they can be
  /// stored.
  double backward_error = 0.0;
  bool finite = true;
};

/// By how much `energy` and `quadratic` of a sweep change.
struct EnergyChange {
  double energy = 0.0;
  double quadratic = 0.0;
};

/// Evaluates the equation in every cell, in batches, in parallel. Holds work space for each thread. At
/// Collocation::corners only energies are those of a scheme: its equation has differences of both kinds. Ranks that
/// share a lattice at corners, or a line of cells, sweep together, each over the cells that it owns, from right ghosts;
/// what the sweep shows is of all cells, and the same for every number of ranks.
class CellSweep {
public:
  CellSweep(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation = Collocation::cells);
  ~CellSweep();

  /// At node values `point` (z̄ = A point, D_a point) with slopes, and node rates `rate` (empty for none; null pointers
  /// in it stand for zero fields). If wanted (not empty), `residual` receives -R, one array for each row of
  /// R = inverse_h·M A rate + Σ K_a D_a point - ∇S(z̄), and `hessian` the varying entries of S''(z̄).
  SweepResult operator()(std::span<const double* const> point, const PotentialSlopes& slopes,
                         std::span<const double* const> rate, double inverse_h, std::span<double* const> residual,
                         std::span<double* const> hessian);

  /// By how much energy and quadratic form of the last sweep change when a correction c of the point, 2 c of the rate
  /// is added, one that solves the equations linearised there, (2/h) M A c + Σ K_a D_a c - S''A c = -R:
  ///
  ///     Σ ΔV (A c)ᵀ(M A δ/h - R/2) + O(c³)   and   4 Σ ΔV [2 (A c)ᵀM A δ/h - (A δ - A c)ᵀR] + O(c).
  ///
  /// For the first variation of the energy is ∇S - Σ K_a D_a z = M A δ/h - R and the second S''A c - Σ K_a D_a c =
  /// (2/h) M A c + R; the quadratic form is the latter's and symmetric in the sum over all cells; and M is skew, so
  /// that `rate` is δ with 2 c in it. What is left of the second line comes from the change of S'' alone. Null pointers
  /// in `rate` leave the first line as it is, the second one wrong. `inverse_h` and `residual` as in that sweep.
  [[nodiscard]] EnergyChange energy_change(std::span<const double* const> rate, double inverse_h,
                                           std::span<const double* const> residual,
                                           std::span<const double* const> correction);

  /// The means over all cells of the terms that S is the sum of (formula::terms_of), at this point.
  [[nodiscard]] std::vector<double> mean_terms(std::span<const double* const> point, const PotentialSlopes& slopes);

  /// How far the terms of the energy of a sweep at this point are from `references`, mean_terms() of some level of the
  /// same run: so it does not depend on how large a box of a vacuum with S ≠ 0 is around what moves. And what rounding
  /// makes of the energy: the nodes' values are rounded, so are their differences and the terms of each cell. The
  /// cells' errors are taken to be independent: four times the root of their squares' sum, no more than their sum; so
  /// is the rounding error of partial sums. Costs more than a sweep.
  [[nodiscard]] formula::SumSize energy_size(std::span<const double* const> point, const PotentialSlopes& slopes,
                                             std::span<const double> references);

  /// Gives back the memory of what sweeps make of their point before they go through the cells.
  void give_back();

private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

}  // namespace rubato
