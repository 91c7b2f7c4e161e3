#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <stdexcept>

#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/level_history.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/pde/stage_source.hpp>
#include <rubato/pde/wall_drives.hpp>
#include <rubato/variation/level_scheme.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

/// A system or grid that a scheme cannot take, with the reason and the remedy.
class SchemeRefusal : public std::invalid_argument {
public:
  using std::invalid_argument::invalid_argument;
};

/// A time-stepping scheme for a lattice: what TimeLevels needs, and the present level.
class LatticeScheme : public LevelScheme {
public:
  [[nodiscard]] virtual const MultisymplecticSystem& system() const = 0;
  [[nodiscard]] virtual const grids::Grid& grid() const = 0;
  [[nodiscard]] virtual const LatticeLevel& level() const = 0;
  /// Stands at a level with no past, but for a step of length h that leads from there to `next`: what a solution may
  /// begin from. Levels of one run have the same slopes.
  virtual void stand(const LatticeLevel& level, const LatticeLevel& next, double h) = 0;
  /// The time of the level, which walls that drive fields read; until it is set the run begins there.
  virtual void set_time(double t) { static_cast<void>(t); }
  /// Puts fields that differ from those of level() by rounding errors in their place.
  virtual void correct(const grids::FieldSet& fields) { static_cast<void>(fields); }
  /// False where level() has something to compute yet: the caller that does not ask does not pay. Then write_previous()
  /// has the fields of the level before after the next accept().
  ///@{
  [[nodiscard]] virtual bool level_is_current() const { return true; }
  virtual void write_previous(grids::FieldSet& fields) const { static_cast<void>(fields); }
  ///@}
  /// The level before the one that accept() has moved to last, where the scheme keeps it; it stands until the next
  /// accept(). A scheme keeps it, and saves it, always or never; after forget_previous(), which is called before the
  /// first step if at all, it need not.
  ///@{
  [[nodiscard]] virtual const LatticeLevel* previous() const { return nullptr; }
  virtual void forget_previous() {}
  ///@}
  /// The work that driven walls have done so far; nothing where there is none. It is not in the energies that the
  /// scheme reports.
  [[nodiscard]] virtual std::optional<double> work() const { return std::nullopt; }
  /// The stages of the step accepted last, for laws that need them; null for schemes whose laws two levels give.
  [[nodiscard]] virtual std::shared_ptr<StageSource> stages() { return nullptr; }
  /// A bound of rounding takes as long as some steps.
  [[nodiscard]] std::size_t energy_size_period() const override { return tuning::large_size_period; }
};

/// The box (Preissman) scheme, the production form of box_action() (theory, section 5): in
/// every cell
///
///     R = M D_t z + Σ_a K_a D_a z̄ - ∇S(z̄) = 0,      E_k = Σ ΔV [S(z̄) + Σ_a (D_a z̄)ᵀK₊z̄],
///
/// z̄ the mean of the cell's corners. The two-step value equation of the action, Σ_{cells of a node} R = 0, has it as
/// the solution that starts with R = 0; this form does not accumulate the parasites of the other. Order 2 in h and Δx,
/// multisymplectic at fixed levels and with variable ones.
///
/// The increment is solved by Newton's method, the matrix renewed at every correction (its factors are not kept, see
/// CyclicBlockSolver, so an old one would cost as much), until the error that the last correction left, as the measured
/// contraction shows it (NewtonContraction), is below rounding or the residual is; for a trial length that will not be
/// the last, below what the level equation can make use of. One correction does for most trials of a regular step, and
/// its energy follows without another sweep. Fields in ker M have no increment of their own: multipliers are solved for
/// at the midpoint only. States are summed with compensation. Results do not depend on the number of threads.
///
/// On a line between walls any number of cells will do: its rows are closed by WallConditions. No energy passes a wall
/// that is fixed or free, and the law of levels holds as on a ring. `drives`, if any, are what walls give; levels are
/// fixed then, and energies are less their work.
///
/// \throws SchemeRefusal as WallConditions, or for potentials that a frame moves
/// \throws std::invalid_argument on a ring for an even number of cells in some direction, where the averages annihilate
/// the sawtooth (-1)^i; if the dimensions of grid and system differ; if the first level's fields or S there are not
/// finite
[[nodiscard]] std::unique_ptr<LatticeScheme> make_box_scheme(const MultisymplecticSystem& system,
                                                             const grids::Grid& grid, LatticeLevel first,
                                                             double first_step,
                                                             const std::shared_ptr<const WallDrives>& drives = nullptr);

/// How many fields a step of length h of the box scheme solves for; the others follow node by node.
[[nodiscard]] int box_unknowns(const MultisymplecticSystem& system, double h);

/// The rates at its start, for which a short step forward and one back stand; empty where these fail.
[[nodiscard]] LevelHistory box_start(const MultisymplecticSystem& system, const grids::Grid& grid,
                                     const LatticeLevel& first, double first_step,
                                     const std::shared_ptr<const WallDrives>& drives = nullptr);

/// Gauss collocation of order 2·stages in time (GaussStep; theory, section 8.3), in space with spectral derivatives ∂
/// or, with a Gauss rule, as the box: E_k is the Hamiltonian that generates the family of maps in h. With one stage and
/// spectral derivatives it is the midpoint rule of fourier_action(),
///
///     M δ_t z + Σ_a K_a ∂_a z̄ = ∇S(z̄)  at every node,      E_k = Σ ΔV [S(z̄) + Σ_a (∂_a z̄)ᵀK₊z̄],
///
/// and two levels are all that its laws need. Any number of cells: on even ones ∂ annihilates the Nyquist mode, on
/// which the step's matrix then has the kernel that it has on the constant; it is held there too (WaveResolvent), and
/// the first level has no Nyquist mode where a potential cannot. There is no Γ at levels, so that where the level
/// equation has no solution a step potential has to help. \throws std::invalid_argument if the dimensions of grid and
/// system differ, stages are not 1 … 8, S is not finite at the first level, or as SpaceCollocation
[[nodiscard]] std::unique_ptr<LatticeScheme> make_gauss_lattice(const MultisymplecticSystem& system,
                                                                const grids::Grid& grid, int stages, LatticeLevel first,
                                                                SpaceRule space = {});

/// The Euler box scheme (theory, section 5), explicit: with M = M₊ - M₊ᵀ, K_a = K₊ - K₊ᵀ,
///
///     M₊(z_{k+1} - z_k) - M₊ᵀ(z_k - z_{k-1}) = h [∇S - Σ_a K₊δ_a⁺z + K₊ᵀδ_a⁻z]  at every node.
///
/// The rows of M₊ at a level give the fields of its columns at the next; then the other rows at that level give the
/// other fields, one after the other, node by node: see EulerBoxMap. As a map of levels it is of first order in h
/// (symplectic Euler in time). For fixed levels only: its
/// E_k = Σ ΔV [S - Σ_a zᵀK₊δ_a⁺z] reads one level, and no h could be solved from it at turning points or on travelling
/// waves. Stable under a CFL condition only, h < Δx for wave equations.
/// \throws std::invalid_argument if the rows cannot be put into such an order (KdV and other potential forms, Dirac),
/// saying which field is left; `first` from initial_level() with Collocation::corners
[[nodiscard]] std::unique_ptr<LatticeScheme> make_euler_box_scheme(const MultisymplecticSystem& system,
                                                                   const grids::Grid& grid, LatticeLevel first);

}  // namespace rubato
