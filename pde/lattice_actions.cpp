#include <rubato/pde/lattice_actions.hpp>

#include <algorithm>
#include <array>
#include <stdexcept>

#include <rubato/pde/matrix_terms.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::SpaceOperator;

bool has_potential(const MultisymplecticSystem& system) {
  return std::ranges::find(system.structure().potential, true) != system.structure().potential.end();
}

MatrixTerms full(const MultisymplecticSystem& system, int rho) {
  return terms_of(rho == 0 ? system.M() : system.K(rho - 1));
}

MatrixTerms plus(const MultisymplecticSystem& system, int rho) {
  const FieldStructure& structure = system.structure();
  return terms_of(rho == 0 ? structure.M_plus : structure.K_plus[static_cast<std::size_t>(rho) - 1]);
}

/// S at the values that one operator gives.
Expression potential_at(const MultisymplecticSystem& system, LatticeActionBuilder& build, int op) {
  std::vector<Expression> z;
  for (int f = 0; f < system.field_count(); ++f) {
    z.push_back(build.value(f, op));
  }
  for (const int axis : system.coordinates()) {
    z.push_back(build.place(axis, op));
  }
  return formula::substitute(std::array{system.expression()}, build.graph(), system.variables(), z).front();
}

LatticeActionBuilder builder_for(const MultisymplecticSystem& system) {
  LatticeActionBuilder build(system.field_count(), system.directions());
  for (int f = 0; f < system.field_count(); ++f) {
    if (system.structure().at_midpoints(f)) {
      build.set_at_midpoints(f);
    }
  }
  return build;
}

/// The stencil of one place: all of L there.
LatticeAction action_at(const MultisymplecticSystem& system, const StencilOperator& place,
                        const std::vector<StencilOperator>& derivatives, bool split) {
  LatticeActionBuilder build = builder_for(system);
  const int z = build.add(place);
  for (const StencilOperator& derivative : derivatives) {
    build.add_derivative(derivative);
  }
  for (int mu = 0; mu <= system.directions(); ++mu) {
    for (const MatrixTerm& term : split ? plus(system, mu) : full(system, mu)) {
      build.add_form(mu, [&](int rho) {
        return split ? -term.value * (build.derivative(term.row, rho) * build.value(term.column, z))
                     : 0.5 * term.value * (build.value(term.row, z) * build.derivative(term.column, rho));
      });
    }
  }
  return build.finish(-potential_at(system, build, z));
}

}  // namespace

LatticeAction box_action(const MultisymplecticSystem& system) {
  const int n = system.directions();
  std::vector<StencilOperator> derivatives = {{InTime::difference, SpaceOperator::average(n)}};
  for (int a = 0; a < n; ++a) {
    derivatives.push_back({InTime::mean, SpaceOperator::box_difference(a, n)});
  }
  return action_at(system, {InTime::mean, SpaceOperator::average(n)}, derivatives, has_potential(system));
}

LatticeAction fourier_action(const MultisymplecticSystem& system) {
  std::vector<StencilOperator> derivatives = {{InTime::difference, SpaceOperator::identity()}};
  for (int a = 0; a < system.directions(); ++a) {
    derivatives.push_back({InTime::mean, SpaceOperator::spectral_derivative(a)});
  }
  return action_at(system, {InTime::mean, SpaceOperator::identity()}, derivatives, true);
}

LatticeAction euler_box_action(const MultisymplecticSystem& system, bool with_S) {
  LatticeActionBuilder build(system.field_count(), system.directions());
  const int base = build.add({InTime::before, SpaceOperator::identity()});
  build.add_derivative({InTime::difference, SpaceOperator::identity()});
  std::vector<int> next = {build.add({InTime::after, SpaceOperator::identity()})};
  for (int a = 0; a < system.directions(); ++a) {
    build.add_derivative({InTime::before, SpaceOperator::forward_difference(a)});
    next.push_back(build.add({InTime::before, SpaceOperator::next(a)}));
  }
  const bool split = has_potential(system);
  for (int mu = 0; mu <= system.directions(); ++mu) {
    for (const MatrixTerm& term : plus(system, mu)) {
      // zᵀΛ₊δ⁺z = δ⁺(zᵀΛ₊z) - (δ⁺z)ᵀΛ₊z⁺, z⁺ the neighbour in the direction of δ⁺.
      build.add_form(mu, [&](int rho) {
        return split ? -term.value * (build.derivative(term.row, rho) *
                                      build.value(term.column, next[static_cast<std::size_t>(rho)]))
                     : term.value * (build.value(term.row, base) * build.derivative(term.column, rho));
      });
    }
  }
  return build.finish(with_S ? -potential_at(system, build, base) : build.graph().constant(0.0));
}

}  // namespace rubato
