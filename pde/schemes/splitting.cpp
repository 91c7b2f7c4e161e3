#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <memory>
#include <utility>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/family_lattice.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/same_bits.hpp>
#include <rubato/pde/wave_splitting.hpp>
#include <rubato/variation/action_quadrature.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

namespace {

class SplittingLattice final : public FamilyLattice {
public:
  SplittingLattice(const MultisymplecticSystem& system, const grids::Grid& grid, const Composition& composition,
                   LatticeLevel first, double first_step, Collocation collocation)
      : FamilyLattice(system, grid, std::move(first), collocation),
        splitting_(system, grid, collocation),
        composition_(composition) {
    splitting_.check(composition);
    splitting_.prepare(composition, first_step);
    splitting_.stand(level_);
  }

  [[nodiscard]] int order() const override { return composition_.order; }

  [[nodiscard]] bool solves_fully() const override { return true; }
  [[nodiscard]] Status advance(double h, double) override {
    forget_trial();
    if (reported_ && !keeps_previous_) {  // few levels are asked for
      forget_level();
      reported_ = false;
    }
    count_iterations(1);
    if (!splitting_.step(composition_, h)) {
      return Status::undefined;
    }
    set_trial(h, splitting_.generator());
    return Status::success;
  }
  void accept() override {
    splitting_.accept();
    reported_ = false;
    move();
    grow_older();
  }
  void stand(const LatticeLevel& level, const LatticeLevel&, double) override {
    level_.fields.copy_from(level.fields);
    reported_ = true;
    splitting_.stand(level_);
    start_level();
  }
  void correct(const grids::FieldSet& fields) override {
    level_.fields.copy_from(fields);
    reported_ = true;
    splitting_.stand(level_);
    start_level();
  }
  [[nodiscard]] bool level_is_current() const override { return reported_; }
  void write_previous(grids::FieldSet& fields) const override { splitting_.fields_before(fields); }
  void forget_previous() override {
    keeps_previous_ = false;
    splitting_.forget_before();
  }

  void save(StateWriter& state) const override {
    save_level(state);
    splitting_.save(state);
  }
  void restore(StateReader& state) override {
    restore_level(state);
    reported_ = true;
    splitting_.stand(level_);
    splitting_.restore(state);
  }

private:
  [[nodiscard]] double energy_at_end() const override { return splitting_.energy(); }
  [[nodiscard]] double energy_at_start() const override {
    const double energy = splitting_.energy_here();
    give_back_beside_level();
    return energy;
  }
  void append_level() const override {
    if (!reported_) {
      reported_ = true;
      give_back_beside_level();
      splitting_.fields_here(level_.fields);
    }
  }
  /// Few levels are asked for: what a step makes anew need not be in memory beside them.
  void give_back_beside_level() const {
    if (reported_ && !keeps_previous_ && trial_h() == 0.0) {
      splitting_.give_back();
    }
  }

  mutable bool reported_ = true;  ///< level_ is where splitting_ stands
  bool keeps_previous_ = true;
  mutable WaveSplitting splitting_;
  const Composition& composition_;
};

/// The step taken again, and what the level that is there differs from where it leads, divided by h.
class SplittingEquation final : public FamilyEquation {
public:
  SplittingEquation(const MultisymplecticSystem& system, const grids::Grid& grid, const Composition& composition,
                    Collocation collocation)
      : FamilyEquation(system, grid, collocation), splitting_(system, grid, collocation), composition_(composition) {}

  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    StepLaw law = unknown();
    splitting_.stand(before);
    if (splitting_.step(composition_, h)) {
      law.energy = splitting_.generator();
      splitting_.fields(rows_);
      for (std::size_t i = 0; i < rows_.all().size(); ++i) {
        rows_.all()[i] = (after.fields.all()[i] - rows_.all()[i]) / h;
      }
    } else {
      rows_.fill(std::numeric_limits<double>::quiet_NaN());
    }
    law.residual = grids::magnitudes(rows().all());
    return law;
  }

private:
  WaveSplitting splitting_;
  const Composition& composition_;
};

/// Lobatto's quadrature of a step: as accurate as the step itself. Its first and last points are the levels, the others
/// are reached by steps of the same splitting.
class SplittingStages final : public StageSource {
public:
  SplittingStages(const MultisymplecticSystem& system, const grids::Grid& grid, const Composition& composition,
                  Collocation collocation)
      : splitting_(system, grid, collocation),
        quadrature_(ActionQuadrature::Points::lobatto, composition.order / 2),
        composition_(composition),
        grid_(grid),
        here_(system.field_count(), grid.size()) {}

