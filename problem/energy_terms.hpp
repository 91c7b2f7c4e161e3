#pragma once

#include <rubato/pde/multisymplectic_system.hpp>
#include <rubato/pde/node_formula.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// The terms of H of an orbit (formula::terms_of), in HamiltonianProblem::formula_names(); with a Lagrangian those
/// of p·q_dot - L.
[[nodiscard]] FormulaTable make_energy_terms(const Problem& problem);

/// The terms of the energy density S(z) + Σ z_{x_a}ᵀ K₊ z of a lattice (FieldStructure::K_plus), as expressions of
/// `graph`: those of S, then each of the others by itself, since a derivative that it reads takes room while it is
/// evaluated. Fields that exist in the middle of steps only count as 0: multipliers drop out of the density.
[[nodiscard]] std::vector<std::vector<formula::Expression>> energy_density_terms(const MultisymplecticSystem& system,
                                                                                 const grids::Grid& grid,
                                                                                 formula::Graph& graph);
/// A formula for each of these groups.
[[nodiscard]] std::vector<NodeFormula> make_energy_terms(const MultisymplecticSystem& system, const grids::Grid& grid);

}  // namespace rubato
