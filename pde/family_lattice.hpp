#pragma once

#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include <rubato/grids/slab.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/corner_energy.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/level_fields.hpp>
#include <rubato/pde/natural_sizes.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/step_equation.hpp>

namespace rubato {

/// What families of symplectic maps on lattices with their equation at the nodes share (theory, section 8): the level,
/// what is read of the energy there, and the slope of the discrete energy. They have no node law in closed form.
class FamilyLattice : public LatticeScheme {
public:
  [[nodiscard]] const MultisymplecticSystem& system() const final { return system_; }
  [[nodiscard]] const grids::Grid& grid() const final { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const final {
    append_level();
    return level_;
  }
  [[nodiscard]] bool has_node_law() const final { return false; }

  [[nodiscard]] double discrete_energy() const final { return energy_; }
  /// By the node laws at both ends of the step, E - H = (s+1) h^s η + O(h^(s+1)) with signs that agree (theory, section
  /// 8): s (E - (H(z_k) + H(z_{k+1}))/2)/h.
  [[nodiscard]] double discrete_energy_slope() const final {
    return order() * (energy_ - 0.5 * (energy_here() + energy_there())) / trial_h_;
  }
  [[nodiscard]] bool slope_to_leading_order() const final { return true; }
  [[nodiscard]] int iterations() const final { return iterations_; }
  [[nodiscard]] formula::SumSize energy_size() final {
    size_is_short_ = size_is_short_ || size_age_ > 0;
    return size_of_energy_;
  }

  [[nodiscard]] NodeEnergy node() final { return {energy_here(), std::numeric_limits<double>::quiet_NaN()}; }

protected:
  /// \throws std::invalid_argument if S is not finite at the first level
  FamilyLattice(const MultisymplecticSystem& system, const grids::Grid& grid, LatticeLevel first,
                Collocation collocation = Collocation::nodes)
      : system_(system),
        grid_(grid),
        level_(std::move(first)),
        at_midpoints_(system.structure().at_midpoints()),
        zeros_(1, grid.size()),
        sweep_(system, grid, collocation) {
    const auto point = point_of(level_.fields);
    if (!sweep_(point, level_.slopes, {}, 0.0, {}, {}).finite) {
      throw std::invalid_argument("S is not finite at the initial level");
    }
    terms_at_start_ = sweep_.mean_terms(point, level_.slopes);
    take_energy_size();
    if (collocation == Collocation::corners) {
      at_corners_.emplace(system, grid);
    }
  }

  /// 𝓔 of the trial level.
  [[nodiscard]] virtual double energy_at_end() const = 0;
  /// 𝓔 of the present one.
  [[nodiscard]] virtual double energy_at_start() const { return energy_of(level_.fields); }
  /// Gives the memory of level_ back: append_level() fills it again.
  void forget_level() {
    for (int f = 0; f < level_.fields.fields(); ++f) {
      level_.fields.forget(f);
    }
  }
  /// Fills level_ if it is not yet what the scheme stands at.
  virtual void append_level() const {}

  /// 𝓔 of the fields of a level.
  [[nodiscard]] double energy_of(const grids::FieldSet& fields) const {
    if (at_corners_) {
      return (*at_corners_)(fields, level_.slopes);
    }
    const double energy = sweep_(point_of(fields), level_.slopes, {}, 0.0, {}, {}).energy;
    sweep_.give_back();
    return energy;
  }

  /// After a trial that succeeded.
  void set_trial(double h, double energy) {
    trial_h_ = h;
    energy_ = energy;
    there_.reset();
  }
  void forget_trial() { trial_h_ = 0.0; }
  [[nodiscard]] double trial_h() const { return trial_h_; }  ///< 0: no trial of this level
  void count_iterations(int count) { iterations_ += count; }
  /// After the trial level has become the present one: what was read of the energy there is known.
  void move() {
    const auto known = there_;
    start_level();
    here_ = known;
  }
  /// After the level has changed.
  void start_level() {
    trial_h_ = 0.0;
    here_.reset();
    there_.reset();
    iterations_ = 0;
  }
  /// After move(): takes the size of the energy where it is due, so that no trial is in memory beside what it needs.
  void grow_older() {
    if (++size_age_ >= static_cast<int>(size_is_short_ ? tuning::size_period : energy_size_period())) {
      take_energy_size();
    }
  }

  void save_level(StateWriter& state) const {
    append_level();
    grids::save_whole(state, level_.fields);
    save_slopes(state, level_.slopes, grid_);
    state.write(std::array{size_of_energy_.terms, size_of_energy_.rounding, size_of_energy_.cancelled,
                           static_cast<double>(size_age_), size_is_short_ ? 1.0 : 0.0, here_ ? 1.0 : 0.0,
                           here_.value_or(0.0)});
  }
  void restore_level(StateReader& state) {
    grids::restore_whole(state, level_.fields);
    restore_slopes(state, level_.slopes, grid_);
    state.read(size_of_energy_.terms);
    state.read(size_of_energy_.rounding);
    state.read(size_of_energy_.cancelled);
    state.read(size_age_);
    state.read(size_is_short_);
    start_level();
    const bool is_known = state.read() != 0.0;
    if (const double here = state.read(); is_known) {
      here_ = here;
    }
  }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  mutable LatticeLevel level_;  ///< see append_level()
  std::vector<bool> at_midpoints_;

private:
  /// A sum over stages, each with transforms of its own, rounds more than one sweep over the cells of a level.
  static constexpr double stage_rounding = 4.0;

  /// Without the fields that a level does not have.
  [[nodiscard]] std::span<const double* const> point_of(const grids::FieldSet& fields) const {
    point_.assign(fields.pointers().begin(), fields.pointers().end());
    for (std::size_t f = 0; f < point_.size(); ++f) {
      if (at_midpoints_[f]) {
        point_[f] = std::as_const(zeros_).field(0).data();
      }
    }
    return point_;
  }
  void take_energy_size() {
    append_level();
    size_of_energy_ = sweep_.energy_size(point_of(level_.fields), level_.slopes, terms_at_start_);
    size_of_energy_.rounding *= stage_rounding;
    EnergyFloor(system_, grid_).raise(size_of_energy_, point_);
    sweep_.give_back();
    size_age_ = 0;
    size_is_short_ = false;
  }
  [[nodiscard]] double energy_here() const {
    if (!here_) {
      here_ = energy_at_start();
    }
    return *here_;
  }
  [[nodiscard]] double energy_there() const {
    if (!there_) {
      there_ = energy_at_end();
    }
    return *there_;
  }

  grids::FieldSet zeros_;
  mutable std::vector<const double*> point_;
  mutable CellSweep sweep_;
  mutable std::optional<CornerEnergy> at_corners_;  ///< in place of a sweep
  double trial_h_ = 0.0;
  double energy_ = 0.0;
  mutable std::optional<double> here_, there_;
  int iterations_ = 0;
  std::vector<double> terms_at_start_;
  formula::SumSize size_of_energy_;
  int size_age_ = 0;            ///< levels since it was taken
  bool size_is_short_ = false;  ///< it has been asked for since: it serves for a few levels alone
};

/// What the equations of families share: a step is taken again, and compared with the level that is there.
class FamilyEquation : public StepEquation {
public:
  [[nodiscard]] NodeEnergy node(const LatticeLevel& level) final {
    copy_level(level.fields, at_midpoints_, point_);
    const SweepResult result = sweep_(std::as_const(point_).pointers(), level.slopes, {}, 0.0, {}, {});
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    return {result.finite ? result.energy : none, none};
  }
  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) final {
    return measure(before, after, h);
  }

protected:
  FamilyEquation(const MultisymplecticSystem& system, const grids::Grid& grid,
                 Collocation collocation = Collocation::nodes)
      : StepEquation(system.field_count(), grid.size()),
        system_(system),
        at_midpoints_(system.structure().at_midpoints()),
        sweep_(system, grid, collocation),
        point_(rows_) {}

  /// Of a step that cannot be taken again, and of which there is no Γ.
  [[nodiscard]] static StepLaw unknown() {
    StepLaw law;
    law.energy = law.gamma = std::numeric_limits<double>::quiet_NaN();
    return law;
  }

  MultisymplecticSystem system_;

private:
  std::vector<bool> at_midpoints_;
  CellSweep sweep_;
  grids::FieldSet point_;
};

}  // namespace rubato
