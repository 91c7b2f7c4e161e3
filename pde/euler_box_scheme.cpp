#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <rubato/pde/euler_box_map.hpp>
#include <rubato/pde/lattice_scheme.hpp>

namespace rubato {

namespace {

class EulerBoxScheme final : public LatticeScheme {
public:
  EulerBoxScheme(const MultisymplecticSystem& system, const grids::Grid& grid, LatticeLevel first)
      : system_(system), grid_(grid), map_(system, grid), level_(std::move(first)), trial_(level_.fields) {}

  [[nodiscard]] const MultisymplecticSystem& system() const override { return system_; }
  [[nodiscard]] const grids::Grid& grid() const override { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const override { return level_; }

  [[nodiscard]] Status advance(double h, double) override {
    const int counted = map_.evaluations();
    const Status status = map_.advance(h, level_.fields, trial_);
    iterations_ += map_.evaluations() - counted;
    if (status != Status::success) {
      return status;
    }
    energy_ = map_.energy(level_.fields);
    slope_ = (map_.energy(trial_) - energy_) / h;
    return std::isfinite(slope_) ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// Levels are fixed: nothing is solved to it.
  [[nodiscard]] formula::SumSize energy_size() override {
    return {.terms = std::abs(energy_), .rounding = std::numeric_limits<double>::epsilon() * std::abs(energy_)};
  }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_; }
  [[nodiscard]] bool has_gamma() const override { return false; }
  [[nodiscard]] LevelNode node() override { return {map_.energy(level_.fields), 0.0}; }
  [[nodiscard]] LevelNode trial_node() override { return {map_.energy(trial_), 0.0}; }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    level_.fields.copy_from(trial_);
    iterations_ = 0;
  }
  void save(StateWriter& state) const override { state.write(level_.fields.all()); }
  void restore(StateReader& state) override {
    state.read(level_.fields.all());
    iterations_ = 0;
  }

private:
  MultisymplecticSystem system_;
  grids::Grid grid_;
  EulerBoxMap map_;
  LatticeLevel level_;
  grids::FieldSet trial_;
  double energy_ = 0.0;
  double slope_ = 0.0;
  int iterations_ = 0;
};

}  // namespace

std::unique_ptr<LatticeScheme> make_euler_box_scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                     LatticeLevel first) {
  return std::make_unique<EulerBoxScheme>(system, grid, std::move(first));
}

}  // namespace rubato
