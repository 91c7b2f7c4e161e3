#include <rubato/pde/action_scheme.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/natural_sizes.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/taken_levels.hpp>
#include <rubato/pde/wall_ghosts.hpp>

namespace rubato {

namespace {

using grids::FieldSet;

/// A residual of the rows of a pair of levels, relative to the largest value of ∂𝕊/∂z, that is no step of theirs.
constexpr double largest_miss = 1e-9;
/// Relative: lengths that are meant to be the same.
constexpr double same_length = 1e-9;

/// Of the whole lattice.
double constant_energy(const MultisymplecticSystem& system, const grids::Grid& grid) {
  const grids::Slab* const slab = grids::Slab::of(grid);
  return system.constant() * (slab == nullptr ? grid.volume() : slab->whole().volume());
}

InitialFields fields_given(const MultisymplecticSystem& system, const LatticeLevel& level, bool potentials) {
  InitialFields given(system.fields().size());
  for (std::size_t f = 0; f < given.size(); ++f) {
    const bool left_out = system.structure().algebraic[f] || (!potentials && system.structure().potential[f]);
    if (!left_out) {
      const auto values = level.fields.field(static_cast<int>(f));
      given[f].emplace(values.begin(), values.end());
    }
  }
  return given;
}

}  // namespace

ActionEnergy::ActionEnergy(const MultisymplecticSystem& system, const grids::Grid& grid, const ActionRows& rows,
                           double h)
    : h_(h), constant_(constant_energy(system, grid)) {
  if (rows.has_momentum_fields()) {
    at_corners_.emplace(system, grid);
  }
}

double ActionEnergy::operator()(ActionStep& step, const LatticeLevel& level) {
  return at_corners_ ? (*at_corners_)(level.fields, level.slopes) : step.energy_at_rest(h_, level) + constant_;
}

void ActionStart::complete(ActionStep& step, const LatticeLevel& first) {
  second_.emplace(first);
  bool is_complete = true;
  for (const ActionRows::Row& row : step.rows().rows()) {
    if (const auto& values = next_->fields[static_cast<std::size_t>(row.field)]) {
      std::ranges::copy(*values, second_->fields.field(row.field).begin());
    } else if (!row.in_slab && !system_.M().row(row.field).isZero(0.0)) {
      throw std::invalid_argument(fmt::format("the second level gives no {0}, and L names {0}",
                                              system_.fields()[static_cast<std::size_t>(row.field)]));
    } else {
      is_complete = false;
    }
  }
  if (!is_complete) {
    step.constrain(next_->h, *second_);
  }
}

Status ActionStart::operator()(double h, const LatticeLevel& first, const ActionRows& rows, FieldSet& after) {
  const auto take = [&](int field, std::span<const double> values) {
    std::ranges::copy(values, after.field(field).begin());
  };
  if (next_) {
    if (!(std::abs(h - next_->h) <= same_length * std::abs(h))) {
      return Status::not_converged;
    }
    for (const ActionRows::Row& row : rows.rows()) {
      take(row.field, second_->fields.field(row.field));
    }
    return Status::success;
  }
  if (!method_) {
    method_ = make_lattice_method({.name = "box"});
    for (int a = 0; a < grid_.dimensions(); ++a) {
      if (method_->other_count(grid_.cells(a), grid_.dimensions())) {
        method_ = make_lattice_method({.name = "fourier"});
        break;
      }
    }
    try {
      first_ = method_->first_level(system_, grid_, fields_given(system_, first, false)).level;
    } catch (const std::invalid_argument&) {  // a potential that nothing else determines
      first_ = method_->first_level(system_, grid_, fields_given(system_, first, true)).level;
    }
  }
  const auto scheme = method_->scheme(system_, grid_, *first_, h);
  if (const Status status = scheme->advance(h, 0.0); status != Status::success) {
    return status;
  }
  scheme->accept();
  for (const ActionRows::Row& row : rows.rows()) {
    take(row.field, scheme->level().fields.field(row.field));
  }
  return Status::success;
}

ActionMap::ActionMap(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated,
                     std::shared_ptr<const SecondLevel> next, const LatticeLevel& first, double first_step)
    : grid_(grid), constant_(constant_energy(system, grid)), start_(system, grid, std::move(next)) {
  const double h = first_step == 0.0 ? grid.spacing(0) : first_step;
  step_ = std::make_unique<ActionStep>(system, grid, stated, h);
  if (start_.is_given()) {
    start_.complete(*step_, first);
  }
  if (start_.is_given() && rows().has_one_step_form()) {
    // Whether the pair is a step of the one-step form; if not, its two-step form goes on from there.
    LatticeLevel second{first.fields, first.slopes};
    FieldSet kept = room_for_momenta();
    if (start_(h, first, rows(), second.fields) == Status::success) {
      step_->imply(h, first, second.fields, kept);
      if (!(step_->relative_miss(h, first, second, kept) <= largest_miss)) {
        step_ = std::make_unique<ActionStep>(system, grid, stated, h, true);
      }
    }
  }
  energy_.emplace(system, grid, rows(), h);
}

namespace {

class ActionLattice final : public LatticeScheme {
public:
  ActionLattice(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated,
                std::shared_ptr<const SecondLevel> next, LatticeLevel first, double first_step)
      : system_(system),
        grid_(grid),
        map_(system, grid, stated, std::move(next), first, first_step),
        levels_(std::move(first), map_.step().written(), map_.step().found(),
                [this](LatticeLevel& level) { map_.step().write(level); }),
        kept_(map_.room_for_momenta()),
        next_kept_(map_.room_for_momenta()),
        symmetric_order_(map_.rows().is_symmetric() ? 2 : 1),
        last_h_(first_step),
        start_(stated.drives == nullptr ? 0.0 : stated.drives->start) {
    if (grid.has_ghosts()) {
      ghosts_.emplace(FieldMirrors(system, grid, Collocation::corners), grid);
    }
    map_.step().begin(levels_.here());
    if (!is_its_level()) {
      levels_.before().fields.copy_from(levels_.here().fields);
      levels_.trial().copy_from(levels_.here().fields);
    }
    if (!std::isfinite(energy_here())) {
      throw std::invalid_argument("the discrete energy of L is not finite at the initial level");
    }
  }

