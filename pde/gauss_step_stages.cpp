#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include <rubato/grids/slab.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/same_bits.hpp>

/// \file
/// A GaussStep as the source of a step's stages, for laws: the step of a run, or one solved anew; and what of it a
/// checkpoint keeps.

namespace rubato {

Status GaussStep::take(const LatticeLevel& before, const LatticeLevel&, double h) {
  bool same = solved_ && h == h_;
  for (const int f : kept_) {
    same = same && (at_midpoints_[static_cast<std::size_t>(f)] ||
                    same_bits(std::as_const(high_).field(f), before.fields.field(f)));
  }
  if (grids::agreed_by_all(grid_, same)) {
    return Status::success;
  }
  const double failed_at = fixed_point_fails_at_;
  const int since = since_fixed_point_;
  const double reference = std::exchange(reference_h_, 0.0);  // what a step gives depends on it alone
  stand(before.fields, nullptr, before.slopes);
  begin_at_level();
  const Status status = solve(h, 0.0, {});
  reference_h_ = reference;
  if (std::exchange(restored_, false)) {  // the run had counted this step
    fixed_point_fails_at_ = failed_at;
    since_fixed_point_ = since;
  }
  return status;
}

void GaussStep::stage(int stage, grids::FieldSet& z, grids::FieldSet& rate) {
  complete();
  const OfWaves write_stage = [this, stage](int f, std::size_t begin, std::size_t count, double* re, double* im) {
    std::fill_n(re, count, 0.0);
    std::fill_n(im, count, 0.0);
    add_stage(1.0, f, stage, begin, count, re, im);
    if (is_derived(f)) {
      add_level(1.0, f, begin, count, re, im);
    }
  };
  to_nodes(all_, write_stage, z.pointers());
  for (const int f : kept_) {
    const auto high = std::as_const(high_).field(f);
    const auto to = z.field(f);
    for (std::size_t x = 0; x < to.size(); ++x) {
      to[x] += high[x];
    }
  }
  std::array<int, MultisymplecticSystem::most_fields> which{};
  std::array<double*, MultisymplecticSystem::most_fields> to{};
  std::size_t count = 0;
  for (int f = 0; f < d_; ++f) {
    const auto place = static_cast<std::size_t>(f);
    if (at_midpoints_[place] || (!asked_.empty() && !asked_[place])) {
      std::ranges::fill(rate.field(f), 0.0);
      continue;
    }
    which[count] = f;
    to[count++] = rate.field(f).data();
  }
  const OfWaves write_rate = [this, stage](int f, std::size_t begin, std::size_t waves, double* re, double* im) {
    std::fill_n(re, waves, 0.0);
    std::fill_n(im, waves, 0.0);
    for (int j = 0; j < m_; ++j) {
      add_stage(a_inverse_.value(stage, j) / h_, f, j, begin, waves, re, im);
    }
  };
  to_nodes(std::span(which).first(count), write_rate, std::span(to).first(count));
  grids::refresh_ghosts(z);
  grids::refresh_ghosts(rate);
}

void GaussStep::forget_steps() {
  radius_ = reference_h_ = 0.0;
  is_forgetful_ = true;
  fixed_point_fails_at_ = std::numeric_limits<double>::infinity();
  since_fixed_point_ = 0;
  if (newton_) {
    newton_->any_kept = newton_->any_start = false;
  }
  solved_ = starts_solved_ = restored_ = false;
}

void GaussStep::save(StateWriter& state) const {
  state.write(radius_);
  state.write(fixed_point_fails_at_);
  state.write(static_cast<double>(since_fixed_point_));
  state.write(reference_h_);
  const bool any_kept = newton_ && newton_->any_kept;
  state.write(static_cast<double>(any_kept));
  if (any_kept) {
    grids::save_whole(state, newton_->kept);
  }
}

void GaussStep::restore(StateReader& state) {
  state.read(radius_);
  state.read(fixed_point_fails_at_);
  state.read(since_fixed_point_);
  state.read(reference_h_);
  newton_.reset();
  if (state.read() != 0.0) {
    make_newton();
    grids::restore_whole(state, newton_->kept);
    newton_->any_kept = true;
  }
  if (!has_resolvent()) {
    take_last_resolvent();
  }
  last_resolvent_.reset();
  solved_ = false;
  restored_ = true;
}

namespace {

/// Made at the first step, which shows the middle of S''.
class GaussStages final : public StageSource {
public:
  GaussStages(const MultisymplecticSystem& system, const grids::Grid& grid, int stages, SpaceRule space)
      : system_(system), grid_(grid), tableau_(stages), space_(space) {}

  [[nodiscard]] Status take(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    if (!slab_) {
      slab_.emplace(system_, grid_, tableau_.stages, before, space_);
      slab_->ask_rates_of(asked_);
    }
    return slab_->take(before, after, h);
  }
  [[nodiscard]] int count() const override { return tableau_.stages; }
  [[nodiscard]] double weight(int stage) const override { return tableau_.b[stage]; }
  void stage(int stage, grids::FieldSet& z, grids::FieldSet& rate) override { slab_.value().stage(stage, z, rate); }
  void ask_rates_of(const std::vector<bool>& fields) override {
    asked_ = fields;
    if (slab_) {
      slab_->ask_rates_of(fields);
    }
  }

private:
  MultisymplecticSystem system_;
  grids::Grid grid_;
  GaussTableau tableau_;
  SpaceRule space_;
  std::vector<bool> asked_;
  std::optional<GaussStep> slab_;
};

}  // namespace

std::shared_ptr<StageSource> make_gauss_stages(const MultisymplecticSystem& system, const grids::Grid& grid, int stages,
                                               SpaceRule space) {
  return std::make_shared<GaussStages>(system, grid, stages, space);
}

}  // namespace rubato
