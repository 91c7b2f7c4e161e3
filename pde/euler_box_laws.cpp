#include <algorithm>
#include <stdexcept>
#include <utility>

#include <rubato/grids/arrays.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/stencil.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/law_evaluator.hpp>
#include <rubato/pde/same_bits.hpp>
#include <rubato/variation/lattice_variation.hpp>

namespace rubato {

namespace {

using grids::FieldSet;

/// The laws of euler-box: forward differences of the currents J^ν_ρ that its action has by variation, at the base
/// corners. J^ν_t reads one level alone. The law of two tangent solutions is its two-form at a node between two slabs.
class EulerBoxLaws final : public LawEvaluator {
public:
  explicit EulerBoxLaws(LawTables tables)
      : tables_(std::move(tables)),
        variation_(euler_box_action(tables_.system), tables_.grid),
        stencil_(tables_.grid),
        known_(tables_.d, tables_.grid.size()),
        density_(static_cast<int>(tables_.names.size()), tables_.grid.size()),
        symmetries_(static_cast<int>(tables_.names.size()) - tables_.directions, tables_.grid.size()),
        sum_(density_),
        sources_(tables_.system.coordinates().empty() ? 0 : tables_.directions, tables_.grid.size()),
        scratch_(1, tables_.grid.size()) {}

  [[nodiscard]] const LawTables& tables() const override { return tables_; }

  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override {
    take_level(after);
    for (int l = 0; l < sum_.fields(); ++l) {
      grids::combine(1.0 / h, std::as_const(density_).field(l), 0.0, std::as_const(density_).field(l), sum_.field(l));
    }
    variation_.take(before.fields, after.fields, h);
    slab_is_whole_ = after.slopes.of_field.empty();
    for_each_current(LawTables::time, before.fields,
                     [&](int l, std::span<const double> current) { grids::add(-1.0 / h, current, sum_.field(l)); });
    for (int mu = 1; mu < tables_.directions; ++mu) {
      for_each_current(mu, before.fields, [&](int l, std::span<const double> current) {
        stencil_.apply(along(mu), current.data(), scratch_.field(0).data());
        grids::add(1.0, scratch_.field(0), sum_.field(l));
      });
    }
    if (!tables_.system.coordinates().empty()) {
      variation_.sources(sources_);
      for (int nu = 1; nu < tables_.directions; ++nu) {
        grids::add(1.0, std::as_const(sources_).field(nu), sum_.field(nu));
      }
    }
    return tell_residuals(sum_, residuals);
  }

  std::vector<double> totals(const LatticeLevel& level) override {
    take_level(level);
    return grids::integrals(tables_.grid, density_);
  }

  [[nodiscard]] LatticeVariation* slab() override { return slab_is_whole_ ? &variation_ : nullptr; }

  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override {
    if (u.earlier == nullptr || v.earlier == nullptr) {
      throw std::invalid_argument("the multisymplectic law of euler-box needs tangent solutions at three levels");
    }
    using Parts = LatticeVariation::Parts;
    const auto pair = [](const FieldSet& lower, const FieldSet& upper) {
      Parts levels(lower.fields(), lower.size());
      levels.before = lower;
      levels.after = upper;
      return levels;
    };
    // S'' is symmetric and drops out at every node.
    LatticeVariation form(euler_box_action(tables_.system, false), tables_.grid);
    form.take(u.before, u.after, h);
    Parts into(1, tables_.grid.size()), from(into);
    form.two_form(pair(*u.earlier, u.before), pair(*v.earlier, v.before), into);
    form.two_form(pair(u.before, u.after), pair(v.before, v.after), from);
    FieldSet& sum = from.before;
    const double inverse = 1.0 / (h * tables_.grid.cell_volume());
    for (std::size_t i = 0; i < sum.size(); ++i) {
      sum.field(0)[i] = inverse * (sum.field(0)[i] + into.after.field(0)[i]);
    }
    if (residual != nullptr) {
      std::ranges::copy(sum.field(0), residual);
    }
    return grids::magnitudes(std::as_const(sum).field(0));
  }

private:
  static grids::SpaceOperator along(int mu) { return grids::SpaceOperator::forward_difference(mu - 1); }

  /// use(l, J_μ of law l) of the slab that was taken, z at its lower level.
  template <typename Use>
  void for_each_current(int mu, const FieldSet& z, const Use& use) {
    const FieldSet& currents = variation_.currents();
    for (int nu = 0; nu < tables_.directions; ++nu) {
      use(nu, currents.field(nu * tables_.directions + mu));
    }
    tables_.symmetry_currents(mu, z.size(), z.pointers(), {}, symmetries_.pointers());
    for (int l = 0; l < symmetries_.fields(); ++l) {
      use(tables_.directions + l, std::as_const(symmetries_).field(l));
    }
  }

  /// J_t of a level, which needs no other, into density_: once for the step that leads there and its totals.
  void take_level(const LatticeLevel& level) {
    if (std::exchange(is_known_, true) && same_bits(std::as_const(known_).all(), level.fields.all())) {
      return;
    }
    slab_is_whole_ = false;
    variation_.take(level.fields, level.fields, 1.0);
    for_each_current(LawTables::time, level.fields, [&](int l, std::span<const double> current) {
      std::ranges::copy(current, density_.field(l).begin());
    });
    known_.copy_from(level.fields);
  }

  LawTables tables_;
  LatticeVariation variation_;
  grids::Stencil stencil_;
  FieldSet known_;                       ///< the level that density_ is of
  FieldSet density_, symmetries_, sum_;  ///< J_t of each law; J_μ of the symmetries; residuals
  FieldSet sources_, scratch_;           ///< ∂L/∂x^ν, where S names coordinates
  bool is_known_ = false;
  bool slab_is_whole_ = false;  ///< variation_ is of the step that residuals() was asked for last
};

}  // namespace

std::unique_ptr<LawEvaluator> make_euler_box_laws(LawTables tables) {
  return std::make_unique<EulerBoxLaws>(std::move(tables));
}

}  // namespace rubato
