#include <rubato/pde/corner_energy.hpp>

#include <array>
#include <utility>

#include <rubato/pde/matrix_terms.hpp>
#include <rubato/pde/mirror_signs.hpp>

namespace rubato {

CornerEnergy::CornerEnergy(const MultisymplecticSystem& system, const grids::Grid& grid)
    : volume_(grid.cell_volume()), coordinates_(PlacedCoordinates(system, grid, Within::node).values()), pass_(grid) {
  using formula::Expression;
  NodeFormulas formulas(grid);
  const auto is_absent = [&](int f) { return system.structure().at_midpoints(f); };
  std::vector<Expression> z;
  for (int f = 0; f < system.field_count(); ++f) {
    z.push_back(is_absent(f) ? formulas.graph().constant(0.0) : formulas.node(f));
  }
  for (int c = 0; c < coordinates_.fields(); ++c) {
    z.push_back(formulas.node(system.field_count() + c));
  }
  Expression energy = density(system, z, [&](int f, int axis) {
    const Expression periodic = formulas.in_cell(grids::SpaceOperator::backward_difference(axis), f);
    return axis == 0 ? periodic + formulas.slope(f) : periodic;
  });
  if (grid.has_ghosts()) {
    const FieldMirrors mirrors(system, grid, Collocation::corners);
    energy = formulas.between_walls(energy, [&](const NodeInput& input) {
      std::array<int, 3> shift{};
      for (int a = 0; a < grid.dimensions() && input.number < system.field_count(); ++a) {
        shift.at(static_cast<std::size_t>(a)) = mirrors.offset(a, input.number);
      }
      return shift;
    });
  }
  pass_.add(formulas.code(std::array{energy}), {});
}

formula::Expression CornerEnergy::density(const MultisymplecticSystem& system, Variables z,
                                          const Difference& difference) {
  using formula::Expression;
  const auto is_absent = [&](int f) { return system.structure().at_midpoints(f); };
  Expression density =
      formula::substitute(std::array{system.expression()}, *z.front().graph(), system.variables(), z).front();
  for (int a = 0; a < system.directions(); ++a) {
    for (const MatrixTerm& term : terms_of(system.structure().K_plus[static_cast<std::size_t>(a)])) {
      if (is_absent(term.row) || is_absent(term.column)) {
        continue;
      }
      const Expression derivative = difference(term.row, a);
      if (!derivative.valid()) {
        return {};
      }
      add_weighted(density, term.value, derivative * z[static_cast<std::size_t>(term.column)]);
    }
  }
  return density;
}

double CornerEnergy::operator()(const grids::FieldSet& fields, const PotentialSlopes& slopes) {
  pass_.code(0).read({&fields, &coordinates_}, {}, slopes);
  pass_(0);
  return volume_ * pass_.sums().front();
}

}  // namespace rubato
