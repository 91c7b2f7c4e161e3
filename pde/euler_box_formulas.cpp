#include <rubato/pde/euler_box_formulas.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/placed_coordinates.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::SpaceOperator;

/// The uniform number of the code.
constexpr int number_of_factor = 0;

}  // namespace

EulerBoxFormulas::EulerBoxFormulas(const MultisymplecticSystem& system, const grids::Grid& grid,
                                   std::vector<int> derived)
    : system_(system),
      formulas_(grid),
      derived_(std::move(derived)),
      gradient_(formula::gradient(system.expression(),
                                  std::span(system.variables()).first(static_cast<std::size_t>(system.field_count())))),
      coordinates_(PlacedCoordinates(system, grid, Within::node).values()) {}

bool EulerBoxFormulas::is_derived(int field) const {
  return std::ranges::find(derived_, field) != derived_.end();
}

EulerBoxFormulas::FieldAt EulerBoxFormulas::of(Level level) {
  const int first = level == Level::before ? 0 : system_.field_count();
  return [this, first](int field, const std::array<int, 3>& offset) {
    const auto stored = [&](int f, const std::array<int, 3>& at) { return formulas_.node(first + f, at); };
    if (!is_derived(field)) {
      return stored(field, offset);
    }
    return constraint(field, field,
                      [&](int f, const std::array<int, 3>& further) { return stored(f, shifted(offset, further)); });
  };
}

Expression EulerBoxFormulas::difference(const FieldAt& z, int field, const SpaceOperator& op) {
  Expression sum;
  double scale = 1.0;
  for (const auto& [offset, weight] : formulas_.weights(op)) {
    scale = std::abs(weight);  // of both nodes: a difference of equal values is exactly 0
    add_weighted(sum, weight / scale, z(field, offset));
  }
  return scale * sum;
}

Expression EulerBoxFormulas::in_place_of_fields(Expression formula, const FieldAt& z) {
  std::vector<Expression> values;
  for (int f = 0; f < system_.field_count(); ++f) {
    values.push_back(z(f, {}));
  }
  for (int c = 0; c < coordinates_.fields(); ++c) {
    values.push_back(formulas_.node(2 * system_.field_count() + c));
  }
  return formula::substitute(std::array{formula}, formulas_.graph(), system_.variables(), values).front();
}

Expression EulerBoxFormulas::row(int number, const FieldAt& z) {
  Expression sum = in_place_of_fields(gradient_[static_cast<std::size_t>(number)], z);
  for (int a = 0; a < system_.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)])) {
      if (term.row == number) {
        add_weighted(sum, -term.value, difference(z, term.column, SpaceOperator::forward_difference(a)));
      }
      if (term.column == number) {
        add_weighted(sum, term.value, difference(z, term.row, SpaceOperator::backward_difference(a)));
      }
    }
  }
  return sum;
}

Expression EulerBoxFormulas::constraint(int number, int field, const FieldAt& z) {
  const Expression rest = row(number, [&](int f, const std::array<int, 3>& offset) {
    return f == field ? formulas_.graph().constant(0.0) : z(f, offset);
  });
  return rest / -system_.constant_hessian()(number, field);
}

NodeCode EulerBoxFormulas::kick(int number, int column) {
  const FieldAt before = of(Level::before);
  return formulas_.code(std::array{before(column, {}) + formulas_.uniform(number_of_factor) * row(number, before)});
}

NodeCode EulerBoxFormulas::solve(int number, int field) {
  const FieldAt before = of(Level::before), after = of(Level::after);
  const Expression at_first = row(number, [&](int f, const std::array<int, 3>& offset) {
    return f == field ? before(f, offset) : after(f, offset);
  });
  return formulas_.code(std::array{before(field, {}) - formulas_.uniform(number_of_factor) * at_first});
}

NodeCode EulerBoxFormulas::constraint(int number, int field) {
  return formulas_.code(std::array{constraint(number, field, of(Level::after))});
}

NodeCode EulerBoxFormulas::energy() {
  const FieldAt z = of(Level::after);
  Expression density = in_place_of_fields(system_.expression(), z);
  for (int a = 0; a < system_.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)])) {
      add_weighted(density, -term.value,
                   z(term.row, {}) * difference(z, term.column, SpaceOperator::forward_difference(a)));
    }
  }
  Expression none = formulas_.graph().constant(0.0);
  for (int f = 0; f < system_.field_count(); ++f) {
    if (!is_derived(f)) {
      none = none + 0.0 * z(f, {});
    }
  }
  return formulas_.code(std::array{density, none});
}

void EulerBoxFormulas::read(NodeCode& code, double factor, const grids::FieldSet& lower,
                            const grids::FieldSet& upper) const {
  static const PotentialSlopes none;
  code.read({&lower, &upper, &coordinates_}, std::array{factor}, none);
}

}  // namespace rubato
