#include <algorithm>
#include <stdexcept>
#include <utility>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/stencil.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/law_engine.hpp>
#include <rubato/variation/lattice_variation.hpp>

namespace rubato {

namespace {

using grids::FieldSet;

/// The laws of euler-box: forward differences of the currents J^ν_ρ that its action has by variation, at the base
/// corners. J^ν_t reads one level alone.
class CornerLaws final : public LawEngine {
public:
  explicit CornerLaws(LawTables tables)
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
        combine(1.0, scratch_.field(0), sum_.field(l));
      }
    }
    if (!tables_.system.coordinates().empty()) {
      variation_.sources(current_);
      for (int nu = 1; nu < tables_.directions; ++nu) {
        combine(1.0, current_.field(nu), sum_.field(nu));
      }
    }
    std::vector<Spread> sizes;
    for (int l = 0; l < sum_.fields(); ++l) {
      const auto values = std::as_const(sum_).field(l);
      sizes.push_back(grids::magnitudes(values));
      if (!residuals.empty()) {
        std::ranges::copy(values, residuals[static_cast<std::size_t>(l)]);
      }
    }
    return sizes;
  }

  std::vector<double> totals(const LatticeLevel& level) override {
    take(level.fields, level.fields, 1.0);
    find(LawTables::time, level.fields);
    std::vector<double> totals;
    for (int l = 0; l < current_.fields(); ++l) {
      totals.push_back(tables_.grid.cell_volume() * grids::sum(std::as_const(current_).field(l)));
    }
    return totals;
  }

  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override {
    if (u.earlier == nullptr || v.earlier == nullptr) {
      throw std::invalid_argument("the multisymplectic law of euler-box needs tangent solutions at three levels");
    }
    FieldSet sum(1, tables_.grid.size()), form(sum);
    add_form(LawTables::time, u.before, u.after, v.before, v.after, 1.0 / h, sum.field(0));
    add_form(LawTables::time, *u.earlier, u.before, *v.earlier, v.before, -1.0 / h, sum.field(0));
    for (int mu = 1; mu < tables_.directions; ++mu) {
      form.fill(0.0);  // X_{i+1}, at node i
      add_form(mu, u.before, shifted(u.before, mu), v.before, shifted(v.before, mu), 1.0, form.field(0));
      stencil_.apply(grids::SpaceOperator::backward_difference(mu - 1), form.field(0).data(), scratch_.field(0).data());
      combine(1.0, scratch_.field(0), sum.field(0));
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
      std::ranges::copy(std::as_const(currents_).field(nu * tables_.directions + mu), current_.field(nu).begin());
    }
    tables_.symmetry_currents(mu, z.size(), z.pointers(), {},
                              current_.pointers().subspan(static_cast<std::size_t>(tables_.directions)));
  }
  void add(double factor, int mu, const FieldSet& z) {
    find(mu, z);
    for (int l = 0; l < sum_.fields(); ++l) {
      combine(factor, current_.field(l), sum_.field(l));
    }
  }

  /// out += factor x.
  static void combine(double factor, std::span<const double> x, std::span<double> out) {
    grids::for_each_block(out.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        out[i] += factor * x[i];
      }
    });
  }

  /// out += factor Σ Λ₊[r, c] (U_r V⁺_c - V_r U⁺_c).
  void add_form(int mu, const FieldSet& u, const FieldSet& u_next, const FieldSet& v, const FieldSet& v_next,
                double factor, std::span<double> out) const {
    for (const MatrixTerm& term : tables_.plus[static_cast<std::size_t>(mu)]) {
      const auto u_row = u.field(term.row), v_row = v.field(term.row);
      const auto u_column = u_next.field(term.column), v_column = v_next.field(term.column);
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] += factor * term.value * (u_row[i] * v_column[i] - v_row[i] * u_column[i]);
      }
    }
  }

  /// The neighbours' values along an axis.
  [[nodiscard]] FieldSet shifted(const FieldSet& fields, int mu) {
    FieldSet next(fields);
    for (int f = 0; f < fields.fields(); ++f) {
      stencil_.apply(grids::SpaceOperator::next(mu - 1), fields.field(f).data(), next.field(f).data());
    }
    return next;
  }

  LawTables tables_;
  LatticeVariation variation_;
  grids::Stencil stencil_;
  FieldSet currents_;                 ///< J^ν_ρ of the slab
  FieldSet current_, sum_, scratch_;  ///< J_μ of each law; residuals
};

}  // namespace

std::unique_ptr<LawEngine> make_corner_laws(LawTables tables) {
  return std::make_unique<CornerLaws>(std::move(tables));
}

}  // namespace rubato
