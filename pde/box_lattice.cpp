#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/larger.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/kernel_conditions.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/level_fields.hpp>
#include <rubato/pde/level_history.hpp>
#include <rubato/pde/natural_sizes.hpp>
#include <rubato/pde/newton_contraction.hpp>
#include <rubato/pde/row_rounding.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/static_condensation.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/pde/wall_conditions.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::box_lattice;
using namespace tuning::box_start;

void check(const MultisymplecticSystem& system, const grids::Grid& grid, const LatticeLevel& first) {
  if (system.directions() != grid.dimensions()) {
    throw std::invalid_argument(
        fmt::format("the system has {} space direction(s), the grid {}", system.directions(), grid.dimensions()));
  }
  for (int a = 0; a < grid.dimensions(); ++a) {
    if (!grid.has_walls() && grids::whole_of(grid).cells(a) % 2 == 0) {
      throw std::invalid_argument(
          fmt::format("box needs an odd number of cells in every direction, and {} has {}: with an even one the "
                      "average of neighbours annihilates the sawtooth (-1)^i, which the scheme then cannot determine; "
                      "take {} cells",
                      grid.axis(a).name, grids::whole_of(grid).cells(a), grids::whole_of(grid).cells(a) + 1));
    }
  }
  if (first.fields.fields() != system.field_count() || first.fields.size() != grid.size()) {
    throw std::invalid_argument(fmt::format("the first level has {} fields of {} values; {} of {} are needed",
                                            first.fields.fields(), first.fields.size(), system.field_count(),
                                            grid.size()));
  }
}

/// \throws SchemeRefusal where potentials that are held in the mean of every line would have to be held on
/// waves across it: the Krylov solver's conditions are real, and these turn with the rate of each wave.
void check_waves_of_kernel(const MultisymplecticSystem& system, const grids::Grid& grid, double h) {
  const KernelConditions conditions = step_conditions(system, h);
  const KernelWaves waves(system.M(), conditions.kernel);
  for (int a = 0; a < system.directions() && system.directions() > 1 && conditions.count() > 0; ++a) {
    const Eigen::MatrixXcd K = system.K(a).cast<std::complex<double>>();
    if (waves.has(K) && !solve::annihilates(K, conditions.kernel.cast<std::complex<double>>())) {
      throw SchemeRefusal(fmt::format(
          "box cannot hold the potential of this equation in a frame that moves along {}; write lagrangian = "
          "\"fourier\", or leave that component of the velocity out",
          grid.axis(a).name));
    }
  }
}

/// What conditions hold are potentials that other fields' rows are made of.
StaticCondensation condensation_of(const MultisymplecticSystem& system, const KernelConditions& conditions) {
  return conditions.count() > 0 ? StaticCondensation(system, nullptr) : StaticCondensation(system);
}

class BoxLattice final : public LatticeScheme {
public:
  BoxLattice(const MultisymplecticSystem& system, const grids::Grid& grid, LatticeLevel first, double first_step,
             const std::shared_ptr<const WallDrives>& drives)
      : system_(system),
        grid_(grid),
        level_(std::move(first)),
        at_midpoints_(system.structure().at_midpoints()),
        sweep_(system, grid, Collocation::cells),
        row_rounding_(system, grid),
        low_(system.field_count(), grid.size()),
        point_(system.field_count(), grid.size()),  // no copies: those write, and take memory
        residual_(system.field_count(), grid.size()),
        hessian_(static_cast<int>(system.varying_hessian().size()), grid.size()),
        history_(at_midpoints_, grid.size()),
        largest_(at_midpoints_.size(), 0.0),
        level_sizes_(at_midpoints_.size(), -1.0),
        start_step_(start_ratio * first_step),
        conditions_(step_conditions(system, first_step)),
        change_known_(conditions_.count() == 0 && std::ranges::find(at_midpoints_, true) == at_midpoints_.end()),
        border_(static_cast<std::size_t>(conditions_.count()) * (grid.size() / grid.cells(0))),
        condensation_(condensation_of(system, conditions_)) {
    for (int a = 0; a < system.directions(); ++a) {
      matrix_.difference.push_back(condensation_.restricted(system.K(a)));
    }
    for (const int f : condensation_.free()) {
      free_residual_.push_back(std::as_const(residual_).field(f).data());
      free_correction_.push_back(point_.field(f).data());
    }
    for (std::size_t e = 0; e < system.varying_hessian().size(); ++e) {
      const int row = condensation_.place(system.varying_hessian()[e].row);
      const int column = condensation_.place(system.varying_hessian()[e].column);
      const double* values = hessian_.field(static_cast<int>(e)).data();
      matrix_.entries.push_back({row, column, -1.0, values});
      if (row != column) {
        matrix_.entries.push_back({column, row, -1.0, values});
      }
    }
    if (grid.has_walls()) {
      walls_.emplace(system, grid, drives);
      start_ = walls_->drives() ? walls_->start() : 0.0;
      change_known_ = change_known_ && !walls_->drives();  // whose work changes the energy, too
    }
    if (!level_sweep({}).finite) {
      throw std::invalid_argument("S is not finite at the initial level");
    }
    const grids::FieldSet& fields = level_.fields;
    terms_at_start_ = sweep_.mean_terms(fields.pointers(), level_.slopes);
  }

