#include <rubato/variation/coordinate_variation.hpp>

#include <algorithm>
#include <array>
#include <map>
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

/// The currents of all parts, and derivatives by places, without those that are zero. What goes to the same nodes, or
/// does when it is counted to another cell, is one row: so a backward difference is a forward one of the cell before.
void CoordinateVariation::find_rows() {
  const LatticeAction& action = this->action();
  std::vector<Expression> formulas;
  const auto add = [&](int nu, int op, double sign, const auto& formula_in) {
    const StencilOperator& stencil = action.operators[static_cast<std::size_t>(op)];
    Row row{nu, stencil.time, variation_.weights(stencil.space)};
    std::ranges::sort(row.weights);
    const std::array<int, 3> first = row.weights.front().first;
    for (auto& [offset, weight] : row.weights) {
      offset = shifted(offset, first, -1);
    }
    const Expression formula = formula_in(shifted({}, first, -1));
    if (is_zero(formula)) {
      return;
    }
    const auto known = std::ranges::find(rows_, row);
    const auto number = static_cast<std::size_t>(known - rows_.begin());
    if (known == rows_.end()) {
      rows_.push_back(std::move(row));
      formulas.emplace_back();
    }
    add_weighted(formulas[number], sign, formula);
  };
  for (const LatticeAction::Part& part : action.parts) {
    std::map<std::array<int, 3>, std::vector<Expression>> in_cell;
    std::size_t current = 0;
    for (int nu = 0; nu <= action.dimensions; ++nu) {
      for (const int derivative : part.derivatives) {
        add(nu, derivative, -1.0, [&](const std::array<int, 3>& cell) {
          std::vector<Expression>& currents = in_cell[cell];
          if (currents.empty()) {
            currents = variation_.currents(part, cell);
          }
          return currents[current];
        });
        ++current;
      }
    }
  }
  for (const LatticeAction::Place& place : action.places) {
    add(1 + place.axis, place.op, 1.0,
        [&](const std::array<int, 3>& cell) { return variation_.by_place(place, cell); });
  }
  levels_ = variation_.keep(0, {}, {&formulas});
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
      for (const auto& [offset, weight] : row.weights) {
        const std::array<int, 3> cell = shifted({}, offset, -1);
        const Expression later = formulas.node(count + r, cell), earlier = formulas.node(r, cell);
        switch (row.time) {
          case InTime::difference:
            add_weighted(differences, weight, earlier);
            add_weighted(differences, -weight, later);
            break;
          case InTime::mean:
            add_weighted(earlier_means, 0.5 * weight, earlier);
            add_weighted(means, 0.5 * weight, later);
            break;
          case InTime::after: add_weighted(earlier_means, weight, earlier); break;
          case InTime::before: add_weighted(means, weight, later); break;
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
                               const PotentialSlopes& slopes, bool follows) {
  std::swap(last_, earlier_);
  last_.h = h;
  levels_.take(before, after, follows,
               [&](NodeCode& code, const grids::FieldSet& level) { variation_.read(code, level, level, 1.0, slopes); });
  variation_.read(in_cells_, before, after, h, slopes, {&levels_.lower(), &levels_.upper()});
  in_cells_(last_.in_cells.pointers());
}

void CoordinateVariation::between(grids::FieldSet& out) {
  const PotentialSlopes none;
  between_.read({&earlier_.in_cells, &last_.in_cells}, std::array{earlier_.h, last_.h}, none);
  between_(out.pointers());
}

}  // namespace rubato
