#include <rubato/variation/coordinate_variation.hpp>

#include <array>
#include <utility>

namespace rubato {

namespace {

using formula::Expression;

/// Uniform numbers of the second formula.
constexpr int number_of_earlier_h = 0, number_of_last_h = 1;

}  // namespace

CoordinateVariation::CoordinateVariation(LatticeAction action, const grids::Grid& grid)
    : variation_(std::move(action), grid), grid_(grid) {
  find_rows();
  find_balance();
}

/// The currents of all parts, and derivatives by places, without those that are zero.
void CoordinateVariation::find_rows() {
  const LatticeAction& action = this->action();
  std::vector<Expression> formulas;
  const auto add = [&](const Expression& formula, Row row) {
    if (!formula.is_constant() || formula.constant_value() != 0.0) {
      formulas.push_back(formula);
      rows_.push_back(row);
    }
  };
  for (const LatticeAction::Part& part : action.parts) {
    const std::vector<Expression> currents = variation_.currents(part);
    std::size_t current = 0;
    for (int nu = 0; nu <= action.dimensions; ++nu) {
      for (const int derivative : part.derivatives) {
        add(currents[current++], {.nu = nu, .op = derivative, .sign = -1.0});
      }
    }
  }
  for (const LatticeAction::Place& place : action.places) {
    add(variation_.by_place(place), {.nu = 1 + place.axis, .op = place.op, .sign = 1.0});
  }
  in_cells_ = variation_.code(formulas);
  last_.in_cells = grids::FieldSet(static_cast<int>(rows_.size()), grid_.size());
  earlier_.in_cells = last_.in_cells;
}

/// Of each row h ΔV (L_o)ᵀ, with the operator's weight at the upper level of the earlier slab and at the lower one of
/// the last.
void CoordinateVariation::find_balance() {
  const LatticeAction& action = this->action();
  NodeFormulas formulas(grid_);
  const Expression h = formulas.uniform(number_of_last_h), earlier_h = formulas.uniform(number_of_earlier_h);
  const int count = static_cast<int>(rows_.size());
  std::vector<Expression> sums;
  for (int nu = 0; nu <= action.dimensions; ++nu) {
    Expression differences, means, earlier_means;  // without h, and to be multiplied by it
    for (int r = 0; r < count; ++r) {
      const Row& row = rows_[static_cast<std::size_t>(r)];
      if (row.nu != nu) {
        continue;
      }
      const StencilOperator& op = action.operators[static_cast<std::size_t>(row.op)];
      for (const auto& [offset, weight] : formulas.weights(op.space)) {
        std::array<int, 3> cell{};
        for (std::size_t a = 0; a < cell.size(); ++a) {
          cell[a] = -offset[a];
        }
        const Expression later = formulas.node(count + r, cell), earlier = formulas.node(r, cell);
        const double to = row.sign * weight;
        switch (op.time) {
          case InTime::difference:
            add_weighted(differences, to, earlier);
            add_weighted(differences, -to, later);
            break;
          case InTime::mean:
            add_weighted(earlier_means, 0.5 * to, earlier);
            add_weighted(means, 0.5 * to, later);
            break;
          case InTime::after: add_weighted(earlier_means, to, earlier); break;
          case InTime::before: add_weighted(means, to, later); break;
        }
      }
    }
    Expression sum;
    for (const auto& [part, factor] : {std::pair(differences, Expression()), {earlier_means, earlier_h}, {means, h}}) {
      if (part.valid()) {
        add_weighted(sum, 1.0, factor.valid() ? factor * part : part);
      }
    }
    sums.push_back(sum.valid() ? grid_.cell_volume() * sum : formulas.graph().constant(0.0));
  }
  between_ = formulas.code(sums);
}

void CoordinateVariation::take(const grids::FieldSet& before, const grids::FieldSet& after, double h,
                               const PotentialSlopes& slopes) {
  std::swap(last_, earlier_);
  last_.h = h;
  variation_.read(in_cells_, before, after, h, slopes);
  in_cells_(last_.in_cells.pointers());
}

void CoordinateVariation::between(grids::FieldSet& out) {
  const PotentialSlopes none;
  between_.read({&earlier_.in_cells, &last_.in_cells}, std::array{earlier_.h, last_.h}, none);
  between_(out.pointers());
}

}  // namespace rubato
