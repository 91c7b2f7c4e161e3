#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include <rubato/grids/grid.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/local_laws.hpp>
#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/sponge.hpp>
#include <rubato/variation/integrator.hpp>

namespace rubato {

struct LatticeOptions {
  std::string lagrangian = "box";      ///< the scheme: of lattice_methods()
  int stages = 1;                      ///< of Gauss collocation in time, order 2·stages; box and fourier
  int space_stages = 1;                ///< of Gauss collocation in space; box
  std::string composition = "golden";  ///< splitting
  std::string space = "fourier";       ///< splitting: or "differences"
  double start = 0.0;                  ///< t_0
  double step = 0.0;                   ///< t_1 - t_0; negative integrates backward; has to be given
  double until =
      0.0;  ///< the run ends at the first level at or past it; no step is shortened to hit it; has to be given
  Levels levels = Levels::variable;
  std::optional<OnSingular> on_singular = std::nullopt;  ///< this, and the next, as IntegrationOptions has them
  StepPotentialChoice potential = {.kind = StepPotentialChoice::Kind::usual};
  double tolerance = 1e-13;  ///< of the level equation, relative
  std::vector<LinearSymmetry> symmetries = {};
  /// The part of the lattice that this rank has, the grid being the whole; null for all of it. Its reductions are then
  /// those of this thread (grids::Slab::Shared), for as long as the integrator lives.
  const grids::Slab* slab = nullptr;
  bool initial_is_part = false;  ///< the initial fields are of that part, too: LatticeMethod::begins_in_parts()
  std::shared_ptr<const CornerDensity> density = nullptr;  ///< custom: the density of its action
  std::shared_ptr<const SecondLevel> next = nullptr;       ///< custom: a second level, where it is given
  std::shared_ptr<const Sponge> sponge = nullptr;          ///< null without one
  std::shared_ptr<const WallDrives> drives = nullptr;      ///< null where no wall drives a field
  bool keeps_previous = true;  ///< else previous() is not asked for after a step: a copy of the level is saved
  [[nodiscard]] LatticeMethodChoice method() const {
    return {lagrangian, stages, composition, space, space_stages, density, next, drives};
  }
};

/// Steps a lattice, level by level:
///
///     LatticeIntegrator lattice(system, grid, {u, v, std::nullopt}, {.step = 0.1, .until = 20});
///     while (!lattice.finished()) {
///       const StepReport report = lattice.step();
///       if (report.status != Status::success) break;
///       lattice.residuals();   // the local laws of the step just taken
///     }
class LatticeIntegrator final : public Integrator {
public:
  /// \throws std::invalid_argument with the offending values: what initial_level(), the scheme and
  /// check_run_span() refuse (`step` or `until` left out, too), a symmetry that is none
  LatticeIntegrator(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& initial,
                    const LatticeOptions& options);

  /// One step. On success level() is the new level and previous() the one before; otherwise nothing has changed.
  [[nodiscard]] StepReport step() override;
  [[nodiscard]] const LatticeMethod& method() const { return *method_; }
  [[nodiscard]] const LatticeScheme& scheme() const { return *scheme_; }  ///< of S without its constant
  [[nodiscard]] const MultisymplecticSystem& system() const { return system_; }
  [[nodiscard]] const grids::Grid& grid() const { return scheme_->grid(); }

  /// The present level, and the one before it (the same at the start). Of a field with
  /// `system().structure().at_midpoints(f)` a level holds the value in the middle of the step that led to it.
  /// \throws std::logic_error if the level before is asked for and not kept (LatticeOptions::keeps_previous)
  [[nodiscard]] const LatticeLevel& level() const { return scheme_->level(); }
  [[nodiscard]] const LatticeLevel& previous() const;
  [[nodiscard]] std::span<const double> field(int f) const { return level().fields.field(f); }

  /// The energy that a sponge has taken so far; nothing without one.
  [[nodiscard]] std::optional<double> energy_lost() const;
  /// The work that driven walls have done so far; nothing without any.
  [[nodiscard]] std::optional<double> work() const { return scheme_->work(); }

  /// What the user should know about this problem although it can be run, with the remedy: sentences for people. Data
  /// that do not repeat with the period, waves that grow without bound (prepare_initial_level, find_short_wave_growth).
  [[nodiscard]] std::vector<std::string> cautions() const override { return cautions_; }

  /// The local laws; laws().names() names them.
  [[nodiscard]] LocalLaws& laws() { return laws_; }
  /// Their residuals over the step just taken. Sizes, and into `cells[law]`, if given, one value for each cell.
  std::vector<Spread> residuals(std::span<double* const> cells = {});
  /// Σ ΔV of their densities at the present level.
  std::vector<double> totals() { return laws_.totals(level()); }
  /// The same if the laws' residuals were asked for of the last step, and of no other since.
  std::vector<double> totals_after_residuals() { return laws_.totals_after(level()); }

  void save(StateWriter& state) const override;
  void restore(StateReader& state) override;

private:
  std::unique_ptr<LatticeMethod> method_;
  std::vector<std::string> cautions_;
  MultisymplecticSystem system_;
  std::unique_ptr<LatticeScheme> scheme_;
  LocalLaws laws_;
  /// Where the level before is: that is the present one at the start, or it stands in previous_, or the scheme has it.
  enum class Previous { none, here, of_scheme, not_kept };
  mutable Previous where_ = Previous::none;
  bool keeps_previous_;
  mutable LatticeLevel previous_;
  /// What laws were asked of the step before the last one, and of the last.
  LocalLaws::Question of_step_before_ = LocalLaws::none, of_last_step_ = LocalLaws::none;
  /// Of the step under way, what becomes previous_ if it succeeds; none if the scheme keeps it.
  grids::FieldSet before_;
};

}  // namespace rubato
