#include <algorithm>
#include <array>
#include <utility>

#include <rubato/pde/law_codes.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/variation/node_code.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::FieldSet;
using grids::SpaceOperator;

/// The uniform number of the formulas.
constexpr int number_of_rate = 0;  ///< 1/h

/// Where currents are: on cells on one of the faces normal to direction μ, which are in space the lower one and the
/// upper one; else at the node.
struct LawFace {
  int mu = LawTables::time;
  bool upper = false;
};

/// The coordinates that S names in the middle of cells, on their lower faces normal to each axis, and on their upper
/// ones; or as often at the nodes.
FieldSet placed_coordinates(const MultisymplecticSystem& system, const grids::Grid& grid, bool on_cells) {
  const int dimensions = grid.dimensions(), count = static_cast<int>(system.coordinates().size());
  FieldSet all(count * (1 + 2 * dimensions), count == 0 ? 0 : grid.size());
  for (int i = 0; count > 0 && i <= 2 * dimensions; ++i) {
    const int axis = i == 0 ? -1 : (i - 1) % dimensions;
    grids::BoxOperator place{Within::node, Within::node, Within::node};
    for (int a = 0; on_cells && a < dimensions; ++a) {
      place[static_cast<std::size_t>(a)] = a != axis ? Within::centre : i <= dimensions ? Within::node : Within::next;
    }
    const PlacedCoordinates placed(system, grid, place);
    for (int c = 0; c < count; ++c) {
      std::ranges::copy(placed.values().field(c), all.field(i * count + c).begin());
    }
  }
  return all;
}

/// The formulas of the laws at one place of a node, and of what they are made of.
class LawFormulas {
public:
  /// Where fields are taken: at a level, or at the middle of the step, with D_t of it.
  enum class When { before, after, middle };

  LawFormulas(const LawTables& tables, bool on_cells)
      : tables_(tables), on_cells_(on_cells), formulas_(tables.grid), rate_(formulas_.uniform(number_of_rate)) {}

  /// J_μ of all laws.
  [[nodiscard]] std::vector<Expression> currents(const LawFace& face, When when) {
    const bool has_partner = !on_cells_ && face.mu != LawTables::time;
    std::vector<Expression> sums(tables_.names.size());
    for (const LawTerm& term : tables_.terms_of_currents(face.mu, has_partner)) {
      const Expression left = quantity(term.left, face, when);
      add_weighted(sums[term.law], term.factor, term.right ? left * quantity(*term.right, face, when) : left);
    }
    for (Expression& sum : sums) {
      sum = sum.valid() ? sum : zero();
    }
    return sums;
  }
  /// ∂S/∂x_a at fixed z, of the middle of a cell, or at the node, and of the step, for each coordinate that S names.
  [[nodiscard]] std::vector<Expression> sources() {
    const std::vector<Expression>& sources = tables_.system.sources();
    return sources.empty() ? std::vector<Expression>() : at_place(sources, {}, When::middle);
  }
  /// D_a of an array that is of the lower faces, or the nodes.
  [[nodiscard]] Expression difference(int axis, int array) {
    return formulas_.in_cell(
        on_cells_ ? SpaceOperator::forward_difference(axis) : SpaceOperator::backward_difference(axis), array);
  }
  [[nodiscard]] const Expression& rate() const { return rate_; }
  /// The first of the arrays that are no fields and no coordinates; and LevelValues of formulas that read so many.
  ///@{
  [[nodiscard]] int other_arrays() const { return first_coordinate({tables_.grid.dimensions(), true}) + coordinates(); }
  [[nodiscard]] LevelValues keep(int others, std::span<const Expression> always,
                                 std::initializer_list<std::vector<Expression>*> formulas) {
    const int of_level = tables_.d, kept = other_arrays() + others;
    return {formulas_, {of_level, other_arrays() - 2 * of_level, kept}, always, formulas};
  }
  ///@}

  [[nodiscard]] NodeCode code(std::span<const Expression> outputs) const { return formulas_.code(outputs); }

private:
  using Offset = std::array<int, 3>;

  [[nodiscard]] Expression zero() { return formulas_.graph().constant(0.0); }
  [[nodiscard]] int coordinates() const { return static_cast<int>(tables_.system.coordinates().size()); }
  /// As placed_coordinates() orders them.
  [[nodiscard]] int first_coordinate(const LawFace& face) const {
    return 2 * tables_.d + (face.mu + (face.upper ? tables_.grid.dimensions() : 0)) * coordinates();
  }
  /// What a face is along an axis: a node's, or the mean of two.
  [[nodiscard]] static grids::Along along(const LawFace& face, int axis) {
    return face.mu != 1 + axis ? grids::Along::average : face.upper ? grids::Along::next : grids::Along::identity;
  }

