#include <rubato/pde/mirrored_method.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/initial_agreement.hpp>
#include <rubato/pde/mirrors.hpp>
#include <rubato/pde/node_derivative.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/wall_data.hpp>

namespace rubato {

namespace {

using grids::FieldSet;

StepLaw between_walls(StepLaw law, double copies) {
  law.energy /= copies;
  law.gamma /= copies;
  return law;
}
NodeEnergy between_walls(NodeEnergy node, double copies) {
  return {node.energy / copies, node.gamma / copies};
}

/// What is on the ring: while a function of it is called this thread's reductions are those there.
template <class T>
class OnRing {
public:
  OnRing(const Mirrors& mirrors, std::unique_ptr<T> object) : mirrors_(mirrors), object_(std::move(object)) {}

  struct Call {
    grids::Slab::Shared reductions;
    T* object;
    T* operator->() const { return object; }
  };
  [[nodiscard]] Call operator->() const { return {mirrors_.on_ring(), object_.get()}; }

private:
  Mirrors mirrors_;
  std::unique_ptr<T> object_;
};

class MirroredScheme final : public LatticeScheme {
public:
  MirroredScheme(const Mirrors& mirrors, std::unique_ptr<LatticeScheme> scheme, LatticeLevel first)
      : mirrors_(mirrors), scheme_(mirrors, std::move(scheme)), level_(std::move(first)), previous_{{}, level_.slopes} {
    if (is_short()) {
      keeps_previous_ = true;
      previous_.fields = FieldSet(level_.fields.fields(), mirrors.grid().size());
    } else {
      ring_ = FieldSet(level_.fields.fields(), mirrors.ring().size());
    }
  }

  [[nodiscard]] const MultisymplecticSystem& system() const override { return scheme_->system(); }
  [[nodiscard]] const grids::Grid& grid() const override { return mirrors_.grid(); }
  [[nodiscard]] const LatticeLevel& level() const override {
    if (!level_is_current_) {
      mirrors_.restrict(scheme_->level().fields, level_.fields);
      level_is_current_ = true;
    }
    return level_;
  }
  [[nodiscard]] const LatticeLevel* previous() const override {
    if (!keeps_previous_) {
      return nullptr;
    }
    if (!previous_is_current_) {
      mirrors_.restrict(scheme_->previous()->fields, previous_.fields);
      previous_is_current_ = true;
    }
    return &previous_;
  }
  void forget_previous() override {
    if (is_short()) {
      scheme_->forget_previous();
      keeps_previous_ = scheme_->previous() != nullptr;
    }
    if (!keeps_previous_) {
      previous_.fields = {};
    }
  }
  void stand(const LatticeLevel& level, const LatticeLevel& next, double h) override {
    if (from_.fields.size() == 0) {
      from_ = to_ = mirrors_.extended(level);
    }
    mirrors_.extend(level.fields, from_.fields);
    mirrors_.extend(next.fields, to_.fields);
    scheme_->stand(from_, to_, h);
    level_.fields.copy_from(level.fields);
    level_is_current_ = true;
    previous_is_current_ = false;
  }
  void set_time(double t) override { scheme_->set_time(t); }
  [[nodiscard]] std::shared_ptr<StageSource> stages() override { return scheme_->stages(); }
  [[nodiscard]] std::optional<double> work() const override { return scheme_->work(); }