  [[nodiscard]] const MultisymplecticSystem& system() const override { return system_; }
  [[nodiscard]] const grids::Grid& grid() const override { return grid_; }
  [[nodiscard]] const LatticeLevel& level() const override { return levels_.level(); }
  [[nodiscard]] const LatticeLevel* previous() const override {
    return levels_.keeps_previous() ? &levels_.previous() : nullptr;
  }
  void forget_previous() override {
    if (map_.step().is_explicit() && is_its_level()) {  // else steps read it
      levels_.forget_previous();
    }
  }

  [[nodiscard]] bool solves_fully() const override { return map_.step().is_explicit(); }
  [[nodiscard]] Status advance(double h, double accuracy) override {
    ++iterations_;
    levels_.leave();
    const LatticeLevel& level = levels_.here();
    FieldSet& trial = levels_.trial();
    const bool starts = at_start_ && map_.needs_start();
    if (map_.step().is_driven()) {
      map_.step().drive(start_ + (steps_ + 1.0) * h);  // levels are fixed
    }
    if (!tried_ && !map_.step().is_explicit()) {
      foresee(h);
    }
    tried_ = false;
    if (starts) {
      if (const Status status = map_.start()(h, level, map_.rows(), trial); status != Status::success) {
        return status;
      }
      map_.step().imply(h, level, trial, kept_);
      map_.step().derive(h, level, trial, trial);
    } else if (const Status status = map_.step().advance(h, level, kept_, accuracy, trial); status != Status::success) {
      return status;
    }
    tried_ = true;
    trial_h_ = h;
    work_of_step_ = map_.step().work(h, level, trial);
    energy_ = map_.step().energy() + map_.energy_constant() - (work_ + work_of_step_.before);
    return std::isfinite(energy_) ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] formula::SumSize energy_size() override {
    formula::SumSize size = tried_
                                ? map_.step().energy_size(trial_h_, levels_.here(), std::as_const(levels_).trial())
                                : map_.step().energy_size(last_h_, is_its_level() ? levels_.here() : levels_.before(),
                                                          levels_.here().fields);
    EnergyFloor(system_, grid_).raise(size, levels_.found_here());
    return size;
  }
  [[nodiscard]] std::size_t energy_size_period() const override { return tuning::large_size_period; }
  /// Where steps find 𝓔 of their levels: E - 𝓔 = (s+1) h^s η + O(h^(s+1)) at both ends with signs that agree (theory,
  /// section 8), so that dE/dh is s (E - (𝓔_k + 𝓔_{k+1})/2)/h to leading order.
  [[nodiscard]] double discrete_energy_slope() const override {
    const ActionStep& step = map_.step();
    return slope_to_leading_order()
               ? order() * (step.energy() - 0.5 * (step.energy_at_begin() + step.energy_at_end())) / trial_h_
               : map_.step().energy_slope(trial_h_, levels_.here(), kept_, levels_.trial());
  }
  [[nodiscard]] bool slope_to_leading_order() const override { return map_.step().finds_energy_of_levels(); }
  [[nodiscard]] bool has_node_law() const override { return false; }
  [[nodiscard]] int order() const override { return symmetric_order_; }
  [[nodiscard]] NodeEnergy node() override { return {energy_here() - work_, std::numeric_limits<double>::quiet_NaN()}; }
  [[nodiscard]] std::optional<double> work() const override {
    return map_.step().is_driven() ? std::optional(work_) : std::nullopt;
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    if (ghosts_) {
      ghosts_->renew(map_.step().found(), levels_.trial());
    }
    map_.step().keep(trial_h_, levels_.here(), levels_.trial(), next_kept_);
    std::swap(kept_, next_kept_);
    levels_.accept();
    if (ghosts_) {
      map_.step().renew(levels_.here(), ghosts_->ranges());
    }
    last_h_ = trial_h_;
    work_ += work_of_step_.before + work_of_step_.after;
    steps_ += 1.0;
    at_start_ = false;
    map_.step().move();
    start_level();
  }
  void stand(const LatticeLevel& level, const LatticeLevel& next, double h) override {
    levels_.here().fields.copy_from(level.fields);
    levels_.replace(true);
    if (levels_.keeps_previous()) {
      // So that what is foreseen at h is `next`.
      for (int f = 0; f < system_.field_count(); ++f) {
        const auto here = level.fields.field(f), there = next.fields.field(f);
        std::ranges::transform(here, there, levels_.before().fields.field(f).begin(),
                               [](double a, double b) { return 2.0 * a - b; });
      }
      levels_.replace_before(true);
    }
    last_h_ = h;
    at_start_ = false;  // what begins a run is of its first level alone
    if (map_.rows().kept() > 0) {
      map_.step().imply(h, levels_.here(), next.fields, kept_);
    }
    map_.step().begin(levels_.here());
    start_level();
  }

