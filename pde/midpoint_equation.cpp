#include <rubato/pde/step_equation.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/level_fields.hpp>
#include <rubato/pde/level_history.hpp>
#include <rubato/pde/wall_conditions.hpp>

namespace rubato {

namespace {

class MidpointEquation final : public StepEquation {
public:
  MidpointEquation(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
                   const LatticeLevel& first, double first_step, const std::shared_ptr<const WallDrives>& drives)
      : StepEquation(system.field_count(), grid.size()),
        system_(system),
        at_midpoints_(system.structure().at_midpoints()),
        sweep_(system, grid, collocation),
        point_(rows_),
        delta_(rows_) {
    if (collocation == Collocation::cells) {
      history_.emplace(first_step == 0.0 ? LevelHistory(at_midpoints_, grid.size())
                                         : box_start(system, grid, first, first_step, drives));
    }
    if (grid.has_walls()) {
      walls_.emplace(system, grid, drives);
    }
  }

  [[nodiscard]] NodeEnergy node(const LatticeLevel& level) override {
    copy_level(level.fields, at_midpoints_, point_);
    if (history_) {
      history_->velocity(delta_);
    }
    const SweepResult result = sweep(level.slopes, 0.0, {});
    return {result.energy, history_ ? -result.quadratic : std::numeric_limits<double>::quiet_NaN()};
  }

  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    const StepLaw law = measure(before, after, h);
    if (history_) {
      history_->increment().copy_from(delta_);
      history_->record(0.5 * h, h);
      history_->advance(h);
    }
    return law;
  }

  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    set_increment(before.fields, after.fields, delta_);
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto z_0 = before.fields.field(f);
      const auto z_1 = after.fields.field(f);
      const auto middle = point_.field(f);
      for (std::size_t i = 0; i < middle.size(); ++i) {
        middle[i] = is_at_midpoints(f) ? z_1[i] : 0.5 * (z_0[i] + z_1[i]);
      }
    }
    const SweepResult result = sweep(after.slopes, 1.0 / h, rows_.pointers());
    if (walls_) {
      put_conditions(h);
    }
    const double work = walls_ ? walls_->work(point_, delta_) : 0.0;
    return {result.energy - 0.5 * work, -result.quadratic / (h * h), grids::magnitudes(rows().all()), work};
  }

private:
  [[nodiscard]] bool is_at_midpoints(int field) const { return at_midpoints_[static_cast<std::size_t>(field)]; }

  /// At point_, with the rates in delta_ but for fields at midpoints, which have none.
  SweepResult sweep(const PotentialSlopes& slopes, double inverse_h, std::span<double* const> residual) {
    const auto all = std::as_const(delta_).pointers();
    std::array<const double*, MultisymplecticSystem::most_fields> of_fields{};
    for (std::size_t f = 0; f < all.size(); ++f) {
      of_fields[f] = at_midpoints_[f] ? nullptr : all[f];
    }
    const auto rates = std::span<const double* const>(of_fields).first(all.size());
    SweepResult result = sweep_(std::as_const(point_).pointers(), slopes, rates, inverse_h, residual, {});
    if (!result.finite) {
      result.energy = std::numeric_limits<double>::quiet_NaN();
    }
    return result;
  }

  /// Into the rows of the last node's cell, which is none: the rates of what walls hold.
  void put_conditions(double h) {
    const std::size_t last = rows_.size() - 1;
    for (int f = 0; f < system_.field_count(); ++f) {
      rows_.field(f)[last] = 0.0;
    }
    for (const auto& [field, node] : walls_->held()) {
      if (walls_->drives(field, node)) {
        continue;  // what a wall gives is seen by the levels
      }
      double& row = rows_.field(field)[last];
      row = std::max(row, std::abs(delta_.field(field)[node] / h));
    }
  }

  /// δ; of fields at midpoints twice the value, as LevelHistory has it.
  void set_increment(const grids::FieldSet& before, const grids::FieldSet& after, grids::FieldSet& delta) const {
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto z_0 = before.field(f);
      const auto z_1 = after.field(f);
      const auto out = delta.field(f);
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = is_at_midpoints(f) ? 2.0 * z_1[i] : z_1[i] - z_0[i];
      }
    }
  }

  const MultisymplecticSystem& system_;
  std::vector<bool> at_midpoints_;
  CellSweep sweep_;
  std::optional<WallConditions> walls_;
  grids::FieldSet point_, delta_;
  std::optional<LevelHistory> history_;  ///< of the box
};

}  // namespace

std::unique_ptr<StepEquation> make_midpoint_equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                     Collocation collocation, const LatticeLevel& first,
                                                     double first_step,
                                                     const std::shared_ptr<const WallDrives>& drives) {
  return std::make_unique<MidpointEquation>(system, grid, collocation, first, first_step, drives);
}

}  // namespace rubato