  [[nodiscard]] Expression quantity(const LawQuantity& quantity, const LawFace& face, When when) {
    using Kind = LawQuantity::Kind;
    switch (quantity.kind) {
      case Kind::field: return field(quantity.field, face, when);
      case Kind::partner: return field(quantity.field, face, when, next_along(face.mu));
      case Kind::derivative: return derivative(quantity.field, quantity.direction, face, when);
      case Kind::S: return at_place(std::array{tables_.system.expression()}, face, when).front();
    }
    return zero();
  }

  [[nodiscard]] static Offset next_along(int mu) {
    Offset offset{};
    offset[static_cast<std::size_t>(mu) - 1] = 1;
    return offset;
  }

  /// On cells the mean over the face, else the value at the node.
  [[nodiscard]] Expression field(int f, const LawFace& face, When when, Offset offset = {}) {
    SpaceOperator mean;
    for (int a = 0; on_cells_ && a < tables_.grid.dimensions(); ++a) {
      mean.box[static_cast<std::size_t>(a)] = along(face, a);
    }
    return taken(f, mean, when, offset);
  }
  [[nodiscard]] Expression derivative(int f, int nu, const LawFace& face, When when) {
    if (nu == LawTables::time) {
      if (tables_.system.structure().at_midpoints(f)) {
        return zero();  // it has no motion
      }
      return rate_ * (field(f, face, When::after) - field(f, face, When::before));
    }
    SpaceOperator difference = SpaceOperator::backward_difference(nu - 1);
    if (on_cells_) {
      difference = {};
      for (int a = 0; a < tables_.grid.dimensions(); ++a) {
        difference.box[static_cast<std::size_t>(a)] = nu == 1 + a ? grids::Along::difference : along(face, a);
      }
    }
    const Expression periodic = taken(f, difference, when, {});
    const bool absent = periodic.is_constant();
    return nu == 1 && !absent ? periodic + formulas_.slope(f) : periodic;
  }
  /// Fields at midpoints are not there at levels; a level holds their value in the middle of the step to it.
  [[nodiscard]] Expression taken(int f, const SpaceOperator& op, When when, Offset offset) {
    const bool at_midpoints = tables_.system.structure().at_midpoints(f);
    if (at_midpoints && when != When::middle) {
      return zero();
    }
    const auto at = [&](When level) {
      return formulas_.in_cell(op, level == When::before ? f : tables_.d + f, offset);
    };
    if (when != When::middle || at_midpoints) {
      return at(when == When::before ? When::before : When::after);
    }
    return 0.5 * (at(When::before) + at(When::after));
  }

  /// Formulas of the system's variables there.
  [[nodiscard]] std::vector<Expression> at_place(std::span<const Expression> formulas, const LawFace& face, When when) {
    std::vector<Expression> values;
    for (int f = 0; f < tables_.d; ++f) {
      values.push_back(field(f, face, when));
    }
    for (int c = 0; c < coordinates(); ++c) {
      values.push_back(formulas_.node(first_coordinate(face) + c));
    }
    return formula::substitute(formulas, formulas_.graph(), tables_.system.variables(), values);
  }

  const LawTables& tables_;
  bool on_cells_;
  NodeFormulas formulas_;
  Expression rate_;
};

/// Two passes: fluxes in space, and residuals, of the densities of both levels and of differences of the fluxes. On
/// cells where S names coordinates, which end at the seam, what flows out of a cell is not what flows into the next
/// one: both fluxes of a cell are part of its residual then.
class CompactLaws final : public LawEvaluator {
  [[nodiscard]] auto reads_level(const PotentialSlopes& slopes) const {
    return [this, &slopes](NodeCode& code, const FieldSet& level) {
      code.read({&level, &level, &coordinates_}, {}, slopes);
    };
  }

public:
  using General = std::function<std::unique_ptr<LawEvaluator>(LawTables)>;

