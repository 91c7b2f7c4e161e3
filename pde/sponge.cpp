#include <rubato/pde/sponge.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/grids/whole.hpp>
#include <rubato/pde/mirror_signs.hpp>

namespace rubato {

namespace {

/// e^{-1/s}/(e^{-1/s} + e^{-1/(1-s)}): 0 up to s = 0, 1 from s = 1 on, with all derivatives.
double smooth_step(double s) {
  if (!(s > 0.0)) {
    return 0.0;
  }
  return s < 1.0 ? 1.0 / (1.0 + std::exp(1.0 / s - 1.0 / (1.0 - s))) : 1.0;
}

/// A scheme between two halves of damping. The method's own scheme stands at the level where ψ_h begins.
class SpongeScheme final : public LatticeScheme, public LosesEnergy {
public:
  /// \param method the one of `inner`
  SpongeScheme(const LatticeMethod& method, std::unique_ptr<LatticeScheme> inner, SpongeDamping damping,
               LatticeLevel first)
      : inner_(std::move(inner)),
        damping_(std::move(damping)),
        equation_(method.equation(inner_->system(), inner_->grid(), first, 0.0)),
        level_(std::move(first)),
        start_(level_),
        next_(level_),
        increment_(level_.fields.fields(), level_.fields.size()),
        energy_(energy_of(level_)) {}

  [[nodiscard]] const MultisymplecticSystem& system() const override { return inner_->system(); }
  [[nodiscard]] const grids::Grid& grid() const override { return inner_->grid(); }
  [[nodiscard]] const LatticeLevel& level() const override { return level_; }
  void stand(const LatticeLevel& level, const LatticeLevel& next, double h) override {
    level_.fields.copy_from(level.fields);
    set_increment(level, next);
    last_h_ = h;
    lost_ = 0.0;
    energy_ = energy_of(level_);
  }

  void set_time(double t) override { inner_->set_time(t); }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    damping_(level_, 0.5 * std::abs(h), start_);
    iterations_ += inner_->iterations();
    inner_->stand(start_, foreseen(h), h);
    lost_before_ = energy_ - energy_of(start_);
    trial_h_ = h;
    return inner_->advance(h, accuracy);
  }
  [[nodiscard]] bool solves_fully() const override { return inner_->solves_fully(); }
  [[nodiscard]] double discrete_energy() const override { return inner_->discrete_energy() + lost_before_ + lost_; }
  [[nodiscard]] double discrete_energy_slope() const override { return inner_->discrete_energy_slope(); }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override { return inner_->energy_size(); }
  [[nodiscard]] std::size_t energy_size_period() const override { return inner_->energy_size_period(); }
  [[nodiscard]] int order() const override { return inner_->order(); }
  [[nodiscard]] bool has_node_law() const override { return false; }
  [[nodiscard]] NodeEnergy node() override {
    return {energy_ + lost_ - work().value_or(0.0), std::numeric_limits<double>::quiet_NaN()};
  }
  [[nodiscard]] std::optional<double> work() const override { return inner_->work(); }
  [[nodiscard]] int iterations() const override { return iterations_ + inner_->iterations(); }
  [[nodiscard]] std::string failure_reason() const override { return inner_->failure_reason(); }
  [[nodiscard]] double energy_lost() const override { return lost_; }

  void accept() override {
    inner_->accept();
    const LatticeLevel& arrived = inner_->level();
    set_increment(start_, arrived);
    last_h_ = trial_h_;
    damping_(arrived, 0.5 * std::abs(trial_h_), level_);
    lost_ += lost_before_ + energy_of(arrived);
    energy_ = energy_of(level_);
    lost_ -= energy_;
    lost_before_ = 0.0;
    iterations_ = 0;
  }

  void save(StateWriter& state) const override {
    inner_->save(state);
    for (const grids::FieldSet* fields : {&level_.fields, &increment_}) {
      grids::save_whole(state, *fields);
    }
    state.write(last_h_);
    state.write(lost_);
  }
  void restore(StateReader& state) override {
    inner_->restore(state);
    for (grids::FieldSet* fields : {&level_.fields, &increment_}) {
      grids::restore_whole(state, *fields);
    }
    state.read(last_h_);
    state.read(lost_);
    energy_ = energy_of(level_);
    iterations_ = 0;
  }

private:
  [[nodiscard]] double energy_of(const LatticeLevel& level) { return equation_->node(level).energy; }
  [[nodiscard]] bool at_midpoints(int field) const { return system().structure().at_midpoints(field); }