  void set_time(double t) override {
    start_ = t;
    steps_ = 0.0;
  }

  void correct(const FieldSet& fields) override {
    levels_.here().fields.copy_from(fields);
    levels_.replace(false);  // what follows from others follows from these, as after restore()
    map_.step().begin(levels_.here());
  }

  void save(StateWriter& state) const override {
    levels_.save(state);
    if (kept_.fields() > 0) {
      grids::save_whole(state, kept_);
    }
    save_slopes(state, levels_.here().slopes, grid_);
    state.write(last_h_);
    state.write(at_start_ ? 1.0 : 0.0);
    if (map_.step().is_driven()) {
      state.write(std::array{work_, steps_});
    }
  }
  void restore(StateReader& state) override {
    levels_.restore(state);
    if (kept_.fields() > 0) {
      grids::restore_whole(state, kept_);
    }
    restore_slopes(state, levels_.here().slopes, grid_);
    levels_.before().slopes = levels_.here().slopes;
    state.read(last_h_);
    at_start_ = state.read() != 0.0;
    if (map_.step().is_driven()) {
      work_ = state.read();
      steps_ = state.read();
    }
    map_.step().begin(levels_.here());
    start_level();
  }

private:
  /// Where the search for the next level begins: as far on as the last step went, in the time of this one.
  void foresee(double h) {
    const double ratio = h / last_h_;
    for (int f = 0; f < system_.field_count(); ++f) {
      const auto here = std::as_const(levels_).here().fields.field(f),
                 before = std::as_const(levels_.before()).fields.field(f);
      const double step = system_.structure().at_midpoints(f) ? 0.0 : ratio;
      std::ranges::transform(here, before, levels_.trial().field(f).begin(),
                             [step](double a, double b) { return a + step * (a - b); });
    }
  }
  [[nodiscard]] bool is_its_level() const { return map_.step().finds_energy_of_levels(); }
  void start_level() {
    here_.reset();
    tried_ = false;
    iterations_ = 0;
  }
  [[nodiscard]] double energy_here() {
    if (map_.step().finds_energy_of_levels()) {
      return map_.step().energy_at_begin() + map_.energy_constant();
    }
    if (!here_) {
      here_ = map_.energy()(map_.step(), levels_.here());
    }
    return *here_;
  }

