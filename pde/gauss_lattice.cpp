#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/gauss_slab.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/step_equation.hpp>

namespace rubato {

namespace {

constexpr std::size_t piece = 4096;
/// E_k is told from its neighbours by terms of order h^s: a trial that is not the last is solved nearly as well.
constexpr double loosest = 1e-13;
/// A step this many times longer or shorter than the last one is not begun from its stages.
constexpr double longest_continuation = 3.0;
/// Levels for which the size of the energy's terms serves.
constexpr int size_period = 16;
/// A sum over stages, each with transforms of its own, rounds more than one sweep over the cells of a level.
constexpr double stage_rounding = 4.0;
constexpr std::uint64_t nowhere = std::numeric_limits<std::uint64_t>::max();

class GaussLattice final : public LatticeScheme {
public:
  GaussLattice(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, LatticeLevel first)
      : system_(system),
        grid_(grid),
        level_(std::move(first)),
        low_(system.field_count(), grid.size()),
        delta_(low_),
        point_(low_),
        slab_(std::make_shared<GaussSlab>(system, grid, stages, level_)),
        sweep_(system, grid, Placement::nodes),
        largest_(static_cast<std::size_t>(system.field_count()), 0.0),
        stages_(stages) {
    if (!std::isfinite(energy_of_level())) {
      throw std::invalid_argument("S is not finite at the initial level");
    }
    terms_at_start_ = sweep_.mean_terms(std::as_const(point_).pointers(), level_.slopes);
    last_rests_ = slab_->rests();
  }

  [[nodiscard]] const MultisymplecticSystem& system() const override { return system_; }
  [[nodiscard]] const grids::Grid& grid() const override { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const override { return level_; }
  [[nodiscard]] std::shared_ptr<StageSource> stages() override { return slab_; }

  [[nodiscard]] int order() const override { return 2 * stages_; }
  [[nodiscard]] bool has_node_law() const override { return false; }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    if (slab_->stamp() != stamp_) {
      slab_->stand(level_.fields, &low_, level_.slopes);
      stamp_ = slab_->stamp();
      trial_h_ = 0.0;
    }
    const int counted = slab_->iterations();
    bool continued = true;
    if (trial_h_ != 0.0 && near(h / trial_h_)) {
      slab_->continue_from(slab_->rests(), h / trial_h_, false);
    } else if (last_h_ != 0.0 && near(h / last_h_)) {
      slab_->continue_from(last_rests_, h / last_h_, true);
    } else {
      slab_->begin_at_level();
      continued = false;
    }
    Status status = slab_->solve(h, std::min(accuracy, loosest), largest_);
    if (status != Status::success && continued) {
      slab_->begin_at_level();
      status = slab_->solve(h, std::min(accuracy, loosest), largest_);
    }
    iterations_ += slab_->iterations() - counted;
    trial_h_ = status == Status::success ? h : 0.0;
    if (status == Status::success) {
      energy_ = slab_->energy();
      end_known_ = false;
      return std::isfinite(energy_) ? Status::success : Status::undefined;
    }
    return status;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// By the node laws at both ends of the step, E - H = (s+1) h^s η + O(h^(s+1)) with signs that agree (theory, section
  /// 8).
  [[nodiscard]] double discrete_energy_slope() const override {
    return order() * (energy_ - 0.5 * (energy_here() + energy_there())) / trial_h_;
  }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] int iterations() const override { return iterations_; }
  [[nodiscard]] formula::SumSize energy_size() override {
    if (size_age_ >= size_period) {
      make_point();
      size_of_energy_ = sweep_.energy_size(std::as_const(point_).pointers(), level_.slopes, terms_at_start_);
      size_of_energy_.rounding *= stage_rounding;
      size_age_ = 0;
    }
    return size_of_energy_;
  }

  [[nodiscard]] LevelNode node() override { return {energy_here(), std::numeric_limits<double>::quiet_NaN()}; }
  [[nodiscard]] LevelNode trial_node() override { return {energy_there(), std::numeric_limits<double>::quiet_NaN()}; }

  void accept() override {
    slab_->increment(delta_);
    last_rests_ = slab_->rests();
    last_h_ = trial_h_;
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto i = static_cast<std::size_t>(f);
      double* high = level_.fields.field(f).data();
      double* low = low_.field(f).data();
      const double* delta = delta_.field(f).data();
      largest_[i] = std::max(largest_[i], grids::max_abs(std::as_const(delta_).field(f)));
      grids::for_each_block(grid_.size(), piece, [=, this](std::size_t begin, std::size_t end) {
        const bool midpoint = system_.structure().at_midpoints(static_cast<int>(i));
        for (std::size_t n = begin; n < end; ++n) {
          if (midpoint) {
            high[n] = 0.5 * delta[n];
            continue;
          }
          const double rest = low[n] + delta[n];
          const double sum = high[n] + rest;
          low[n] = rest - (sum - high[n]);
          high[n] = sum;
        }
      });
    }
    ++size_age_;
    start_level();
  }