  [[nodiscard]] Status take(const LatticeLevel& before, const LatticeLevel&, double h) override {
    stand(before);
    h_ = h;
    return Status::success;
  }
  [[nodiscard]] int count() const override { return static_cast<int>(quadrature_.nodes.size()) - 2; }
  [[nodiscard]] double weight(int stage) const override { return quadrature_.weights[1 + stage]; }
  [[nodiscard]] double end_weight() const override { return quadrature_.weights[0]; }
  void rates_at(const LatticeLevel& level, grids::FieldSet& rate) override {
    stand(level);
    splitting_.rates_here(rate, asked_);
  }
  void ask_rates_of(const std::vector<bool>& fields) override { asked_ = fields; }
  void stage(int stage, grids::FieldSet& z, grids::FieldSet& rate) override {
    if (!splitting_.step(composition_, quadrature_.nodes[1 + stage] * h_, false)) {
      z.fill(std::numeric_limits<double>::quiet_NaN());
      return;
    }
    splitting_.rates(rate, asked_);  // which may show the fields that N depends on at the nodes
    splitting_.fields(z);
  }

private:
  /// A level is one of two steps.
  void stand(const LatticeLevel& level) {
    if (!stands_ || !grids::agreed_by_all(grid_, same_bits(std::as_const(here_).all(), level.fields.all()))) {
      splitting_.stand(level);
      here_.copy_from(level.fields);
      stands_ = true;
    }
  }

  WaveSplitting splitting_;
  ActionQuadrature quadrature_;
  const Composition& composition_;
  grids::Grid grid_;
  std::vector<bool> asked_;  ///< whose rates; none: all
  grids::FieldSet here_;     ///< where it stands
  bool stands_ = false;
  double h_ = 0.0;
};

/// The fields without an equation of motion, as the waves have them.
class WaveConstraints final : public ConstrainedFields {
public:
  WaveConstraints(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation)
      : splitting_(system, grid, collocation) {}

  [[nodiscard]] Status find(LatticeLevel& level) override {
    splitting_.stand(level);
    splitting_.others_here(level.fields);
    return Status::success;
  }

private:
  WaveSplitting splitting_;
};

/// Compositions of the waves' exact flow and that of what is left of S: WaveSplitting.
class SplittingMethod final : public LatticeMethod {
public:
  SplittingMethod(const Composition& composition, Collocation collocation)
      : composition_(composition), collocation_(collocation) {}

  [[nodiscard]] int order() const override { return composition_.order; }
  [[nodiscard]] bool has_transforms(int /*dimensions*/) const override { return true; }
  [[nodiscard]] bool has_variational_laws() const override { return false; }
  [[nodiscard]] std::optional<Collocation> in_mirror() const override { return collocation_; }
  [[nodiscard]] std::string_view not_shared_in(int dimensions) const override {
    return dimensions > 1 ? "" : "its transforms along a line take the whole of it";
  }
  /// With differences laws read the fluxes of a neighbour, which reads its own; the waves of a step are the whole
  /// lattice's, and so are spectral derivatives.
  [[nodiscard]] grids::Ghosts ghosts(const MultisymplecticSystem&) const override {
    return collocation_ == Collocation::corners ? grids::Ghosts{2, 2} : grids::Ghosts{};
  }
  /// None: the family has its K.
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem&) const override {
    return std::nullopt;
  }
  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    const auto determine = [&](LatticeLevel& level) {
      static_cast<void>(WaveConstraints(system, grid, collocation_).find(level));  // which is always a success
    };
    std::vector<bool> is_given;
    std::ranges::transform(given, std::back_inserter(is_given), [](const auto& field) { return field.has_value(); });
    if (grids::Slab::of(grid) != nullptr || begins_in_parts(system, is_given)) {
      return prepare_determined_level(system, grid, given, determine);
    }
    InitialLevel first = prepare_initial_level(system, grid, given, Collocation::nodes);
    if (collocation_ == Collocation::corners) {  // what follows from the others follows by differences
      determine(first.level);
    }
    return first;
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    return std::make_unique<WaveConstraints>(system, grid, collocation_);
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    return std::make_unique<SplittingLattice>(system, grid, composition_, std::move(first), first_step, collocation_);
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    auto stages = std::make_shared<SplittingStages>(tables.system, tables.grid, composition_, collocation_);
    return make_node_laws(std::move(tables), collocation_, std::move(stages));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel&, double) const override {
    return std::make_unique<SplittingEquation>(system, grid, composition_, collocation_);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem&, const grids::Grid&) const override {
    return nullptr;
  }

private:
  const Composition& composition_;
  Collocation collocation_;
};

}  // namespace

LatticeMethodEntry splitting_method() {
  return {.name = "splitting",
          .summary = "waves exactly, the rest node by node, composed; explicit",
          .has_compositions = true,
          .has_space = true,
          .make = [](const LatticeMethodChoice& choice) -> std::unique_ptr<LatticeMethod> {
            return std::make_unique<SplittingMethod>(
                composition(choice.composition), choice.space == "fourier" ? Collocation::nodes : Collocation::corners);
          }};
}

}  // namespace rubato
