#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/euler_box_map.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/natural_sizes.hpp>

namespace rubato {

namespace {

class EulerBoxScheme final : public LatticeScheme {
public:
  EulerBoxScheme(const MultisymplecticSystem& system, const grids::Grid& grid, LatticeLevel first)
      : system_(system),
        grid_(grid),
        map_(system, grid),
        level_(std::move(first)),
        trial_(level_.fields),
        previous_(level_),
        here_(map_.at_level(level_.fields)),
        there_(here_) {}

  [[nodiscard]] const MultisymplecticSystem& system() const override { return system_; }
  [[nodiscard]] const grids::Grid& grid() const override { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const override { return level_; }

  [[nodiscard]] bool solves_fully() const override { return true; }
  [[nodiscard]] Status advance(double h, double) override {
    const int counted = map_.evaluations();
    const Status status = map_.advance(h, level_.fields, here_, trial_);
    iterations_ += map_.evaluations() - counted;
    if (status != Status::success) {
      return status;
    }
    map_.find(trial_, there_);
    slope_ = (there_.energy - here_.energy) / h;
    return std::isfinite(slope_) ? Status::success : Status::undefined;
  }

  [[nodiscard]] int order() const override { return 1; }
  /// It reads one level.
  [[nodiscard]] double discrete_energy() const override { return here_.energy; }
  /// Levels are fixed: nothing is solved to it.
  [[nodiscard]] formula::SumSize energy_size() override {
    const double size = std::abs(here_.energy);
    formula::SumSize found{
        .terms = size, .rounding = std::numeric_limits<double>::epsilon() * size, .magnitudes = size};
    EnergyFloor(system_, grid_).raise(found, std::as_const(level_.fields).pointers());
    return found;
  }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_; }
  [[nodiscard]] bool has_gamma() const override { return false; }
  [[nodiscard]] NodeEnergy node() override { return {here_.energy, 0.0}; }
  [[nodiscard]] int iterations() const override { return iterations_; }

  [[nodiscard]] const LatticeLevel* previous() const override { return &previous_; }
  void accept() override {
    std::swap(level_.fields, trial_);
    std::swap(previous_.fields, trial_);
    std::swap(here_, there_);
    iterations_ = 0;
  }
  void stand(const LatticeLevel& level, const LatticeLevel&, double) override {
    level_.fields.copy_from(level.fields);
    map_.find(level_.fields, here_);
    iterations_ = 0;
  }
  void save(StateWriter& state) const override {
    grids::save_whole(state, level_.fields);
    grids::save_whole(state, previous_.fields);
  }
  void restore(StateReader& state) override {
    grids::restore_whole(state, level_.fields);
    grids::restore_whole(state, previous_.fields);
    map_.find(level_.fields, here_);
    iterations_ = 0;
  }

private:
  MultisymplecticSystem system_;
  grids::Grid grid_;
  EulerBoxMap map_;
  LatticeLevel level_;
  grids::FieldSet trial_;
  LatticeLevel previous_;
  EulerBoxMap::AtLevel here_, there_;  ///< of the present level and of the trial one
  double slope_ = 0.0;
  int iterations_ = 0;
};

class EulerBoxEquation final : public StepEquation {
public:
  EulerBoxEquation(const MultisymplecticSystem& system, const grids::Grid& grid)
      : StepEquation(system.field_count(), grid.size()), map_(system, grid), at_level_(map_.room()) {}

  [[nodiscard]] NodeEnergy node(const LatticeLevel& level) override { return {energy(level), 0.0}; }

  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    return measure(before, after, h);
  }

  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    map_.residual(h, before.fields, after.fields, rows_);
    return {energy(before), 0.0, grids::magnitudes(rows().all())};
  }

private:
  [[nodiscard]] double energy(const LatticeLevel& level) {
    map_.find(level.fields, at_level_);
    return at_level_.energy;
  }

  EulerBoxMap map_;
  EulerBoxMap::AtLevel at_level_;
};

class EulerBoxMethod final : public LatticeMethod {
public:
  [[nodiscard]] int order() const override { return 1; }
  [[nodiscard]] std::string_view fixed_levels_only() const override {
    return "its discrete energy reads one level, so that the equation for the next step is singular at every turning "
           "point and on every travelling wave, and with varying levels it drops to first order";
  }
  [[nodiscard]] bool has_midpoints(const MultisymplecticSystem& /*system*/) const override { return false; }
  /// Laws read the currents of a neighbour, which reads its own; energies read one neighbour.
  [[nodiscard]] grids::Ghosts ghosts(const MultisymplecticSystem& system) const override {
    const EulerBoxMap::Halo halo = EulerBoxMap::halo(system);
    const std::size_t planes = 2 + std::max(halo.planes, halo.lost);
    return {planes, planes};
  }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return euler_box_action(system);
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    return prepare_initial_level(system, grid, given, Collocation::corners);
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return make_constrained_fields(system, grid, Collocation::corners);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double) const override {
    return make_euler_box_scheme(system, grid, std::move(first));
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    return make_euler_box_laws(std::move(tables));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel&, double) const override {
    return std::make_unique<EulerBoxEquation>(system, grid);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem& system,
                                                      const grids::Grid& grid) const override {
    return make_euler_box_tangents(system, grid);
  }
};

}  // namespace

std::unique_ptr<LatticeScheme> make_euler_box_scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                     LatticeLevel first) {
  return std::make_unique<EulerBoxScheme>(system, grid, std::move(first));
}

LatticeMethodEntry euler_box_method() {
  return {.name = "euler-box",
          .summary = "one-sided differences, explicit; fixed levels only",
          .make = [](const LatticeMethodChoice&) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<EulerBoxMethod>();
          }};
}

}  // namespace rubato