  [[nodiscard]] Status advance(double h, double accuracy) override { return scheme_->advance(h, accuracy); }
  [[nodiscard]] bool solves_fully() const override { return scheme_->solves_fully(); }
  [[nodiscard]] double discrete_energy() const override { return scheme_->discrete_energy() / copies(); }
  [[nodiscard]] formula::SumSize energy_size() override {
    const formula::SumSize size = scheme_->energy_size();
    return {.terms = size.terms / copies(),
            .cancelled = size.cancelled / copies(),
            .rounding = size.rounding / copies(),
            .magnitudes = size.magnitudes / copies()};
  }
  [[nodiscard]] std::size_t energy_size_period() const override { return scheme_->energy_size_period(); }
  [[nodiscard]] double discrete_energy_slope() const override { return scheme_->discrete_energy_slope() / copies(); }
  [[nodiscard]] bool slope_costs_more() const override { return scheme_->slope_costs_more(); }
  [[nodiscard]] bool slope_to_leading_order() const override { return scheme_->slope_to_leading_order(); }
  [[nodiscard]] std::optional<double> energy_target() const override {
    const std::optional<double> target = scheme_->energy_target();
    return target ? std::optional(*target / copies()) : target;
  }
  [[nodiscard]] int order() const override { return scheme_->order(); }
  [[nodiscard]] bool has_node_law() const override { return scheme_->has_node_law(); }
  [[nodiscard]] NodeEnergy node() override { return between_walls(scheme_->node(), copies()); }
  [[nodiscard]] int iterations() const override { return scheme_->iterations(); }
  [[nodiscard]] double gamma_factor() const override { return scheme_->gamma_factor(); }
  [[nodiscard]] bool has_gamma() const override { return scheme_->has_gamma(); }
  [[nodiscard]] std::string failure_reason() const override { return scheme_->failure_reason(); }
  void accept() override {
    scheme_->accept();
    if (is_short()) {
      if (keeps_previous_) {  // the level that is there becomes the one before
        std::swap(level_.fields, previous_.fields);
        previous_is_current_ = level_is_current_;
      }
      level_is_current_ = false;
      return;
    }
    mirrors_.restrict_within(scheme_->level().fields, level_.fields);
    // The rounding error of the mirrors would grow where solutions are unstable.
    mirrors_.extend(level_.fields, ring_);
    scheme_->correct(ring_);
    mirrors_.restrict_within(scheme_->level().fields, level_.fields);
  }
  void save(StateWriter& state) const override { scheme_->save(state); }
  void restore(StateReader& state) override {
    scheme_->restore(state);
    if (is_short()) {
      level_is_current_ = previous_is_current_ = false;
    } else {
      mirrors_.restrict_within(scheme_->level().fields, level_.fields);
    }
  }

private:
  [[nodiscard]] double copies() const { return mirrors_.copies(); }
  [[nodiscard]] bool is_short() const { return mirrors_.is_short(); }

  Mirrors mirrors_;
  OnRing<LatticeScheme> scheme_;
  mutable LatticeLevel level_, previous_;  ///< the second of the short ring alone, where `scheme_` has one
  mutable bool level_is_current_ = true, previous_is_current_ = false;
  bool keeps_previous_ = false;
  FieldSet ring_;
  LatticeLevel from_, to_;  ///< of stand()
};

class MirroredConstraints final : public ConstrainedFields {
public:
  MirroredConstraints(const Mirrors& mirrors, const MultisymplecticSystem& system,
                      std::unique_ptr<ConstrainedFields> of_ring)
      : mirrors_(mirrors),
        is_found_(system.structure().algebraic),
        of_ring_(mirrors, std::move(of_ring)),
        ring_{FieldSet(system.field_count(), mirrors.ring().size()), {}} {}

  [[nodiscard]] Status find(LatticeLevel& level) override {
    mirrors_.extend(level.fields, ring_.fields);
    ring_.slopes = level.slopes;
    const Status status = of_ring_->find(ring_);
    for (int f = 0; f < level.fields.fields(); ++f) {
      if (is_found_[static_cast<std::size_t>(f)]) {
        const auto between = level.fields.field(f), ring = ring_.fields.field(f);
        mirrors_.restrict(ring, between);
        mirrors_.extend(f, between, ring);
        mirrors_.restrict(ring, between);
      }
    }
    level.slopes = ring_.slopes;
    return status;
  }

private:
  Mirrors mirrors_;
  std::vector<bool> is_found_;
  OnRing<ConstrainedFields> of_ring_;
  LatticeLevel ring_;
};

class MirroredEquation final : public StepEquation {
public:
  MirroredEquation(const MultisymplecticSystem& system, const Mirrors& mirrors, std::optional<DrivenNodes> driven,
                   std::unique_ptr<StepEquation> equation, const LatticeLevel& first)
      : StepEquation(first.fields.fields(), mirrors.grid().size()),
        mirrors_(mirrors),
        driven_(std::move(driven)),
        equation_(mirrors, std::move(equation)),
        before_(mirrors.extended(first)),
        after_(before_) {
    // What else is held follows from these, along a wall as within.
    std::ranges::copy_if(mirrors.held(), std::back_inserter(held_), [&](const auto& held) {
      return !system.structure().algebraic[static_cast<std::size_t>(held.first)];
    });
  }