  /// What ψ_h added to each field; of those at midpoints their value.
  void set_increment(const LatticeLevel& from, const LatticeLevel& to) {
    for (int f = 0; f < increment_.fields(); ++f) {
      const auto before = from.fields.field(f), after = to.fields.field(f);
      const auto out = increment_.field(f);
      const double of_before = at_midpoints(f) ? 0.0 : 1.0;
      std::ranges::transform(after, before, out.begin(), [=](double a, double b) { return a - of_before * b; });
    }
  }
  /// The end of ψ_h, by the increment of the last step.
  [[nodiscard]] const LatticeLevel& foreseen(double h) {
    const double ratio = last_h_ == 0.0 ? 0.0 : h / last_h_;
    for (int f = 0; f < increment_.fields(); ++f) {
      const auto from = std::as_const(start_.fields).field(f), by = std::as_const(increment_).field(f);
      const auto to = next_.fields.field(f);
      const double of_from = at_midpoints(f) ? 0.0 : 1.0, of_by = at_midpoints(f) ? 1.0 : ratio;
      std::ranges::transform(from, by, to.begin(), [=](double a, double b) { return of_from * a + of_by * b; });
    }
    return next_;
  }

  std::unique_ptr<LatticeScheme> inner_;
  SpongeDamping damping_;
  std::unique_ptr<StepEquation> equation_;
  LatticeLevel level_, start_, next_;  ///< z_k, D z_k, what ψ_h is foreseen to lead to
  grids::FieldSet increment_;          ///< of the last ψ_h
  double energy_;                      ///< of level_
  double lost_ = 0.0, lost_before_ = 0.0;
  double last_h_ = 0.0, trial_h_ = 0.0;
  int iterations_ = 0;
};

/// The laws of ψ_h.
class SpongeLaws final : public LawEvaluator {
public:
  SpongeLaws(std::unique_ptr<LawEvaluator> inner, SpongeDamping damping)
      : inner_(std::move(inner)), damping_(std::move(damping)) {}

  [[nodiscard]] const LawTables& tables() const override { return inner_->tables(); }
  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override {
    damping_(before, 0.5 * std::abs(h), before_);
    damping_(after, -0.5 * std::abs(h), after_);
    return inner_->residuals(before_, after_, h, residuals);
  }
  std::vector<double> totals(const LatticeLevel& level) override { return inner_->totals(level); }
  Spread multisymplectic_residual(const TangentLevels&, const TangentLevels&, double, double*) override {
    throw std::invalid_argument("a sponge has no two-form");
  }

private:
  std::unique_ptr<LawEvaluator> inner_;
  SpongeDamping damping_;
  LatticeLevel before_, after_;
};

/// The equation of ψ_h; its E_k has what was lost before it in the step.
class SpongeEquation final : public StepEquation {
public:
  SpongeEquation(std::unique_ptr<StepEquation> inner, SpongeDamping damping, int fields, std::size_t nodes)
      : StepEquation(fields, nodes), inner_(std::move(inner)), damping_(std::move(damping)) {}

  [[nodiscard]] NodeEnergy node(const LatticeLevel& level) override {
    return {inner_->node(level).energy, std::numeric_limits<double>::quiet_NaN()};
  }
  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    return with_loss(inner_->judge(undamped(before, after, h), after_, h), before);
  }
  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    return with_loss(inner_->measure(undamped(before, after, h), after_, h), before);
  }

private:
  const LatticeLevel& undamped(const LatticeLevel& before, const LatticeLevel& after, double h) {
    damping_(before, 0.5 * std::abs(h), before_);
    damping_(after, -0.5 * std::abs(h), after_);
    return before_;
  }
  StepLaw with_loss(StepLaw law, const LatticeLevel& before) {
    rows_ = inner_->rows();
    law.energy += inner_->node(before).energy - inner_->node(before_).energy;
    return law;
  }

  std::unique_ptr<StepEquation> inner_;
  SpongeDamping damping_;
  LatticeLevel before_, after_;
};

class SpongeMethod final : public LatticeMethod {
public:
  SpongeMethod(std::unique_ptr<LatticeMethod> method, std::shared_ptr<const Sponge> sponge)
      : method_(std::move(method)), sponge_(std::move(sponge)) {}

  [[nodiscard]] int order() const override { return method_->order(); }
  [[nodiscard]] std::string_view fixed_levels_only() const override { return method_->fixed_levels_only(); }
  [[nodiscard]] std::optional<OtherCount> other_count(std::size_t cells, int dimensions) const override {
    return method_->other_count(cells, dimensions);
  }
  [[nodiscard]] bool has_transforms(int dimensions) const override { return method_->has_transforms(dimensions); }
  [[nodiscard]] std::string_view other_dimensions(int dimensions) const override {
    return method_->other_dimensions(dimensions);
  }
  [[nodiscard]] bool has_midpoints(const MultisymplecticSystem& system) const override {
    return method_->has_midpoints(system);
  }
  [[nodiscard]] bool laws_in_cells() const override { return method_->laws_in_cells(); }
  [[nodiscard]] std::string_view not_shared_in(int /*dimensions*/) const override {
    return "a sponge finds the other fields of each level on the whole of it";
  }
  [[nodiscard]] bool begins_in_parts(const MultisymplecticSystem&, const std::vector<bool>&) const override {
    return false;
  }
  [[nodiscard]] std::optional<Collocation> in_mirror() const override { return method_->in_mirror(); }
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return method_->action(system);
  }
  [[nodiscard]] bool has_variational_laws() const override { return false; }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    return method_->first_level(system, grid, given);
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return method_->constrained_fields(system, grid);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    auto inner = method_->scheme(system, grid, first, first_step);
    return std::make_unique<SpongeScheme>(*method_, std::move(inner), damping(system, grid), std::move(first));
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    SpongeDamping damps = damping(tables.system, tables.grid);
    return std::make_unique<SpongeLaws>(method_->laws(std::move(tables)), std::move(damps));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    return std::make_unique<SpongeEquation>(method_->equation(system, grid, first, first_step), damping(system, grid),
                                            system.field_count(), grid.size());
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem&, const grids::Grid&) const override {
    return nullptr;
  }

  [[nodiscard]] SpongeDamping damping(const MultisymplecticSystem& system, const grids::Grid& grid) const {
    return {*method_, system, grid, *sponge_};
  }

