#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/family_lattice.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/level_fields.hpp>
#include <rubato/pde/step_equation.hpp>
#include <rubato/pde/tangent.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

namespace {

constexpr std::uint64_t nowhere = std::numeric_limits<std::uint64_t>::max();

Collocation placement_of(SpaceRule space) {
  return space.spectral() ? Collocation::nodes : Collocation::elements(space.stages);
}

class GaussLattice final : public FamilyLattice {
public:
  GaussLattice(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, LatticeLevel first,
               SpaceRule space)
      : FamilyLattice(system, grid, std::move(first), placement_of(space)),
        low_(system.field_count(), grid.size()),
        slab_(std::make_shared<GaussStep>(system, grid, stages, level_, space)),
        largest_(static_cast<std::size_t>(system.field_count()), 0.0),
        stages_(stages),
        forecast_(slab_->make_forecast()),
        is_midpoint_(stages == 1 && space.spectral()) {
    if (is_midpoint_) {
      slab_->take_no_stages();
    }
  }

  [[nodiscard]] std::shared_ptr<StageSource> stages() override { return is_midpoint_ ? nullptr : slab_; }
  [[nodiscard]] int order() const override { return 2 * stages_; }
  [[nodiscard]] bool solves_fully() const override { return true; }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    if (slab_->stamp() != stamp_) {
      slab_->stand(level_.fields, &low_, level_.slopes);
      stamp_ = slab_->stamp();
      forget_trial();
    }
    if (h == trial_h()) {
      return Status::success;  // any step is solved to rounding
    }
    const int counted = slab_->iterations();
    const bool continued = slab_->begin(forecast_, h, trial_h());
    forget_trial();
    const bool steady = GaussStep::are_near(h, forecast_.last_h());  // of equal levels, after a resumption too
    Status status = slab_->solve(h, std::min(accuracy, tuning::loosest_trial), largest_, steady);
    if (status != Status::success && continued) {
      slab_->begin_at_level();
      status = slab_->solve(h, std::min(accuracy, tuning::loosest_trial), largest_, steady);
    }
    count_iterations(slab_->iterations() - counted);
    if (status != Status::success) {
      return status;
    }
    const double energy = slab_->energy();
    set_trial(h, energy);
    return std::isfinite(energy) ? Status::success : Status::undefined;
  }

  void accept() override {
    slab_->increments(slab_->kept(), [this](int f, std::span<const double> delta) {
      const auto place = static_cast<std::size_t>(f);
      largest_[place] = std::max(largest_[place], grids::max_abs(delta));
      add_increment(delta, at_midpoints_[place], level_.fields.field(f), low_.field(f));
    });
    slab_->keep(forecast_);
    if (std::exchange(is_whole_, false)) {
      forget_derived();
    }
    stamp_ = nowhere;
    move();
    grow_older();
  }

  void stand(const LatticeLevel& level, const LatticeLevel&, double) override {
    level_.fields.copy_from(level.fields);
    is_whole_ = true;
    low_.fill(0.0);
    std::ranges::fill(largest_, 0.0);
    forecast_.forget();
    slab_->forget_steps();
    stamp_ = nowhere;
    start_level();
  }

  void correct(const grids::FieldSet& fields) override {
    level_.fields.copy_from(fields);
    is_whole_ = true;
    low_.fill(0.0);
    start_level();
  }

  void save(StateWriter& state) const override {
    save_level(state);
    grids::save_whole(state, low_);
    state.write(largest_);
    slab_->save(state, forecast_);
    slab_->save(state);
  }
  void restore(StateReader& state) override {
    restore_level(state);
    is_whole_ = true;
    grids::restore_whole(state, low_);
    state.read(std::span<double>(largest_));
    slab_->restore(state, forecast_);
    slab_->restore(state);
    stamp_ = nowhere;
  }

private:
  [[nodiscard]] double energy_at_end() const override { return slab_->energy_at_end(); }
  [[nodiscard]] double energy_at_start() const override {
    append_level();
    return FamilyLattice::energy_at_start();
  }
  void append_level() const override {
    if (!std::exchange(is_whole_, true)) {
      slab_->write_derived(level_.fields);
    }
  }
  void forget_derived() {
    for (int f = 0; f < system_.field_count(); ++f) {
      if (std::ranges::find(slab_->kept(), f) == slab_->kept().end()) {
        level_.fields.forget(f);
      }
    }
  }