  [[nodiscard]] NodeEnergy node(const LatticeLevel& level) override {
    mirrors_.extend(level.fields, after_.fields);
    return between_walls(equation_->node(after_), mirrors_.copies());
  }
  [[nodiscard]] StepLaw judge(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    take(before, after);
    const StepLaw law = equation_->judge(before_, after_, h);
    return taken(law, before, after, h);
  }
  [[nodiscard]] StepLaw measure(const LatticeLevel& before, const LatticeLevel& after, double h) override {
    take(before, after);
    const StepLaw law = equation_->measure(before_, after_, h);
    return taken(law, before, after, h);
  }

private:
  void take(const LatticeLevel& before, const LatticeLevel& after) {
    mirrors_.extend(before.fields, before_.fields);
    mirrors_.extend(after.fields, after_.fields);
  }
  StepLaw taken(StepLaw law, const LatticeLevel& before, const LatticeLevel& after, double h) {
    mirrors_.restrict(equation_->rows(), rows_);
    if (mirrors_.is_short()) {
      // There nothing but that they stay is asked of what walls hold, and nothing of what they give.
      for (const auto& [field, node] : held_) {
        rows_.field(field)[node] = (after.fields.field(field)[node] - before.fields.field(field)[node]) / h;
      }
      if (driven_) {
        for (const DrivenNodes::Node& node : driven_->nodes()) {
          rows_.field(node.u)[node.node] = rows_.field(node.row.v)[node.node] = 0.0;
        }
      }
      law.residual = grids::magnitudes(rows().all());
    }
    return between_walls(law, mirrors_.copies());
  }

  Mirrors mirrors_;
  std::optional<DrivenNodes> driven_;
  OnRing<StepEquation> equation_;
  LatticeLevel before_, after_;
  std::vector<std::pair<int, std::size_t>> held_;  ///< of fields with an equation of motion
};

/// Residuals are those on the ring at the nodes between the walls. Totals are integrals of the densities with spectral
/// derivatives on the ring, on the short one with central differences: those of momentum towards a wall vanish on the
/// whole of it. Where walls give values no law holds, and residuals are 0.
class MirroredLaws final : public LawEvaluator {
public:
  MirroredLaws(const Mirrors& mirrors, std::optional<DrivenNodes> driven, LawTables tables,
               std::unique_ptr<LawEvaluator> laws)
      : mirrors_(mirrors),
        driven_(std::move(driven)),
        tables_(std::move(tables)),
        laws_(mirrors, std::move(laws)),
        coordinates_(tables_.system, mirrors.ring(), Within::node),
        before_{FieldSet(tables_.d, mirrors.ring().size()), {}},
        after_(before_),
        of_laws_(static_cast<int>(tables_.names.size()), mirrors.ring().size()),
        between_(static_cast<int>(tables_.names.size()), mirrors.grid().size()),
        S_values_(1, mirrors.ring().size()),
        S_(tables_.system.value_code()) {
    for (int f = 0; f < tables_.d; ++f) {
      const auto is_row = [f](const MatrixTerms& terms) {
        return std::ranges::any_of(terms, [f](const MatrixTerm& term) { return term.row == f; });
      };
      if (std::ranges::any_of(tables_.plus, is_row)) {
        differentiated_.push_back(f);
      }
    }
    along_.assign(static_cast<std::size_t>(mirrors.grid().dimensions()),
                  FieldSet(static_cast<int>(differentiated_.size()), mirrors.ring().size()));
    if (mirrors.is_short()) {
      at_nodes_ = after_.fields;
    } else {
      spectral_.emplace(mirrors.ring(), Collocation::nodes);
    }
  }

  [[nodiscard]] const LawTables& tables() const override { return tables_; }
  void share(std::shared_ptr<StageSource> stages) override { laws_->share(std::move(stages)); }

  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override {
    mirrors_.extend(before.fields, before_.fields);
    mirrors_.extend(after.fields, after_.fields);
    static_cast<void>(laws_->residuals(before_, after_, h, of_laws_.pointers()));
    return taken(residuals);
  }
  std::vector<Spread> next_residuals(const LatticeLevel&, const LatticeLevel& after, double h,
                                     std::span<double* const> residuals) override {
    std::swap(before_, after_);
    mirrors_.extend(after.fields, after_.fields);
    static_cast<void>(laws_->next_residuals(before_, after_, h, of_laws_.pointers()));
    return taken(residuals);
  }