  void save(StateWriter& state) const override {
    state.write(level_.fields.all());
    state.write(low_.all());
    state.write(largest_);
    for (const auto& slope : level_.slopes.of_field) {
      state.write(slope);
    }
    state.write(last_rests_.re.all());
    state.write(last_rests_.im.all());
    for (const double value :
         {last_h_, size_of_energy_.terms, size_of_energy_.rounding, static_cast<double>(size_age_)}) {
      state.write(value);
    }
    slab_->save(state);
  }
  void restore(StateReader& state) override {
    state.read(level_.fields.all());
    state.read(low_.all());
    state.read(std::span<double>(largest_));
    for (auto& slope : level_.slopes.of_field) {
      state.read(std::span<double>(slope));
    }
    state.read(last_rests_.re.all());
    state.read(last_rests_.im.all());
    state.read(last_h_);
    state.read(size_of_energy_.terms);
    state.read(size_of_energy_.rounding);
    state.read(size_age_);
    slab_->restore(state);
    start_level();
  }

private:
  [[nodiscard]] static bool near(double ratio) {
    return ratio > 1.0 / longest_continuation && ratio < longest_continuation;
  }
  void start_level() {
    stamp_ = nowhere;
    trial_h_ = 0.0;
    here_known_ = end_known_ = false;
    iterations_ = 0;
  }
  /// The level without the fields that it does not have.
  void make_point() const {
    point_.copy_from(level_.fields);
    for (int f = 0; f < system_.field_count(); ++f) {
      if (system_.structure().at_midpoints(f)) {
        std::ranges::fill(point_.field(f), 0.0);
      }
    }
  }
  double energy_of_level() const {
    make_point();
    return sweep_(std::as_const(point_).pointers(), level_.slopes, {}, 0.0, {}, {}).energy;
  }
  [[nodiscard]] double energy_here() const {
    if (!std::exchange(here_known_, true)) {
      here_ = energy_of_level();
    }
    return here_;
  }
  [[nodiscard]] double energy_there() const {
    if (!std::exchange(end_known_, true)) {
      there_ = slab_->energy_at_end();
    }
    return there_;
  }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  LatticeLevel level_;
  grids::FieldSet low_;  ///< the fields are level_.fields + low_
  grids::FieldSet delta_;
  mutable grids::FieldSet point_;
  std::shared_ptr<GaussSlab> slab_;
  mutable CellSweep sweep_;
  std::vector<double> largest_;  ///< of |δ| of each field so far
  int stages_;
  WaveRows last_rests_;  ///< of the last step's stages
  double last_h_ = 0.0;
  std::uint64_t stamp_ = nowhere;  ///< of the slab, where it stands at this level
  double trial_h_ = 0.0;  ///< 0: no trial of this level
  double energy_ = 0.0;
  mutable double here_ = 0.0, there_ = 0.0;
  mutable bool here_known_ = false, end_known_ = false;
  int iterations_ = 0;
  std::vector<double> terms_at_start_;
  formula::SumSize size_of_energy_;
  int size_age_ = size_period;
};

/// The step taken again, and what the level that is there differs from where it leads, in units of a rate.
class GaussEquation final : public StepEquation {
public:
  GaussEquation(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, const LatticeLevel& first)
      : system_(system),
        sweep_(system, grid, Placement::nodes),
        slab_(system, grid, stages, first),
        delta_(system.field_count(), grid.size()) {}

  [[nodiscard]] LevelNode node(const LatticeLevel& level) override {
    delta_.copy_from(level.fields);
    for (int f = 0; f < system_.field_count(); ++f) {
      if (system_.structure().at_midpoints(f)) {
        std::ranges::fill(delta_.field(f), 0.0);
      }
    }
    const SweepResult result = sweep_(std::as_const(delta_).pointers(), level.slopes, {}, 0.0, {}, {});
    return {result.finite ? result.energy : std::numeric_limits<double>::quiet_NaN(),
            std::numeric_limits<double>::quiet_NaN()};
  }
  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    return measure(before, after, h);
  }
  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    StepLaw law{.energy = std::numeric_limits<double>::quiet_NaN(), .gamma = std::numeric_limits<double>::quiet_NaN()};
    if (slab_.take(before, after, h) != Status::success) {
      delta_.fill(std::numeric_limits<double>::quiet_NaN());
      law.residual = grids::magnitudes(std::as_const(delta_).all());
      return law;
    }
    law.energy = slab_.energy();
    slab_.increment(delta_);
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto z_0 = before.fields.field(f), z_1 = after.fields.field(f);
      const auto out = delta_.field(f);
      const bool midpoint = system_.structure().at_midpoints(f);
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = midpoint ? (z_1[i] - 0.5 * out[i]) / h : (z_1[i] - z_0[i] - out[i]) / h;
      }
    }
    law.residual = grids::magnitudes(std::as_const(delta_).all());
    return law;
  }

private:
  const MultisymplecticSystem& system_;
  CellSweep sweep_;
  GaussSlab slab_;
  grids::FieldSet delta_;
};

}  // namespace

std::unique_ptr<LatticeScheme> make_gauss_lattice(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                  int stages, LatticeLevel first) {
  if (system.directions() != grid.dimensions()) {
    throw std::invalid_argument(
        fmt::format("the system has {} space direction(s), the grid {}", system.directions(), grid.dimensions()));
  }
  return std::make_unique<GaussLattice>(system, grid, stages, std::move(first));
}

std::unique_ptr<StepEquation> make_gauss_equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                  int stages, const LatticeLevel& first) {
  return std::make_unique<GaussEquation>(system, grid, stages, first);
}

}  // namespace rubato
