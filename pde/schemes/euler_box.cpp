#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
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
#include <rubato/pde/taken_levels.hpp>
#include <rubato/pde/wall_ghosts.hpp>

namespace rubato {

namespace {

class EulerBoxScheme final : public LatticeScheme {
public:
  EulerBoxScheme(const MultisymplecticSystem& system, const grids::Grid& grid, LatticeLevel first)
      : system_(system),
        grid_(grid),
        map_(system, grid),
        levels_(std::move(first), map_.derived(), map_.found(),
                [this](LatticeLevel& level) { map_.write_derived(level.fields); }),
        energy_(map_.energy(levels_.here().fields)) {
    if (grid.has_ghosts()) {
      ghosts_.emplace(FieldMirrors(system, grid, Collocation::corners), grid);
    }
  }

  [[nodiscard]] const MultisymplecticSystem& system() const override { return system_; }
  [[nodiscard]] const grids::Grid& grid() const override { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const override { return levels_.level(); }

  [[nodiscard]] bool solves_fully() const override { return true; }
  [[nodiscard]] Status advance(double h, double) override {
    const int counted = map_.evaluations();
    levels_.leave();
    const Status status = map_.advance(h, levels_.here().fields, levels_.trial(), energy_of_trial_);
    iterations_ += map_.evaluations() - counted;
    if (status != Status::success) {
      return status;
    }
    slope_ = (energy_of_trial_ - energy_) / h;
    return std::isfinite(slope_) ? Status::success : Status::undefined;
  }

  [[nodiscard]] int order() const override { return 1; }
  /// It reads one level.
  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// Levels are fixed: nothing is solved to it.
  [[nodiscard]] formula::SumSize energy_size() override {
    const double size = std::abs(energy_);
    formula::SumSize found{
        .terms = size, .rounding = std::numeric_limits<double>::epsilon() * size, .magnitudes = size};
    EnergyFloor(system_, grid_).raise(found, levels_.found_here());
    return found;
  }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_; }
  [[nodiscard]] bool has_gamma() const override { return false; }
  [[nodiscard]] NodeEnergy node() override { return {energy_, 0.0}; }
  [[nodiscard]] int iterations() const override { return iterations_; }

  [[nodiscard]] const LatticeLevel* previous() const override {
    return levels_.keeps_previous() ? &levels_.previous() : nullptr;
  }
  void forget_previous() override { levels_.forget_previous(); }
  void accept() override {
    if (ghosts_) {
      ghosts_->renew(map_.found(), levels_.trial());
    }
    levels_.accept();
    energy_ = energy_of_trial_;
    iterations_ = 0;
  }
  void stand(const LatticeLevel& level, const LatticeLevel&, double) override {
    levels_.here().fields.copy_from(level.fields);
    levels_.replace(true);
    begin();
  }
  void save(StateWriter& state) const override { levels_.save(state); }
  void restore(StateReader& state) override {
    levels_.restore(state);
    begin();
  }

private:
  void begin() {
    energy_ = map_.energy(levels_.here().fields);
    iterations_ = 0;
  }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  EulerBoxMap map_;
  TakenLevels levels_;
  std::optional<WallGhosts> ghosts_;
  double energy_, energy_of_trial_ = 0.0;
  double slope_ = 0.0;
  int iterations_ = 0;
};

class EulerBoxEquation final : public StepEquation {
public:
  EulerBoxEquation(const MultisymplecticSystem& system, const grids::Grid& grid)
      : StepEquation(system.field_count(), grid.size()), map_(system, grid, false) {}

  [[nodiscard]] NodeEnergy node(const LatticeLevel& level) override { return {energy(level), 0.0}; }

  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    return measure(before, after, h);
  }

  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    map_.residual(h, before.fields, after.fields, rows_);
    return {energy(before), 0.0, grids::magnitudes(rows().all())};
  }

private:
  [[nodiscard]] double energy(const LatticeLevel& level) { return map_.energy(level.fields); }

  EulerBoxMap map_;
};

class EulerBoxMethod final : public LatticeMethod {
public:
  explicit EulerBoxMethod(bool is_driven) : is_driven_(is_driven) {}

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
  [[nodiscard]] std::optional<Collocation> in_mirror() const override { return Collocation::corners; }
  [[nodiscard]] std::size_t wall_ghosts(const MultisymplecticSystem& system) const override {
    constexpr std::size_t of_laws = 3;
    return is_driven_ ? 0 : std::max(of_laws, EulerBoxMap::lost_at_walls(system));
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

private:
  bool is_driven_;  ///< by walls, which it has not
};

}  // namespace

std::unique_ptr<LatticeScheme> make_euler_box_scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                     LatticeLevel first) {
  return std::make_unique<EulerBoxScheme>(system, grid, std::move(first));
}

LatticeMethodEntry euler_box_method() {
  return {.name = "euler-box",
          .summary = "one-sided differences, explicit; fixed levels only",
          .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<EulerBoxMethod>(choice.drives != nullptr);
          }};
}

}  // namespace rubato