  std::vector<double> totals(const LatticeLevel& level) override {
    mirrors_.extend(level.fields, after_.fields);
    return totals_after(level);
  }
  std::vector<double> totals_after(const LatticeLevel&) override {
    const std::size_t nodes = mirrors_.ring().size();
    if (mirrors_.is_short()) {
      bring_to_nodes();
    }
    std::vector<const double*> z =
        coordinates_.after(std::as_const(mirrors_.is_short() ? at_nodes_ : after_.fields).pointers());
    std::vector<const double*> rows;
    for (const int f : differentiated_) {
      rows.push_back(after_.fields.field(f).data());
    }
    std::vector<std::array<const double*, 4>> derivatives(static_cast<std::size_t>(tables_.d));
    for (std::size_t a = 0; a < along_.size(); ++a) {
      differentiate(static_cast<int>(a), rows, along_[a].pointers());
      for (std::size_t r = 0; r < differentiated_.size(); ++r) {
        derivatives[static_cast<std::size_t>(differentiated_[r])][1 + a] =
            std::as_const(along_[a]).field(static_cast<int>(r)).data();
      }
    }
    S_(nodes, z, S_values_.pointers());
    tables_.currents(LawTables::time, nodes,
                     {.z = std::span(z).first(static_cast<std::size_t>(tables_.d)),
                      .derivatives = derivatives,
                      .S = std::as_const(S_values_).field(0).data(),
                      .partner = {}},
                     of_laws_.pointers());
    mirrors_.restrict(of_laws_, between_);
    return grids::integrals(mirrors_.grid(), between_);
  }

  Spread multisymplectic_residual(const TangentLevels&, const TangentLevels&, double, double*) override {
    throw std::invalid_argument("walls leave out the law of two tangent solutions");
  }

private:
  /// Between the walls of the short ring: means of the fields between nodes.
  void bring_to_nodes() {
    at_nodes_.copy_from(after_.fields);
    for (int f = 0; f < tables_.d; ++f) {
      for (int a = 0; a < mirrors_.grid().dimensions(); ++a) {
        const int offset = mirrors_.offset(a, f);
        if (offset != 0) {
          each_along(
              a, after_.fields.field(f), at_nodes_.field(f).data(),
              [&](double before, double here, double after) { return 0.5 * (here + (offset > 0 ? before : after)); });
        }
      }
    }
  }
  void differentiate(int axis, std::span<const double* const> rows, std::span<double* const> out) {
    if (spectral_) {
      (*spectral_)(axis, rows, out);
      return;
    }
    const double inverse = 1.0 / mirrors_.ring().spacing(axis);
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const int offset = mirrors_.offset(axis, differentiated_[r]);
      const double factor = offset == 0 ? 0.5 * inverse : inverse;
      each_along(axis, {rows[r], mirrors_.ring().size()}, out[r], [&](double before, double here, double after) {
        return factor * ((offset > 0 ? here : after) - (offset < 0 ? here : before));
      });
    }
  }
  /// out = of(the value before, here, after) along an axis, which closes.
  template <class Of>
  void each_along(int axis, std::span<const double> in, double* out, const Of& of) const {
    const std::size_t stride = mirrors_.ring().stride(axis), cells = mirrors_.ring().cells(axis);
    const std::size_t around = (cells - 1) * stride;
    for (std::size_t node = 0; node < in.size(); ++node) {
      const std::size_t place = node / stride % cells;
      const std::size_t before = place > 0 ? node - stride : node + around;
      const std::size_t after = place + 1 < cells ? node + stride : node - around;
      out[node] = of(in[before], in[node], in[after]);
    }
  }

  std::vector<Spread> taken(std::span<double* const> residuals) {
    mirrors_.restrict(of_laws_, between_);
    for (int law = 0; driven_ && law < between_.fields(); ++law) {
      for (const DrivenNodes::Node& node : driven_->nodes()) {
        between_.field(law)[node.node] = 0.0;
      }
    }
    return write_residuals(between_, residuals);
  }

