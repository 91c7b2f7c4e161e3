// The laws on the faces of cells, and at nodes, are written out by hand for speed. Here they are what they accelerate:
// differences of the currents that the action has by variation (LatticeVariation), on states that solve nothing.

#include <algorithm>
#include <cmath>
#include <utility>

#include <catch2/catch.hpp>

#include <rubato/grids/reductions.hpp>
#include <rubato/grids/stencil.hpp>
#include <rubato/pde/lattice_actions.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/variation/lattice_variation.hpp>

#include "mesh_cases.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::FieldSet;

namespace {

/// z on the lower or upper faces normal to an axis in place of its average along it.
LatticeAction restricted(LatticeAction action, int axis, bool upper) {
  for (StencilOperator& op : action.operators) {
    grids::Along& along = op.space.box[static_cast<std::size_t>(axis)];
    if (along == grids::Along::average) {
      along = upper ? grids::Along::next : grids::Along::identity;
    }
  }
  return action;
}

void add(double factor, const FieldSet& currents, int rho, int directions, FieldSet& sum) {
  for (int nu = 0; nu < directions; ++nu) {
    for (std::size_t i = 0; i < sum.size(); ++i) {
      sum.field(nu)[i] += factor * currents.field(nu * directions + rho)[i];
    }
  }
}

/// Σ_ρ D_ρ J^ν_ρ - ∂L/∂x^ν, row ν: with J_t at the levels, J_a in the middle of the step, on the faces of cells or,
/// spectrally, at nodes.
FieldSet laws_by_variation(const LatticeAction& action, const MeshCase& problem, const FieldSet& before,
                           const FieldSet& after, double h, bool spectral) {
  const auto& [system, grid] = problem;
  const int n = 1 + grid.dimensions();
  FieldSet sum(n, grid.size()), currents(n * n, grid.size());
  LatticeVariation whole(action, grid);
  for (const FieldSet* level : {&before, &after}) {
    FieldSet at_level = *level;  // without what lives in the middle of steps
    for (int f = 0; f < system.field_count(); ++f) {
      if (system.structure().at_midpoints(f)) {
        std::ranges::fill(at_level.field(f), 0.0);
      }
    }
    whole.take(at_level, at_level, h);
    currents = whole.currents();
    add(level == &after ? 1.0 / h : -1.0 / h, currents, 0, n, sum);
  }
  for (int a = 0; a < grid.dimensions(); ++a) {
    if (spectral) {
      whole.take(before, after, h);
      currents = whole.currents();
      FieldSet derivative(currents);
      for (int row = 0; row < n * n; ++row) {
        grids::Stencil(grid).apply(grids::SpaceOperator::spectral_derivative(a), currents.field(row).data(),
                                   derivative.field(row).data());
      }
      add(1.0, derivative, 1 + a, n, sum);
      continue;
    }
    for (const bool upper : {false, true}) {
      LatticeVariation face(restricted(action, a, upper), grid);
      face.take(before, after, h);
      currents = face.currents();
      add((upper ? 1.0 : -1.0) / grid.spacing(a), currents, 1 + a, n, sum);
    }
  }
  whole.take(before, after, h);
  FieldSet sources(n, grid.size());
  whole.sources(sources);
  for (std::size_t i = 0; i < sum.all().size(); ++i) {
    sum.all()[i] += sources.all()[i];
  }
  return sum;
}

}  // namespace

TEST_CASE("the local laws of energy and momentum are those of the action's currents, on any states") {
  const double h = 0.2;
  for (const MeshCase& problem : mesh_cases()) {
    for (const char* name : {"box", "fourier"}) {
      const auto& [system, grid] = problem;
      const auto method = make_lattice_method({.name = name});
      LocalLaws laws = make_local_laws(*method, system, grid);
      const LatticeLevel before{random_fields(system.field_count(), grid.size(), 1), {}},
          after{random_fields(system.field_count(), grid.size(), 2), {}};
      FieldSet found(static_cast<int>(laws.count()), grid.size());
      static_cast<void>(laws.residuals(before, after, h, found.pointers()));
      INFO(name << " of " << system.fields().front() << ", " << system.field_count() << " fields");
      const FieldSet expected = laws_by_variation(*method->action(system), problem, before.fields, after.fields, h,
                                                  std::string(name) == "fourier");
      double worst = 0.0, twin = 0.0;
      for (int nu = 0; nu < expected.fields(); ++nu) {
        worst = std::max(worst, largest_difference(expected.field(nu), found.field(nu)));
        twin = std::max(twin, std::abs(expected.field(nu)[1] - found.field(nu)[2]));
      }
      // Sums of some dozen terms of order 1 over h and Δx, 5 and 3.5, to units in the last place.
      CHECK(worst < 1e-13);
      CHECK(twin > 1e-3);
    }
  }
}