private:
  std::unique_ptr<LatticeMethod> method_;
  std::shared_ptr<const Sponge> sponge_;
};

}  // namespace

std::vector<double> Sponge::rates(const grids::Grid& grid) const {
  std::vector<double> rates(grid.size(), 0.0);
  for (const Layer& layer : layers_) {
    const std::size_t stride = grid.stride(layer.axis), cells = grid.cells(layer.axis);
    for (std::size_t i = 0; i < rates.size(); ++i) {
      const double x = grid.axis(layer.axis).node(i / stride % cells);
      const double at_left = layer.at_left ? smooth_step(1.0 - (x - layer.from) / layer.width) : 0.0;
      const double at_right = layer.at_right ? smooth_step(1.0 - (layer.to - x) / layer.width) : 0.0;
      rates[i] += layer.strength * std::max(at_left, at_right);
    }
  }
  return rates;
}

SpongeDamping::SpongeDamping(const LatticeMethod& method, const MultisymplecticSystem& system, const grids::Grid& grid,
                             const Sponge& sponge)
    : constrained_(method.constrained_fields(system, grid)) {
  for (int f = 0; f < system.field_count(); ++f) {
    if (system.structure().at_midpoints(f)) {
      at_midpoints_.push_back(f);
    } else if (!system.structure().algebraic[static_cast<std::size_t>(f)]) {
      damped_.push_back(f);
    }
  }
  const std::vector<double> rates = sponge.rates(grid);
  for (std::size_t node = 0; node < rates.size(); ++node) {
    if (rates[node] > 0.0) {
      nodes_.push_back(node);
      rates_.push_back(rates[node]);
    }
  }
  if (grid.has_walls()) {
    const FieldMirrors mirrors(system, grid, method.in_mirror().value_or(Collocation::nodes));
    std::ranges::copy_if(mirrors.held(grid), std::back_inserter(held_), [&](const auto& held) {
      return rates[held.second] > 0.0 && std::ranges::find(damped_, held.first) != damped_.end();
    });
  }
  for (Factors& factors : factors_) {
    factors.values.assign(nodes_.size(), 1.0);
  }
}

const std::vector<double>& SpongeDamping::factors(double time) {
  Factors& factors = factors_[time < 0.0 ? 1 : 0];
  if (time != factors.time) {
    factors.time = time;
    std::ranges::transform(rates_, factors.values.begin(), [time](double rate) { return std::exp(-time * rate); });
  }
  return factors.values;
}

void SpongeDamping::operator()(const LatticeLevel& level, double time, LatticeLevel& damped) {
  if (damped.fields.size() == 0) {
    damped = level;
  } else {
    damped.fields.copy_from(level.fields);
    damped.slopes = level.slopes;
  }
  const std::vector<double>& by = factors(time);
  for (const int f : damped_) {
    const std::span<double> values = damped.fields.field(f);
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      values[nodes_[i]] *= by[i];
    }
  }
  for (const auto& [field, node] : held_) {
    damped.fields.field(field)[node] = level.fields.field(field)[node];
  }
  for (const int f : at_midpoints_) {
    std::ranges::fill(damped.fields.field(f), 0.0);
  }
  if (const Status status = constrained_->find(damped); status != Status::success) {
    throw std::invalid_argument(fmt::format(
        "the constraints of a level that the sponge has damped could not be solved: {}", to_string(status)));
  }
  for (const int f : at_midpoints_) {
    std::ranges::copy(level.fields.field(f), damped.fields.field(f).begin());
  }
}

double SpongeLoss::of_step(const LatticeLevel& before, const LatticeLevel& after, double h) {
  const auto energy = [this](const LatticeLevel& level) { return equation_->node(level).energy; };
  damping_(before, 0.5 * std::abs(h), damped_);
  const double lost = energy(before) - energy(damped_);
  damping_(after, -0.5 * std::abs(h), damped_);
  return lost + (energy(damped_) - energy(after));
}

std::unique_ptr<LatticeMethod> with_sponge(std::unique_ptr<LatticeMethod> method,
                                           std::shared_ptr<const Sponge> sponge) {
  if (sponge == nullptr) {
    return method;
  }
  return std::make_unique<SpongeMethod>(std::move(method), std::move(sponge));
}

}  // namespace rubato