  Mirrors mirrors_;
  std::optional<DrivenNodes> driven_;
  LawTables tables_;
  OnRing<LawEvaluator> laws_;
  std::optional<NodeDerivative> spectral_;  ///< on the ring of mirrors
  PlacedCoordinates coordinates_;
  std::vector<int> differentiated_;  ///< fields, the rows of every Λ₊
  std::vector<FieldSet> along_;      ///< their derivatives along each axis
  LatticeLevel before_, after_;      ///< of the ring
  FieldSet at_nodes_;                ///< fields there, of the short ring
  FieldSet of_laws_, between_, S_values_;
  formula::BatchEvaluator S_;
};

class MirroredMethod final : public LatticeMethod {
public:
  MirroredMethod(std::unique_ptr<LatticeMethod> method, Collocation collocation, const LatticeMethodChoice& choice)
      : method_(std::move(method)), collocation_(collocation), name_(choice.name), drives_(choice.drives) {}

  [[nodiscard]] int order() const override { return method_->order(); }
  [[nodiscard]] std::string_view fixed_levels_only() const override { return method_->fixed_levels_only(); }
  [[nodiscard]] bool has_transforms(int dimensions) const override { return method_->has_transforms(dimensions); }
  [[nodiscard]] std::string_view other_dimensions(int dimensions) const override {
    return method_->other_dimensions(dimensions);
  }
  [[nodiscard]] bool has_midpoints(const MultisymplecticSystem& system) const override {
    return method_->has_midpoints(system);
  }
  [[nodiscard]] bool laws_in_cells() const override { return method_->laws_in_cells(); }
  [[nodiscard]] std::optional<Collocation> in_mirror() const override { return collocation_; }
  [[nodiscard]] std::string_view not_shared_in(int dimensions) const override {
    return collocation_ == Collocation::corners
               ? method_->not_shared_in(dimensions)
               : "between walls its fields go on in mirrors, on a ring that one process has";
  }
  /// A rank beside a wall has the nodes within that are mirrored in all its ghosts, and no ghosts reach beyond the next
  /// rank.
  [[nodiscard]] std::vector<std::size_t> parts(const MultisymplecticSystem& system, const grids::Grid& whole, double,
                                               int ranks) const override {
    const grids::Axis& axis = whole.axes().back();
    const grids::Ghosts of_ranks = method_->ghosts(system);
    const std::size_t least = 2 * (method_->wall_ghosts(system) + std::max(of_ranks.before, of_ranks.after));
    if (axis.has_walls() && axis.cells / static_cast<std::size_t>(ranks) < least) {
      throw std::invalid_argument(
          fmt::format("{} ranks cannot share {} nodes between walls along {}, of which each needs {}: start fewer",
                      ranks, axis.cells, axis.name, least));
    }
    return {};
  }
  /// Data are compared with what whole walls hold.
  [[nodiscard]] bool begins_in_parts(const MultisymplecticSystem&, const std::vector<bool>&) const override {
    return false;
  }
  /// That of the ring.
  [[nodiscard]] std::optional<LatticeAction> action(const MultisymplecticSystem& system) const override {
    return method_->action(system);
  }
  [[nodiscard]] bool has_variational_laws() const override { return false; }