  MultisymplecticSystem system_;
  grids::Grid grid_;
  mutable ActionMap map_;
  std::optional<WallGhosts> ghosts_;
  TakenLevels levels_;
  FieldSet kept_, next_kept_;
  int symmetric_order_;
  double last_h_, trial_h_ = 0.0, energy_ = 0.0;
  ActionStep::Work work_of_step_;
  double start_, steps_ = 0.0, work_ = 0.0;  ///< of driven walls
  bool at_start_ = true, tried_ = false;
  int iterations_ = 0;
  std::optional<double> here_;
};

class ActionEquation final : public StepEquation {
public:
  ActionEquation(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated,
                 std::shared_ptr<const SecondLevel> next, const LatticeLevel& first, double first_step)
      : StepEquation(system.field_count(), grid.size()),
        map_(system, grid, stated, std::move(next), first, first_step),
        kept_(map_.room_for_momenta()),
        in_turn_(first_step != 0.0) {}

  [[nodiscard]] NodeEnergy node(const LatticeLevel& level) override {
    map_.step().begin(level);
    const double energy = map_.step().finds_energy_of_levels() ? map_.step().energy_at_begin() + map_.energy_constant()
                                                               : map_.energy()(map_.step(), level);
    return {energy, std::numeric_limits<double>::quiet_NaN()};
  }
  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    StepLaw law = measure(before, after, h);
    map_.step().keep(h, before, after.fields, kept_);
    at_start_ = false;
    return law;
  }
  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    const bool starts = at_start_ && in_turn_ && map_.needs_start();
    if (starts) {
      map_.step().imply(h, before, after.fields, kept_);
    }
    map_.step().measure(h, before, after, kept_, rows_);
    const ActionStep::Work work = map_.step().work(h, before, after.fields);
    StepLaw law{.energy = map_.step().energy() + map_.energy_constant() - work.before,
                .gamma = std::numeric_limits<double>::quiet_NaN(),
                .residual = {},
                .work = work.before + work.after,
                .is_long = false};
    if (starts) {
      compare_start(before, after, h);
    }
    if (in_turn_ || map_.rows().kept() == 0) {
      law.residual = grids::magnitudes(rows().all());
    }
    return law;
  }

private:
  /// The step from the first level is taken again.
  void compare_start(const LatticeLevel& before, const LatticeLevel& after, double h) {
    FieldSet again(after.fields.fields(), after.fields.size());
    again.copy_from(after.fields);
    if (map_.start()(h, before, map_.rows(), again) != Status::success) {
      return;
    }
    for (const ActionRows::Row& row : map_.rows().rows()) {
      const auto found = after.fields.field(row.field), expected = std::as_const(again).field(row.field);
      std::ranges::transform(found, expected, rows_.field(row.field).begin(),
                             [h](double a, double b) { return (a - b) / h; });
    }
  }

