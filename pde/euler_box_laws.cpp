#include <algorithm>
#include <stdexcept>
#include <utility>

#include <rubato/grids/arrays.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/stencil.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/law_evaluator.hpp>
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
        currents_(tables_.directions * tables_.directions, tables_.grid.size()),
        current_(static_cast<int>(tables_.names.size()), tables_.grid.size()),
        sum_(current_),
        scratch_(1, tables_.grid.size()) {}

  [[nodiscard]] const LawTables& tables() const override { return tables_; }

  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override {
    sum_.fill(0.0);
    take(after.fields, after.fields, h);
    add(1.0 / h, LawTables::time, after.fields);
    take(before.fields, after.fields, h);
    add(-1.0 / h, LawTables::time, before.fields);
    for (int mu = 1; mu < tables_.directions; ++mu) {
      find(mu, before.fields);
      for (int l = 0; l < sum_.fields(); ++l) {
        stencil_.apply(along(mu), current_.field(l).data(), scratch_.field(0).data());
        grids::add(1.0, scratch_.field(0), sum_.field(l));
      }
    }
    if (!tables_.system.coordinates().empty()) {
      variation_.sources(current_);
      for (int nu = 1; nu < tables_.directions; ++nu) {
        grids::add(1.0, current_.field(nu), sum_.field(nu));
      }
    }
    return tell_residuals(sum_, residuals);
  }

  std::vector<double> totals(const LatticeLevel& level) override {
    take(level.fields, level.fields, 1.0);
    find(LawTables::time, level.fields);
    return grids::integrals(tables_.grid, current_);
  }

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

  void take(const FieldSet& before, const FieldSet& after, double h) {
    variation_.take(before, after, h);
    variation_.currents(currents_);
  }

  /// J_μ of all laws of the slab that was taken, z at its lower level, into current_.
  void find(int mu, const FieldSet& z) {
    for (int nu = 0; nu < tables_.directions; ++nu) {
      std::copy_n(std::as_const(currents_).field(nu * tables_.directions + mu).data(), z.size(),
                  current_.field(nu).data());
    }
    tables_.symmetry_currents(mu, z.size(), z.pointers(), {},
                              current_.pointers().subspan(static_cast<std::size_t>(tables_.directions)));
  }
  void add(double factor, int mu, const FieldSet& z) {
    find(mu, z);
    for (int l = 0; l < sum_.fields(); ++l) {
      grids::add(factor, current_.field(l), sum_.field(l));
    }
  }

  LawTables tables_;
  LatticeVariation variation_;
  grids::Stencil stencil_;
  FieldSet currents_;                 ///< J^ν_ρ of the slab
  FieldSet current_, sum_, scratch_;  ///< J_μ of each law; residuals
};

}  // namespace

std::unique_ptr<LawEvaluator> make_euler_box_laws(LawTables tables) {
  return std::make_unique<EulerBoxLaws>(std::move(tables));
}

}  // namespace rubato
