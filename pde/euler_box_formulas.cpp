#include <rubato/pde/euler_box_formulas.hpp>

#include <array>
#include <numeric>

#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/placed_coordinates.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::SpaceOperator;

/// The uniform number of the code.
constexpr int number_of_inverse = 0;
constexpr int lower_level = 0, upper_level = 1;

}  // namespace

EulerBoxFormulas::EulerBoxFormulas(const MultisymplecticSystem& system, const grids::Grid& grid)
    : system_(system),
      formulas_(grid),
      gradient_(formula::gradient(system.expression(),
                                  std::span(system.variables()).first(static_cast<std::size_t>(system.field_count())))),
      coordinates_(PlacedCoordinates(system, grid, Within::node).values()) {}

std::vector<int> EulerBoxFormulas::arrays_of(int level) const {
  std::vector<int> arrays(static_cast<std::size_t>(system_.field_count()));
  std::iota(arrays.begin(), arrays.end(), level * system_.field_count());
  return arrays;
}

std::vector<Expression> EulerBoxFormulas::values(const std::vector<int>& arrays) {
  std::vector<Expression> z;
  for (const int array : arrays) {
    z.push_back(formulas_.node(array));
  }
  for (int c = 0; c < coordinates_.fields(); ++c) {
    z.push_back(formulas_.node(2 * system_.field_count() + c));
  }
  return z;
}

Expression EulerBoxFormulas::row(int number, const std::vector<int>& arrays) {
  Expression sum = formula::substitute(std::array{gradient_[static_cast<std::size_t>(number)]}, formulas_.graph(),
                                       system_.variables(), values(arrays))
                       .front();
  for (int a = 0; a < system_.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)])) {
      const auto difference = [&](int field, const SpaceOperator& op) {
        return formulas_.in_cell(op, arrays[static_cast<std::size_t>(field)]);
      };
      if (term.row == number) {
        add_weighted(sum, -term.value, difference(term.column, SpaceOperator::forward_difference(a)));
      }
      if (term.column == number) {
        add_weighted(sum, term.value, difference(term.row, SpaceOperator::backward_difference(a)));
      }
    }
  }
  return sum;
}

NodeCode EulerBoxFormulas::at_level(std::span<const int> rows) {
  std::vector<Expression> outputs;
  for (const int number : rows) {
    outputs.push_back(row(number, arrays_of(lower_level)));
  }
  outputs.push_back(energy_density());
  return formulas_.code(outputs);
}

NodeCode EulerBoxFormulas::solve(int number, int field) {
  std::vector<int> arrays = arrays_of(upper_level);
  arrays[static_cast<std::size_t>(field)] = field;  // of the level before
  return formulas_.code(std::array{formulas_.node(field) - formulas_.uniform(number_of_inverse) * row(number, arrays)});
}

Expression EulerBoxFormulas::energy_density() {
  const std::vector<Expression> z = values(arrays_of(lower_level));
  Expression density =
      formula::substitute(std::array{system_.expression()}, formulas_.graph(), system_.variables(), z).front();
  for (int a = 0; a < system_.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system_.structure().K_plus[static_cast<std::size_t>(a)])) {
      add_weighted(
          density, -term.value,
          z[static_cast<std::size_t>(term.row)] * formulas_.in_cell(SpaceOperator::forward_difference(a), term.column));
    }
  }
  return density;
}

void EulerBoxFormulas::read(NodeCode& code, double inverse, const grids::FieldSet& lower,
                            const grids::FieldSet& upper) const {
  static const PotentialSlopes none;
  code.read({&lower, &upper, &coordinates_}, std::array{inverse}, none);
}

}  // namespace rubato
