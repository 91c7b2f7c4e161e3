#include <algorithm>
#include <stdexcept>
#include <utility>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/law_engine.hpp>
#include <rubato/pde/placed_coordinates.hpp>

namespace rubato {

namespace {

class CornerLaws final : public LawEngine {
public:
  explicit CornerLaws(LawTables tables)
      : tables_(std::move(tables)),
        S_(tables_.system.value_code()),
        source_(tables_.system.source_code()),
        places_(tables_.system, tables_.grid, Within::node),
        sources_(static_cast<int>(places_.count()), tables_.grid.size()),
        form_(1, tables_.grid.size()),
        scratch_(1, tables_.grid.size()) {
    differences_.assign(static_cast<std::size_t>(tables_.directions), grids::FieldSet(tables_.d, tables_.grid.size()));
  }

  [[nodiscard]] const LawTables& tables() const override { return tables_; }

  std::vector<Spread> residuals(const LatticeLevel& before, const LatticeLevel& after, double h,
                                std::span<double* const> residuals) override {
    const auto laws = static_cast<int>(tables_.names.size());
    grids::FieldSet sum(laws, tables_.grid.size());
    grids::FieldSet current(sum);
    differentiate(after.fields);
    currents(LawTables::time, after.fields, h, sum);
    differentiate(before.fields);
    differentiate_in_time(before.fields, after.fields, h);
    currents(LawTables::time, before.fields, h, current);
    for (int l = 0; l < laws; ++l) {
      combine(1.0 / h, sum.field(l), -1.0 / h, current.field(l), sum.field(l));
    }
    for (int a = 0; a < tables_.grid.dimensions(); ++a) {
      currents(1 + a, before.fields, h, current);
      for (int l = 0; l < laws; ++l) {
        grids::apply(tables_.grid, along(a), current.field(l).data(), scratch_.field(0).data());
        combine(1.0, sum.field(l), 1.0, scratch_.field(0), sum.field(l));
      }
    }
    subtract_sources(before.fields, sum);
    std::vector<Spread> sizes;
    for (int l = 0; l < laws; ++l) {
      const auto values = std::as_const(sum).field(l);
      sizes.push_back(grids::magnitudes(values));
      if (!residuals.empty()) {
        std::ranges::copy(values, residuals[static_cast<std::size_t>(l)]);
      }
    }
    return sizes;
  }

  std::vector<double> totals(const LatticeLevel& level) override {
    grids::FieldSet density(static_cast<int>(tables_.names.size()), tables_.grid.size());
    differentiate(level.fields);
    currents(LawTables::time, level.fields, 1.0, density);
    std::vector<double> totals;
    totals.reserve(tables_.names.size());
    for (int l = 0; l < density.fields(); ++l) {
      totals.push_back(tables_.grid.cell_volume() * grids::sum(std::as_const(density).field(l)));
    }
    return totals;
  }

  Spread multisymplectic_residual(const TangentLevels& u, const TangentLevels& v, double h, double* residual) override {
    if (u.earlier == nullptr || v.earlier == nullptr) {
      throw std::invalid_argument("the multisymplectic law of euler-box needs tangent solutions at three levels");
    }
    grids::FieldSet sum(1, tables_.grid.size());
    add_form(tables_.plus[LawTables::time], u.before, u.after, v.before, v.after, 1.0 / h, sum.field(0));
    add_form(tables_.plus[LawTables::time], *u.earlier, u.before, *v.earlier, v.before, -1.0 / h, sum.field(0));
    for (int a = 0; a < tables_.grid.dimensions(); ++a) {
      const grids::FieldSet u_next = shifted(u.before, a);
      const grids::FieldSet v_next = shifted(v.before, a);
      form_.fill(0.0);  // X_{i+1}, at node i
      add_form(tables_.plus[static_cast<std::size_t>(a) + 1], u.before, u_next, v.before, v_next, 1.0, form_.field(0));
      grids::apply_adjoint(tables_.grid, along(a), form_.field(0).data(), scratch_.field(0).data());
      combine(1.0, sum.field(0), -1.0, scratch_.field(0), sum.field(0));  // the adjoint of δ⁺ is -δ⁻
    }
    if (residual != nullptr) {
      std::ranges::copy(sum.field(0), residual);
    }
    return grids::magnitudes(std::as_const(sum).field(0));
  }

private:
  static grids::BoxOperator along(int axis) {
    grids::BoxOperator difference{grids::Along::identity, grids::Along::identity, grids::Along::identity};
    difference[static_cast<std::size_t>(axis)] = grids::Along::difference;
    return difference;
  }

  /// out = α x + β y; out may be x or y.
  static void combine(double alpha, std::span<const double> x, double beta, std::span<const double> y,
                      std::span<double> out) {
    grids::for_each_block(out.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        out[i] = alpha * x[i] + beta * y[i];
      }
    });
  }