  [[nodiscard]] InitialLevel first_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                         const InitialFields& given) const override {
    const std::size_t ghosts = method_->wall_ghosts(system);
    if (drives_ != nullptr && ghosts == 0) {
      throw SchemeRefusal(
          fmt::format("{} has no walls that drive fields: leapfrog, explicit actions and, on a line, box have; take "
                      "lagrangian = \"leapfrog\" or \"box\", or walls that are \"fixed\" or \"free\"",
                      name_));
    }
    const Mirrors mirrors(system, grid, Collocation::nodes, ghosts);  // what is given is given at nodes
    InitialFields met = given;
    std::vector<std::string> cautions = meet_walls(system, mirrors, met, drives_);
    InitialFields on_ring(met.size());
    for (std::size_t f = 0; f < met.size(); ++f) {
      // On the short ring what is computed is wrong at the seam, and compared between the walls.
      const bool is_compared = mirrors.is_short() && system.structure().algebraic[f];
      if (met[f] && !is_compared) {
        mirrors.extend(static_cast<int>(f), *met[f], on_ring[f].emplace(mirrors.ring().size()));
      }
    }
    InitialLevel ring = method_->first_level(system, mirrors.ring(), on_ring);
    std::ranges::move(ring.cautions, std::back_inserter(cautions));
    // A field that goes on in mirrors has no slope but that of rounding.
    LatticeLevel level{FieldSet(system.field_count(), grid.size()), {}};
    mirrors.restrict(ring.level.fields, level.fields);
    ring.level.fields = {};
    on_ring.clear();
    const Mirrors own = mirrors_of(system, grid);
    own.restrict(own.extended(level).fields, level.fields);
    for (std::size_t f = 0; f < met.size(); ++f) {
      if (met[f] && mirrors.is_short() && system.structure().algebraic[f] && !system.structure().multiplier[f]) {
        check_agreement(system, grid, collocation_, static_cast<int>(f), met, level,
                        system.structure().level_constraints);
      }
    }
    return {std::move(level), std::move(cautions)};
  }
  [[nodiscard]] std::unique_ptr<ConstrainedFields> constrained_fields(const MultisymplecticSystem& system,
                                                                      const grids::Grid& grid) const override {
    const Mirrors mirrors = mirrors_of(system, grid);
    const auto reductions = mirrors.on_ring();
    return std::make_unique<MirroredConstraints>(mirrors, system, method_->constrained_fields(system, mirrors.ring()));
  }
  [[nodiscard]] std::unique_ptr<LatticeScheme> scheme(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                      LatticeLevel first, double first_step) const override {
    const Mirrors mirrors = mirrors_of(system, grid);
    const auto reductions = mirrors.on_ring();
    auto scheme = method_->scheme(system, mirrors.ring(), mirrors.extended(first), first_step);
    return std::make_unique<MirroredScheme>(mirrors, std::move(scheme), std::move(first));
  }
  [[nodiscard]] std::unique_ptr<LawEvaluator> laws(LawTables tables) const override {
    const Mirrors mirrors = mirrors_of(tables.system, tables.grid);
    auto driven = driven_nodes(tables.system, tables.grid);
    const auto reductions = mirrors.on_ring();
    auto laws = method_->laws(LawTables(tables.system, mirrors.ring(), tables.symmetries));
    return std::make_unique<MirroredLaws>(mirrors, std::move(driven), std::move(tables), std::move(laws));
  }
  [[nodiscard]] std::unique_ptr<StepEquation> equation(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                       const LatticeLevel& first, double first_step) const override {
    const Mirrors mirrors = mirrors_of(system, grid);
    auto driven = driven_nodes(system, grid);
    const auto reductions = mirrors.on_ring();
    return std::make_unique<MirroredEquation>(
        system, mirrors, std::move(driven),
        method_->equation(system, mirrors.ring(), mirrors.extended(first), first_step), first);
  }
  [[nodiscard]] std::unique_ptr<TangentStep> tangents(const MultisymplecticSystem&, const grids::Grid&) const override {
    return nullptr;
  }

private:
  [[nodiscard]] Mirrors mirrors_of(const MultisymplecticSystem& system, const grids::Grid& grid) const {
    return {system, grid, collocation_, method_->wall_ghosts(system), method_->ghosts(system)};
  }

  [[nodiscard]] std::optional<DrivenNodes> driven_nodes(const MultisymplecticSystem& system,
                                                        const grids::Grid& grid) const {
    return drives_ == nullptr ? std::nullopt : std::optional<DrivenNodes>(std::in_place, drives_, system, grid);
  }

  std::unique_ptr<LatticeMethod> method_;
  Collocation collocation_;
  std::string name_;
  std::shared_ptr<const WallDrives> drives_;
};

}  // namespace

std::unique_ptr<LatticeMethod> make_mirrored_method(std::unique_ptr<LatticeMethod> method,
                                                    const LatticeMethodChoice& choice) {
  const std::optional<Collocation> collocation = method->in_mirror();
  if (!collocation) {
    throw SchemeRefusal(fmt::format(
        "{}{} has no walls: they are for schemes that are the same in a mirror, which fourier, splitting, leapfrog, "
        "euler-box, box with stages = 1 and actions that name no field without an equation of motion are. Take one of "
        "these, or leave left and right out",
        choice.name, choice.stages > 1 ? fmt::format(" with stages = {}", choice.stages) : ""));
  }
  if (*collocation == Collocation::cells) {  // whose rows are closed at the walls, with no need of mirrors
    return make_box_between_walls(choice);
  }
  return std::make_unique<MirroredMethod>(std::move(method), *collocation, choice);
}

}  // namespace rubato