  ActionMap map_;
  FieldSet kept_;
  bool in_turn_, at_start_ = true;
};

class ActionTangents final : public TangentStep {
public:
  ActionTangents(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated)
      : step_(system, grid, stated, grid.spacing(0)),
        forms_(1, FieldSet(4 * static_cast<int>(step_.rows().rows().size()), grid.size())) {}

  [[nodiscard]] Status operator()(const LatticeLevel& before, const LatticeLevel& after, double h,
                                  const FieldSet& u_before, FieldSet& u_after) override {
    return step_.tangent(h, before, after, u_before, u_after, forms_.front());
  }
  [[nodiscard]] std::span<const FieldSet> stages() const override { return forms_; }
  [[nodiscard]] bool has_law() const { return step_.rows().kept() == 0; }

private:
  ActionStep step_;
  std::vector<FieldSet> forms_;
};

class ActionLaws final : public LawsWithTangents {
public:
  ActionLaws(std::unique_ptr<LawEvaluator> inner, std::vector<int> named)
      : LawsWithTangents(std::move(inner)), named_(std::move(named)) {}

  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override {
    if (u.stages.empty() || v.stages.empty()) {
      throw std::invalid_argument("the law of two tangent solutions needs the variations of their momenta");
    }
    const FieldSet &of_u = u.stages.front(), &of_v = v.stages.front();
    FieldSet sum(1, u.before.size());
    const auto out = sum.field(0);
    const int n = static_cast<int>(named_.size());
    // Forms: of ∂𝕊/∂z at the lower level, at the upper one; of π at the lower level, at the upper one.
    const auto add = [&](double sign, const FieldSet& a, const FieldSet& b, int form) {
      for (int i = 0; i < n; ++i) {
        const auto field_a = a.field(named_[static_cast<std::size_t>(i)]);
        const auto field_b = b.field(named_[static_cast<std::size_t>(i)]);
        const auto form_a = of_u.field(form * n + i), form_b = of_v.field(form * n + i);
        for (std::size_t k = 0; k < out.size(); ++k) {
          out[k] += sign / h * (field_a[k] * form_b[k] - field_b[k] * form_a[k]);
        }
      }
    };
    add(1.0, u.after, v.after, 3);
    add(-1.0, u.before, v.before, 2);
    add(-1.0, u.before, v.before, 0);
    add(-1.0, u.after, v.after, 1);
    if (residual != nullptr) {
      std::ranges::copy(std::as_const(sum).field(0), residual);
    }
    return grids::magnitudes(std::as_const(sum).field(0));
  }

private:
  std::vector<int> named_;
};

}  // namespace

std::unique_ptr<LatticeScheme> make_action_scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                  const StatedAction& stated, std::shared_ptr<const SecondLevel> next,
                                                  LatticeLevel first, double first_step) {
  return std::make_unique<ActionLattice>(system, grid, stated, std::move(next), std::move(first), first_step);
}

std::unique_ptr<StepEquation> make_action_equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                   const StatedAction& stated, std::shared_ptr<const SecondLevel> next,
                                                   const LatticeLevel& first, double first_step) {
  return std::make_unique<ActionEquation>(system, grid, stated, std::move(next), first, first_step);
}

std::unique_ptr<TangentStep> make_action_tangents(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                  const StatedAction& stated) {
  auto tangents = std::make_unique<ActionTangents>(system, grid, stated);
  return tangents->has_law() ? std::move(tangents) : nullptr;
}

std::unique_ptr<LawEvaluator> make_action_laws(std::unique_ptr<LawEvaluator> inner, std::vector<int> named_fields) {
  return std::make_unique<ActionLaws>(std::move(inner), std::move(named_fields));
}

}  // namespace rubato