  [[nodiscard]] const MultisymplecticSystem& system() const override { return system_; }
  [[nodiscard]] const grids::Grid& grid() const override { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const override { return level_; }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    if (!std::isfinite(h)) {
      return Status::undefined;
    }
    find_start_velocity();
    if (trial_h_ == 0.0) {
      history_.predict(h);
    } else {
      history_.shift(trial_h_, h);
    }
    const Status status = solve(h, accuracy, trial_h_ == 0.0 ? 1.0 : std::abs(h - trial_h_) / std::abs(h));
    trial_h_ = status == Status::success ? h : 0.0;
    return status;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// It changes slowly, and costs more than a sweep: taken anew now and then.
  [[nodiscard]] formula::SumSize energy_size() override {
    if (size_age_ >= tuning::size_period) {
      make_point(trial_h_ == 0.0 ? 0.0 : 0.5);
      const grids::FieldSet& point = point_;
      size_of_energy_ = sweep_.energy_size(point.pointers(), level_.slopes, terms_at_start_);
      EnergyFloor(system_, grid_).raise(size_of_energy_, point.pointers());
      size_age_ = 0;
    }
    return size_of_energy_;
  }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_; }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] int iterations() const override { return iterations_; }
  [[nodiscard]] std::optional<double> work() const override {
    return is_driven() ? std::optional(work_) : std::nullopt;
  }

  [[nodiscard]] NodeEnergy node() override {
    if (!node_known_) {
      find_start_velocity();
      history_.velocity(point_);
      node_ = level_node(point_);
      node_known_ = true;
    }
    return node_;
  }

  /// The rates at the start, if they can be found.
  [[nodiscard]] LevelHistory start() {
    find_start_velocity();
    return std::move(history_);
  }

  void accept() override {
    contraction_.advance();
    ++size_age_;
    std::array<std::span<const double>, MultisymplecticSystem::most_fields> rows;
    std::array<double, MultisymplecticSystem::most_fields> sizes;
    for (std::size_t f = 0; f < largest_.size(); ++f) {
      rows[f] = std::as_const(delta()).field(static_cast<int>(f));
    }
    grids::max_abs(std::span(rows).first(largest_.size()), std::span(sizes).first(largest_.size()));
    for (std::size_t f = 0; f < largest_.size(); ++f) {
      largest_[f] = std::max(largest_[f], sizes[f]);
      const int field = static_cast<int>(f);
      add_increment(rows[f], at_midpoints_[f], level_.fields.field(field), low_.field(field));
    }
    history_.record(0.5 * trial_h_, trial_h_);
    history_.advance(trial_h_);
    work_ += work_of_step_;
    ++steps_;
    start_level();
  }

  void stand(const LatticeLevel& level, const LatticeLevel& next, double h) override {
    level_.fields.copy_from(level.fields);
    low_.fill(0.0);
    history_.forget();
    contraction_ = NewtonContraction();
    start_tried_ = true;
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto z_0 = level.fields.field(f), z_1 = next.fields.field(f);
      const auto change = delta().field(f);
      const bool midpoint = at_midpoints_[static_cast<std::size_t>(f)];
      for (std::size_t n = 0; n < change.size(); ++n) {
        change[n] = midpoint ? 2.0 * z_1[n] : z_1[n] - z_0[n];
      }
      largest_[static_cast<std::size_t>(f)] = grids::max_abs(std::as_const(delta()).field(f));
    }
    history_.record(0.5 * h, h);
    start_level();
  }

  void set_time(double t) override {
    start_ = t;
    steps_ = 0.0;
  }

  void correct(const grids::FieldSet& fields) override {
    level_.fields.copy_from(fields);
    low_.fill(0.0);
  }

  void save(StateWriter& state) const override {
    grids::save_whole(state, level_.fields);
    grids::save_whole(state, low_);
    state.write(largest_);
    save_slopes(state, level_.slopes, grid_);
    history_.save(state);
    contraction_.save(state);
    for (const double value :
         {size_of_energy_.terms, size_of_energy_.rounding, size_of_energy_.cancelled, static_cast<double>(size_age_)}) {
      state.write(value);
    }
    if (is_driven()) {
      state.write(std::array{work_, steps_});
    }
  }

  void restore(StateReader& state) override {
    grids::restore_whole(state, level_.fields);
    grids::restore_whole(state, low_);
    state.read(std::span<double>(largest_));
    restore_slopes(state, level_.slopes, grid_);
    history_.restore(state);
    contraction_.restore(state);
    state.read(size_of_energy_.terms);
    state.read(size_of_energy_.rounding);
    state.read(size_of_energy_.cancelled);
    state.read(size_age_);
    if (is_driven()) {
      work_ = state.read();
      steps_ = state.read();
    }
    start_level();
  }

