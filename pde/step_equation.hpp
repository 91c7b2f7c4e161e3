#pragma once

#include <memory>

#include <rubato/base/spread.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/space_collocation.hpp>
#include <rubato/pde/wall_drives.hpp>
#include <rubato/variation/level_scheme.hpp>

namespace rubato {

/// What one step of a lattice says by itself.
struct StepLaw {
  double energy = 0.0;   ///< E_k, less what driven walls do in the step before its middle
  double gamma = 0.0;    ///< Γ in the middle of the step
  Spread residual;       ///< what the two levels leave of the scheme's equation, over all rows and nodes
  double work = 0.0;     ///< that driven walls do in the step
  bool is_long = false;  ///< so long that it makes much more of the rounding of its equation than of its levels'
};

/// A scheme on a lattice read as an equation for two levels that are there already: it judges steps and takes none. Of
/// a scheme that states an action the rows are the variations of that action by the values, on whatever levels.
class StepEquation {
public:
  StepEquation(int fields, std::size_t nodes) : rows_(fields, nodes) {}
  StepEquation(const StepEquation&) = delete;
  StepEquation& operator=(const StepEquation&) = delete;
  virtual ~StepEquation() = default;
  /// 𝓔(z_k); and Γ(z_k) if all steps that led to the level were judged before, one after the other. Not finite where S
  /// is not.
  [[nodiscard]] virtual NodeEnergy node(const LatticeLevel& level) = 0;
  [[nodiscard]] virtual StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) = 0;
  /// The same for any two levels: no step that was judged.
  [[nodiscard]] virtual StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) = 0;
  /// What the levels seen last leave of each row at each node, or in each cell.
  [[nodiscard]] const grids::FieldSet& rows() const { return rows_; }

protected:
  grids::FieldSet rows_;
};

/// The equation of `box` and `fourier` with one stage, R = M D_t z + Σ_a K_a D_a z̄ - ∇S(z̄), and their energy
/// E_k = Σ ΔV [S(z̄) + Σ_a (D_a z̄)ᵀK₊z̄].
///
/// Γ at a level of the box comes from the rates of the last steps, as in a run. At `first`, the level that all started
/// from, there are none, and a short step forward and one back stand for them, hundredths of `first_step` long. At
/// nodes there is no Γ at levels. `drives` as in make_box_scheme().
[[nodiscard]] std::unique_ptr<StepEquation> make_midpoint_equation(
    const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation, const LatticeLevel& first,
    double first_step, const std::shared_ptr<const WallDrives>& drives = nullptr);

/// Of Gauss collocation: steps are taken again, and the residual is what the level after differs from where its step
/// leads, divided by h.
[[nodiscard]] std::unique_ptr<StepEquation> make_gauss_equation(const MultisymplecticSystem& system,
                                                                const grids::Grid& grid, int stages,
                                                                const LatticeLevel& first, SpaceRule space = {});

}  // namespace rubato
