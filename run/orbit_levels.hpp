#pragma once

#include <memory>

#include <rubato/ode/orbit_between.hpp>
#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// The states of a problem's orbit between its levels. \throws ProblemError for an 𝕃 that depends on t: of that no such
/// state is known; `asked_for` is what to leave out
[[nodiscard]] OrbitBetween make_between(const Problem& problem, std::string_view asked_for);

/// What shows the velocities of a problem that is stated by L; null for others.
[[nodiscard]] std::unique_ptr<OneStepScheme> make_velocities(const Problem& problem);

/// The momentum maps of [symmetries], among the invariants.
[[nodiscard]] std::vector<NamedFormula> momentum_maps_of(const HamiltonianProblem& orbit);

/// The constraints at a level, g and then dg/dt, as formulas of HamiltonianProblem::formula_names(); none if there are
/// none.
[[nodiscard]] FormulaTable make_constraint_table(const Problem& problem);
/// Their names among the laws: constraints/NAME and constraints/NAME_dot.
[[nodiscard]] std::vector<std::string> constraint_laws(const HamiltonianProblem& orbit);

/// (q, p) at the start.
[[nodiscard]] std::vector<double> start_of(const HamiltonianProblem& orbit);

}  // namespace rubato
