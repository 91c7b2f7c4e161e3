// The equations by which records are checked are written out by hand for speed. Here they are what they accelerate: the
// variations of the scheme's action by the values, and its energy, on levels that solve nothing.

#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>

#include <catch2/catch.hpp>

#include <rubato/grids/stencil.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/variation/lattice_variation.hpp>

#include "mesh_cases.hpp"

using namespace rubato;
using namespace rubato::tests;
using grids::FieldSet;
using Parts = LatticeVariation::Parts;

namespace {

/// What the rows of a step of length h make at its two levels, but for what the next step's take back at a level
/// between two: lower and upper part of ∂𝕊/∂z, so that at a level between steps they add up to the variation.
using Assembly = void (*)(const MeshCase& of, const FieldSet& rows, double h, Parts& out);

/// ½ h ΔV AᵀR at both levels, the rows -R at the points of A: z̄ is the mean of two levels. Fields that live in the slab
/// are the upper level's alone.
void assemble_midpoint(const MeshCase& of, const FieldSet& rows, double h, const grids::SpaceOperator& A, Parts& out) {
  grids::Stencil stencil(of.grid);
  for (int f = 0; f < rows.fields(); ++f) {
    const bool in_slab = of.system.structure().at_midpoints(f);
    stencil.apply_adjoint(A, rows.field(f).data(), out.after.field(f).data());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      double& upper = out.after.field(f)[i];
      upper *= (in_slab ? -1.0 : -0.5) * h * of.grid.cell_volume();
      out.before.field(f)[i] = in_slab ? 0.0 : upper;
    }
  }
}

/// Of every scheme that states an action.
const std::map<std::string, Assembly, std::less<>> assemblies = {
    {"box",
     [](const MeshCase& of, const FieldSet& rows, double h, Parts& out) {
       assemble_midpoint(of, rows, h, grids::SpaceOperator::average(of.grid.dimensions()), out);
     }},
    {"fourier", [](const MeshCase& of, const FieldSet& rows, double h,
                   Parts& out) { assemble_midpoint(of, rows, h, grids::SpaceOperator::identity(), out); }},
    // The rows of M₊ at the lower level, the others, with the opposite sign, at the upper one.
    {"euler-box",
     [](const MeshCase& of, const FieldSet& rows, double h, Parts& out) {
       for (int f = 0; f < rows.fields(); ++f) {
         const bool below = !of.system.structure().M_plus.row(f).isZero(0.0);
         for (std::size_t i = 0; i < rows.size(); ++i) {
           const double value = h * of.grid.cell_volume() * rows.field(f)[i];
           out.before.field(f)[i] = below ? value : 0.0;
           out.after.field(f)[i] = below ? 0.0 : -value;
         }
       }
     }},
    // m v + ∂𝕊/∂u of the step after, v - ∂𝕊/∂u/m of the step before.
    {"leapfrog",
     [](const MeshCase& of, const FieldSet& rows, double h, Parts& out) {
       out.before.fill(0.0);
       out.after.fill(0.0);
       for (int v = 0; v < rows.fields(); ++v) {
         for (int u = 0; u < rows.fields(); ++u) {
           const bool pair = of.system.structure().M_plus(v, u) != 0.0 || of.system.structure().M_plus(u, v) != 0.0;
           const bool moves = !of.system.K(0).row(u).isZero(0.0);
           for (std::size_t i = 0; i < rows.size() && pair && moves; ++i) {
             out.before.field(u)[i] = h * of.grid.cell_volume() * rows.field(u)[i];
             out.after.field(u)[i] = -h * of.grid.cell_volume() * of.system.M()(v, u) * rows.field(v)[i];
           }
         }
       }
     }},
};

FieldSet sum(const FieldSet& a, const FieldSet& b) {
  FieldSet result(a);
  for (std::size_t i = 0; i < result.all().size(); ++i) {
    result.all()[i] += b.all()[i];
  }
  return result;
}

}  // namespace

TEST_CASE("the equations of steps are the variations of the action by the values, on any levels") {
  std::set<std::string> seen;
  for (const MeshCase& problem : mesh_cases()) {
    for (const LatticeMethodEntry& entry : lattice_methods()) {
      const auto method = make_lattice_method({.name = std::string(entry.name)});
      const auto [system, grid] = MeshCase{method->seen(problem.system), problem.grid};
      const int d = system.field_count();
      LatticeLevel levels[3];
      for (unsigned k = 0; k < 3; ++k) {
        levels[k].fields = random_fields(d, grid.size(), 10 + k);
      }
      std::optional<LatticeAction> action;
      std::unique_ptr<StepEquation> equation;
      try {
        if (!(action = method->action(system))) {
          continue;  // a family of maps with its K in place of one: the step taken again
        }
        equation = method->equation(system, grid, levels[0], 0.0);
      } catch (const std::invalid_argument&) {
        continue;  // the scheme does not take this system
      }
      const auto assembly = assemblies.find(entry.name);
      INFO(entry.name << " of " << system.fields().front() << ", " << d << " fields");
      REQUIRE(assembly != assemblies.end());
      seen.insert(assembly->first);
      const double h[] = {0.2, method->fixed_levels_only().empty() ? 0.13 : 0.2};
      Parts from_rows[] = {{d, grid.size()}, {d, grid.size()}}, by_action(from_rows[0]), last(by_action);
      LatticeVariation variation(*std::move(action), grid);
      for (std::size_t k = 0; k < 2; ++k) {
        const StepLaw law = equation->measure(levels[k], levels[k + 1], h[k]);
        assembly->second({system, grid}, equation->rows(), h[k], from_rows[k]);
        last = by_action;
        variation.take(levels[k].fields, levels[k + 1].fields, h[k]);
        variation.values(by_action);
        // Σ of some hundred terms of order 1, to units in the last place of their sum of magnitudes.
        CHECK(std::abs(law.energy - variation.energy()) < 1e-13 * (1.0 + std::abs(law.energy)));
      }
      const FieldSet expected = sum(last.after, by_action.before), found = sum(from_rows[0].after, from_rows[1].before);
      double size = 0.0;
      for (const double value : expected.all()) {
        size = std::max(size, std::abs(value));
      }
      CHECK(size > 1e-3);
      // Of some dozen terms of order ΔV, h ΔV/Δx at most.
      CHECK(largest_difference(expected.all(), found.all()) < 1e-13);
      CHECK(std::abs(expected.field(0)[1] - found.field(0)[2]) > 1e-3);  // the twin: of another node
    }
  }
  CHECK(seen.size() == assemblies.size());
}