  CompactLaws(LawTables tables, Collocation collocation, General general)
      : tables_(std::move(tables)),
        general_from_(std::move(general)),
        coordinates_(placed_coordinates(tables_.system, tables_.grid, collocation == Collocation::cells)) {
    const bool on_cells = collocation == Collocation::cells;
    LawFormulas formulas(tables_, on_cells);
    const std::vector<Expression> densities = formulas.currents({}, When::after);
    std::vector<Expression> fluxes, residuals = changes(formulas, densities);
    if (on_cells && !tables_.system.coordinates().empty()) {
      add_flows(formulas, residuals);
    } else {
      fluxes = LawCodes::add_differences(
          tables_.grid.dimensions(), [&](int a) { return formulas.currents({1 + a}, When::middle); },
          [&](int array, int a) { return formulas.difference(a, formulas.other_arrays() + array); }, residuals);
    }
    subtract_sources(formulas, residuals);
    codes_ = {formulas, tables_.grid, densities, fluxes, residuals};
  }

  [[nodiscard]] const LawTables& tables() const override { return tables_; }

  void share(std::shared_ptr<StageSource> stages) override {
    over_stages_ = stages != nullptr;
    if (over_stages_ || general_ != nullptr) {
      general().share(std::move(stages));
    }
  }

  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override {
    return take(before, after, h, residuals, false);
  }
  std::vector<Spread> next_residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                     std::span<double* const> residuals) override {
    return take(before, after, h, residuals, true);
  }

  std::vector<double> totals(const LatticeLevel& level) override {
    if (over_stages_) {
      return general().totals(level);
    }
    return codes_.totals(tables_.grid, tables_.names.size(), level, reads_level(level.slopes));
  }

  std::vector<double> totals_after(const LatticeLevel& after) override {
    if (over_stages_) {
      return general().totals_after(after);
    }
    return codes_.totals_after(tables_.grid, tables_.names.size(), after, reads_level(after.slopes));
  }

  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override {
    return general().multisymplectic_residual(u, v, h, residual);
  }

private:
  using When = LawFormulas::When;

  /// Of the densities, from those of the lower level.
  [[nodiscard]] static std::vector<Expression> changes(LawFormulas& formulas, std::vector<Expression> changes) {
    const std::vector<Expression> before = formulas.currents({}, When::before);
    for (std::size_t law = 0; law < changes.size(); ++law) {
      changes[law] = formulas.rate() * (changes[law] - before[law]);
    }
    return changes;
  }
  void add_flows(LawFormulas& formulas, std::vector<Expression>& sums) const {
    for (int a = 0; a < tables_.grid.dimensions(); ++a) {
      const std::vector<Expression> into = formulas.currents({1 + a}, When::middle);
      const std::vector<Expression> out = formulas.currents({1 + a, true}, When::middle);
      for (std::size_t law = 0; law < sums.size(); ++law) {
        sums[law] += (1.0 / tables_.grid.spacing(a)) * (out[law] - into[law]);
      }
    }
  }
  void subtract_sources(LawFormulas& formulas, std::vector<Expression>& sums) const {
    const std::vector<Expression> sources = formulas.sources();
    for (std::size_t c = 0; c < sources.size(); ++c) {
      Expression& momentum = sums[static_cast<std::size_t>(1 + tables_.system.coordinates()[c])];
      momentum = momentum - sources[c];
    }
  }

  std::vector<Spread> take(const LatticeLevel& before, const LatticeLevel& after, double h,
                           std::span<double* const> residuals, bool follows) {
    if (over_stages_) {
      return general().residuals(before, after, h, residuals);
    }
    const std::array numbers{1.0 / h};
    const auto read = [&](NodeCode& code) {
      code.read({&before.fields, &after.fields, &coordinates_, &codes_.of_fluxes, &codes_.levels.lower(),
                 &codes_.levels.upper()},
                numbers, after.slopes);
    };
    return codes_.take(tables_.grid, tables_.names.size(), before, after, follows, reads_level(after.slopes), read,
                       residuals);
  }
  [[nodiscard]] LawEvaluator& general() {
    if (general_ == nullptr) {
      general_ = general_from_(tables_);
    }
    return *general_;
  }

  LawTables tables_;
  General general_from_;
  std::unique_ptr<LawEvaluator> general_;
  bool over_stages_ = false;
  FieldSet coordinates_;
  LawCodes codes_;
};

}  // namespace

std::unique_ptr<LawEvaluator> make_compact_laws(LawTables tables, Collocation collocation,
                                                std::function<std::unique_ptr<LawEvaluator>(LawTables)> general) {
  return std::make_unique<CompactLaws>(std::move(tables), collocation, std::move(general));
}

}  // namespace rubato