  /// out += factor Σ Λ₊[r, c] (U_r V⁺_c - V_r U⁺_c).
  static void add_form(const MatrixTerms& plus, const grids::FieldSet& u, const grids::FieldSet& u_next,
                       const grids::FieldSet& v, const grids::FieldSet& v_next, double factor, std::span<double> out) {
    for (const MatrixTerm& term : plus) {
      const double weight = factor * term.value;
      const auto u_row = u.field(term.row);
      const auto v_row = v.field(term.row);
      const auto u_column = u_next.field(term.column);
      const auto v_column = v_next.field(term.column);
      grids::for_each_block(out.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
          out[i] += weight * (u_row[i] * v_column[i] - v_row[i] * u_column[i]);
        }
      });
    }
  }

  /// The neighbours' values along an axis, z_{i+1} = z_i + Δx δ⁺z.
  [[nodiscard]] grids::FieldSet shifted(const grids::FieldSet& fields, int axis) {
    grids::FieldSet next(fields);
    for (int f = 0; f < fields.fields(); ++f) {
      grids::apply(tables_.grid, along(axis), fields.field(f).data(), scratch_.field(0).data());
      combine(1.0, fields.field(f), tables_.grid.spacing(axis), scratch_.field(0), next.field(f));
    }
    return next;
  }

  /// δ_a⁺z in all directions of space.
  void differentiate(const grids::FieldSet& fields) {
    for (int a = 0; a < tables_.grid.dimensions(); ++a) {
      for (int f = 0; f < tables_.d; ++f) {
        grids::apply(tables_.grid, along(a), fields.field(f).data(),
                     differences_[static_cast<std::size_t>(a) + 1].field(f).data());
      }
    }
  }

  void differentiate_in_time(const grids::FieldSet& before, const grids::FieldSet& after, double h) {
    for (int f = 0; f < tables_.d; ++f) {
      combine(1.0 / h, after.field(f), -1.0 / h, before.field(f), differences_[LawTables::time].field(f));
    }
  }

  /// out -= factor·(δ_ν⁺z)ᵀΛ₊_μz⁺.
  void subtract_product(int mu, int nu, const grids::FieldSet& z, double h, double factor,
                        std::span<double> out) const {
    const grids::FieldSet& difference = differences_[static_cast<std::size_t>(nu)];
    const double reach = tables_.spacing(nu, h);
    for (const MatrixTerm& term : tables_.plus[static_cast<std::size_t>(mu)]) {
      const double weight = -factor * term.value;
      const auto column = z.field(term.column);
      const auto row_difference = difference.field(term.row);
      const auto column_difference = difference.field(term.column);
      grids::for_each_block(out.size(), grids::nodes_per_block, [=](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
          out[i] += weight * row_difference[i] * (column[i] + reach * column_difference[i]);
        }
      });
    }
  }

  /// J^ν_μ at the base corners, differences taken before.
  void translation(int mu, int nu, const grids::FieldSet& z, double h, std::span<double> out) {
    std::ranges::fill(out, 0.0);
    if (mu != nu) {
      subtract_product(mu, nu, z, h, 1.0, out);
      return;
    }
    double* const outputs[] = {out.data()};
    S_(out.size(), places_.after(z.pointers(), inputs_), outputs);
    for (int other = 0; other < tables_.directions; ++other) {
      if (other != nu) {
        subtract_product(other, other, z, h, -1.0, out);
      }
    }
  }

  /// sum[1 + a] -= ∂S/∂x_a at the base corners: the sources of momentum.
  void subtract_sources(const grids::FieldSet& z, grids::FieldSet& sum) {
    if (places_.count() == 0) {
      return;
    }
    source_(tables_.grid.size(), places_.after(z.pointers(), inputs_), sources_.pointers());
    for (std::size_t c = 0; c < places_.count(); ++c) {
      const auto law = sum.field(1 + tables_.system.coordinates()[c]);
      combine(1.0, law, -1.0, std::as_const(sources_).field(static_cast<int>(c)), law);
    }
  }

  /// J_μ of all laws.
  void currents(int mu, const grids::FieldSet& z, double h, grids::FieldSet& out) {
    int law = 0;
    for (int nu = 0; nu < tables_.directions; ++nu) {
      translation(mu, nu, z, h, out.field(law++));
    }
    for (const auto& symmetry : tables_.quadratic) {
      const auto values = out.field(law++);
      std::ranges::fill(values, 0.0);
      for (const MatrixTerm& term : symmetry[static_cast<std::size_t>(mu)]) {
        for (std::size_t i = 0; i < values.size(); ++i) {
          values[i] += term.value * z.field(term.row)[i] * z.field(term.column)[i];
        }
      }
    }
    for (const auto& symmetry : tables_.linear) {
      const auto values = out.field(law++);
      std::ranges::fill(values, 0.0);
      for (const MatrixTerm& term : symmetry[static_cast<std::size_t>(mu)]) {
        combine(1.0, values, term.value, z.field(term.column), values);
      }
    }
  }

  LawTables tables_;
  formula::BatchEvaluator S_, source_;
  PlacedCoordinates places_;
  std::vector<const double*> inputs_;  ///< the fields, then the coordinates
  grids::FieldSet sources_;
  std::vector<grids::FieldSet> differences_;  ///< δ_μ⁺z of the level in use
  grids::FieldSet form_, scratch_;
};

}  // namespace

std::unique_ptr<LawEngine> make_corner_laws(LawTables tables) {
  return std::make_unique<CornerLaws>(std::move(tables));
}

}  // namespace rubato