  grids::FieldSet low_;           ///< the fields are level_.fields + low_
  mutable bool is_whole_ = true;  ///< whether level_ has the fields that follow from the others
  std::shared_ptr<GaussStep> slab_;
  std::vector<double> largest_;  ///< of |δ| of each field so far
  int stages_;
  RestForecast forecast_;
  bool is_midpoint_;               ///< laws of whose steps two levels give: no stages are kept for them
  std::uint64_t stamp_ = nowhere;  ///< of the slab, where it stands at this level
};

/// The step taken again, and what the level that is there differs from where it leads, in units of a rate.
class GaussEquation final : public FamilyEquation {
public:
  GaussEquation(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, const LatticeLevel& first,
                SpaceRule space)
      : FamilyEquation(system, grid, placement_of(space)), slab_(system, grid, stages, first, space) {}

  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    StepLaw law = unknown();
    if (slab_.take(before, after, h) != Status::success) {
      rows_.fill(std::numeric_limits<double>::quiet_NaN());
      law.residual = grids::magnitudes(rows().all());
      return law;
    }
    law.energy = slab_.energy();
    law.is_long = slab_.solved_by_newton();
    slab_.increments([&](int f, std::span<const double> delta) {
      const auto z_0 = before.fields.field(f), z_1 = after.fields.field(f);
      const auto out = rows_.field(f);
      const bool midpoint = system_.structure().at_midpoints(f);
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = midpoint ? (z_1[i] - 0.5 * delta[i]) / h : (z_1[i] - z_0[i] - delta[i]) / h;
      }
    });
    law.residual = grids::magnitudes(rows().all());
    return law;
  }

private:
  GaussStep slab_;
};

/// Two slabs: of the step, and of the equation linearised at its stages. Made anew for each step, so that what they
/// give depends on it alone.
class GaussTangents final : public TangentStep {
public:
  GaussTangents(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, SpaceRule space)
      : system_(system),
        grid_(grid),
        space_(space),
        before_(system.field_count(), grid.size()),
        rate_(before_),
        stages_(static_cast<std::size_t>(stages), before_) {}

  Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h, const grids::FieldSet& u_before,
                    grids::FieldSet& u_after) override {
    if (!slab_ || h != h_ ||
        !grids::agreed_by_all(grid_, std::ranges::equal(std::as_const(before_).all(), before.fields.all()))) {
      h_ = h;
      before_.copy_from(before.fields);
      const int count = static_cast<int>(stages_.size());
      GaussStep about(system_, grid_, count, before, space_);
      slab_.reset();
      if (const Status status = about.take(before, after, h); status != Status::success) {
        return status;
      }
      slab_.emplace(system_, grid_, count, before, space_);
      slab_->linearise(about);
    }
    slab_->stand(u_before, nullptr, {});
    slab_->begin_at_level();
    if (const Status status = slab_->solve(h, 0.0, {}); status != Status::success) {
      return status;
    }
    slab_->increments(slab_->kept(), [&](int f, std::span<const double> delta) {
      const bool midpoint = system_.structure().at_midpoints(f);
      const auto u_0 = u_before.field(f);
      const auto u_1 = u_after.field(f);
      for (std::size_t i = 0; i < u_1.size(); ++i) {
        u_1[i] = midpoint ? 0.5 * delta[i] : u_0[i] + delta[i];
      }
    });
    slab_->write_derived(u_after);
    for (std::size_t i = 0; i < stages_.size(); ++i) {
      slab_->stage(static_cast<int>(i), stages_[i], rate_);
    }
    return Status::success;
  }
  [[nodiscard]] std::span<const grids::FieldSet> stages() const override { return stages_; }

private:
  MultisymplecticSystem system_;
  grids::Grid grid_;
  SpaceRule space_;
  double h_ = 0.0;
  grids::FieldSet before_, rate_;
  std::vector<grids::FieldSet> stages_;
  std::optional<GaussStep> slab_;
};

}  // namespace

std::unique_ptr<LatticeScheme> make_gauss_lattice(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                  int stages, LatticeLevel first, SpaceRule space) {
  if (system.directions() != grid.dimensions()) {
    throw std::invalid_argument(
        fmt::format("the system has {} space direction(s), the grid {}", system.directions(), grid.dimensions()));
  }
  return std::make_unique<GaussLattice>(system, grid, stages, std::move(first), space);
}

std::unique_ptr<StepEquation> make_gauss_equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                  int stages, const LatticeLevel& first, SpaceRule space) {
  return std::make_unique<GaussEquation>(system, grid, stages, first, space);
}

std::unique_ptr<TangentStep> make_gauss_tangents(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                 int stages, SpaceRule space) {
  return std::make_unique<GaussTangents>(system, grid, stages, space);
}

}  // namespace rubato