private:
  [[nodiscard]] grids::FieldSet& delta() { return history_.increment(); }
  [[nodiscard]] bool is_driven() const { return walls_ && walls_->drives(); }
  void start_level() {
    std::ranges::fill(level_sizes_, -1.0);
    if (solver_ != nullptr) {
      solver_->forget();
    }
    trial_h_ = 0.0;
    node_known_ = false;
    iterations_ = 0;
  }

  /// point = z + scale·δ at every node; fields at midpoints have z = 0.
  void make_point(double scale) {
    for (int f = 0; f < system_.field_count(); ++f) {
      const double* high = level_.fields.field(f).data();
      const double* low = low_.field(f).data();
      const double* change = delta().field(f).data();
      double* point = point_.field(f).data();
      const double keep = at_midpoints_[static_cast<std::size_t>(f)] ? 0.0 : 1.0;
      grids::for_each_block(grid_.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
        for (std::size_t n = begin; n < end; ++n) {
          point[n] = keep * high[n] + (low[n] + scale * change[n]);
        }
      });
    }
  }

  /// Rates without those of fields at midpoints, whose δ is no difference in time.
  using EvolvingRates = std::array<const double*, MultisymplecticSystem::most_fields>;
  [[nodiscard]] std::span<const double* const> evolving(const grids::FieldSet& rate, EvolvingRates& rates) const {
    const auto pointers = std::span(rates).first(at_midpoints_.size());
    for (std::size_t f = 0; f < pointers.size(); ++f) {
      pointers[f] = at_midpoints_[f] ? nullptr : rate.pointers()[f];
    }
    return pointers;
  }

  SweepResult level_sweep(std::span<const double* const> rate) {
    const grids::FieldSet& fields = level_.fields;
    return sweep_(fields.pointers(), level_.slopes, rate, 0.0, {}, {});
  }

  /// At the level, with these velocities.
  NodeEnergy level_node(const grids::FieldSet& velocity) {
    EvolvingRates rates;
    const auto rate = evolving(velocity, rates);
    const bool is_point = std::ranges::find(at_midpoints_, true) == at_midpoints_.end();
    if (!is_point) {
      copy_level(level_.fields, at_midpoints_, residual_);  // which no step goes on from
    }
    const grids::FieldSet& point = is_point ? level_.fields : residual_;
    const SweepResult result = sweep_(point.pointers(), level_.slopes, rate, 0.0, {}, {});
    return {result.energy - work_, -result.quadratic};
  }

  /// The velocity at the start, from one short step forward and one back: without it the first prediction, and Γ of the
  /// first levels, would have nothing to go by.
  void find_start_velocity() {
    if (!history_.empty() || start_tried_) {
      return;
    }
    start_tried_ = true;
    // Of the step alone: a run resumed at the start has the velocity already.
    const int counted = iterations_;
    const NewtonContraction measured = contraction_;
    solve_start_velocity();
    iterations_ = counted;
    contraction_ = measured;
    solver_->forget();
  }

  void solve_start_velocity() {
    delta().fill(0.0);
    if (solve(start_step_, 0.0) != Status::success) {
      return;
    }
    const grids::FieldSet forward = delta();
    for (int f = 0; f < system_.field_count(); ++f) {
      if (!at_midpoints_[static_cast<std::size_t>(f)]) {
        for (double& value : delta().field(f)) {
          value = -value;
        }
      }
    }
    if (solve(-start_step_, 0.0) != Status::success) {
      return;
    }
    for (int f = 0; f < system_.field_count(); ++f) {
      const bool midpoint = at_midpoints_[static_cast<std::size_t>(f)];
      const auto ahead = forward.field(f);
      const auto change = delta().field(f);
      for (std::size_t n = 0; n < grid_.size(); ++n) {
        change[n] = midpoint ? 0.5 * (ahead[n] + change[n]) : ahead[n] - change[n];
      }
    }
    history_.record(0.0, 2.0 * start_step_);
  }

  /// \param distance relative, from the length of the last trial: the next one will be nearer by as much again or more,
  /// and needs to be reported its energy accordingly
  [[nodiscard]] Status solve(double h, double accuracy, double distance = 1.0) {
    const double near = std::max(trial_accuracy * distance * distance * distance, finest_trial);
    const double enough = std::max(std::min(accuracy, near), 0.5 * epsilon);
    if (solver_ == nullptr) {
      solver_ = make_cell_solver(grid_, Collocation::cells, static_cast<int>(condensation_.free().size()),
                                 conditions_.count(), newton_tolerance);
    }
    solver_->set_tolerance(std::clamp(0.1 * enough / (expected_correction * distance), 1e-9, 1e-6));
    if (conditions_.count() > 0 && h != conditions_h_) {
      conditions_ = step_conditions(system_, h);
      conditions_h_ = h;
    }
    condensation_.reduced_mean(h, matrix_.mean);
    if (walls_) {
      walls_->hold(level_.fields, low_, start_ + (steps_ + 1.0) * h, delta());
    }
    condensation_.follow(h, level_.fields, low_, delta());
    EvolvingRates rates;
    const auto rate = evolving(delta(), rates);
    const grids::FieldSet& point = point_;
    grids::FieldSet& correction = point_;                   // found when its sweep is over
    double last = std::numeric_limits<double>::infinity();  // the size of the last correction
    double error = std::numeric_limits<double>::infinity();
    added_.fill(std::numeric_limits<double>::infinity());
    bool stalled = false;  // the corrections of all fields
    for (int iteration = 0;; ++iteration) {
      make_point(0.5);
      const SweepResult result =
          sweep_(point.pointers(), level_.slopes, rate, 1.0 / h, residual_.pointers(), hessian_.pointers());
      if (walls_) {
        walls_->close(condensation_.free(), point_, delta(), 1.0 / h, matrix_, residual_);
      }
      ++iterations_;
      if (!result.finite) {
        return Status::undefined;
      }
      work_of_step_ = walls_ ? walls_->work(point_, delta()) : 0.0;
      energy_ = result.energy - (work_ + 0.5 * work_of_step_);
      slope_ = result.quadratic / (4.0 * h);
      // What the corrections report on their error rests on S'' at single points: where it changes fast, a correction
      // is small and mends nothing. A step that may be accepted is therefore looked at once more.
      const bool is_trial = accuracy > 0.0;
      if (result.residual <= residual_floor || (error <= enough && (is_trial || result.backward_error <= solved)) ||
          (stalled && is_rounding(h))) {
        return Status::success;
      }
      if (iteration == most_iterations) {
        return Status::not_converged;
      }
      // The next sweep shows what a solve left; with a kernel to be bordered, elimination can fail and is checked.
      solver_->check_residuals(conditions_.count() > 0 || iteration >= careful_after);
      if (const Status status = solver_->solve(matrix_, conditions_, free_residual_, free_correction_, border_);
          status != Status::success) {
        return status == Status::undefined ? status : Status::not_converged;
      }
      if (!solver_->finds_ghosts()) {
        grids::refresh_ghosts(correction, condensation_.free());
      }
      if (walls_) {
        walls_->hold(correction);
      }
      condensation_.correct(h, correction);
      const double size = add_correction(stalled);
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      const bool grows = size > 1e3 && size > last;
      if (grows) {
        make_point(0.5);
        if (!is_rounding(h)) {
          return Status::not_converged;
        }
      }
      if (iteration > 0 && !stalled) {
        contraction_.observe(last, size, h);
      }
      error = contraction_.error_after(size, h) + solver_->error() * size;
      if (error <= enough && change_known_ && is_trial && !grows) {
        // What another sweep would show.
        const EnergyChange change = sweep_.energy_change(rate, 1.0 / h, std::as_const(residual_).pointers(),
                                                         std::as_const(correction).pointers());
        energy_ += change.energy;
        slope_ += change.quadratic / (4.0 * h);
        return std::isfinite(energy_) && std::isfinite(slope_) ? Status::success : Status::undefined;
      }
      last = size;
    }
  }

  /// True if rounding errors explain the residuals of the last sweep.
  [[nodiscard]] bool is_rounding(double h) {
    RowRounding::Values values;
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto i = static_cast<std::size_t>(f);
      const double increment = grids::max_abs(std::as_const(delta()).field(f));
      values.point[i] = (at_midpoints_[i] ? 0.0 : level_size(f)) + 0.5 * increment;
      values.increment[i] = at_midpoints_[i] ? 0.0 : increment;
      values.slope[i] = largest_slope(level_.slopes, i, grid_);
    }
    if (is_within(row_rounding_(values, 1.0 / h, hessian_))) {
      return true;
    }
    row_rounding_.measure_gradient(point_, values);
    return is_within(row_rounding_(values, 1.0 / h, hessian_));
  }
  [[nodiscard]] bool is_within(const RowRounding::Sizes& bounds) const {
    for (int row = 0; row < system_.field_count(); ++row) {
      if (!(grids::max_abs(residual_.field(row)) <= solved * bounds[static_cast<std::size_t>(row)])) {
        return false;
      }
    }
    return true;
  }

  /// max |z| of a field at the present level.
  [[nodiscard]] double level_size(int f) {
    double& size = level_sizes_[static_cast<std::size_t>(f)];
    if (size < 0.0) {
      size = grids::max_abs(std::as_const(level_.fields).field(f));
    }
    return size;
  }

  /// δ += 2 c of the correction c that stands where the point was; the largest relative size of c over the fields.
  /// \param stalled becomes true if no field's correction is much smaller than the last one of this step
  double add_correction(bool& stalled) {
    std::array<IncrementSizes, MultisymplecticSystem::most_fields> all;
    add_twice(point_, delta(), std::span(all).first(at_midpoints_.size()));
    double size = 0.0;
    stalled = true;
    for (int f = 0; f < system_.field_count(); ++f) {
      const IncrementSizes& sizes = all[static_cast<std::size_t>(f)];
      const double last = std::exchange(added_[static_cast<std::size_t>(f)], sizes.added);
      stalled = stalled && (sizes.added == 0.0 || sizes.added >= stall * last);
      if (sizes.added != 0.0) {
        const double scale = std::max({sizes.sum, largest_[static_cast<std::size_t>(f)], epsilon * level_size(f)});
        size = larger(size, sizes.added / scale);
      }
    }
    return size;
  }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  LatticeLevel level_;
  std::vector<bool> at_midpoints_;
  CellSweep sweep_;
  RowRounding row_rounding_;
  grids::FieldSet low_;    ///< the fields are level_.fields + low_
  grids::FieldSet point_;  ///< of a sweep, and in its place the correction that the sweep asks for
  grids::FieldSet residual_, hessian_;
  LevelHistory history_;             ///< with the step under way
  std::vector<double> largest_;      ///< of |δ| of each field so far
  std::vector<double> level_sizes_;  ///< max |z| of each field; -1: not known yet
  RowRounding::Sizes added_{};       ///< max |2 c| of each field in the last correction of a step
  double start_step_;
  bool start_tried_ = false;
  NewtonContraction contraction_;

  CellMatrix matrix_;
  KernelConditions conditions_;
  double conditions_h_ = 0.0;
  bool change_known_;  ///< whether a correction's energy can be had without another sweep
  std::vector<double> border_;
  StaticCondensation condensation_;
  std::optional<WallConditions> walls_;
  double start_ = 0.0, steps_ = 0.0, work_ = 0.0, work_of_step_ = 0.0;  ///< of walls that drive fields
  std::vector<const double*> free_residual_;                            ///< of the fields that are solved for
  std::vector<double*> free_correction_;
  std::unique_ptr<CellSolver> solver_;  ///< from when it is needed first

  double trial_h_ = 0.0;  ///< 0: no trial of this level
  double energy_ = 0.0;
  double slope_ = 0.0;
  int iterations_ = 0;
  std::vector<double> terms_at_start_;  ///< means over the cells of the terms of S
  formula::SumSize size_of_energy_;
  std::size_t size_age_ = tuning::size_period;  ///< levels since it was taken
  NodeEnergy node_;
  bool node_known_ = false;
};

}  // namespace

LevelHistory box_start(const MultisymplecticSystem& system, const grids::Grid& grid, const LatticeLevel& first,
                       double first_step, const std::shared_ptr<const WallDrives>& drives) {
  return BoxLattice(system, grid, first, first_step, drives).start();
}

int box_unknowns(const MultisymplecticSystem& system, double h) {
  return static_cast<int>(condensation_of(system, step_conditions(system, h)).free().size());
}

std::unique_ptr<LatticeScheme> make_box_scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                               LatticeLevel first, double first_step,
                                               const std::shared_ptr<const WallDrives>& drives) {
  check(system, grid, first);
  check_waves_of_kernel(system, grid, first_step);
  return std::make_unique<BoxLattice>(system, grid, std::move(first), first_step, drives);
}

}  // namespace rubato
