#include <rubato/run/solution_rows.hpp>

#include <cmath>
#include <limits>

#include <rubato/problem/formula_table.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/solve.hpp>

namespace rubato {

namespace {

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();
/// Units in the last place of the terms of H that E_k is off by.
constexpr double solution_roundings = 4.0;

}  // namespace

SolutionRows::SolutionRows(const Problem& problem, const BoundaryValueSolution& solution) {
  const NodesOfOrbit& orbit = solution.orbit;
  const Hamiltonian hamiltonian = make_hamiltonian(problem);
  const SegmentLagrangian lagrangian = make_discretisation(problem);
  NodeLaw law = make_node_law(hamiltonian, lagrangian);
  const HamiltonianProblem& system = *problem.hamiltonian();
  FormulaTable table(problem, system.invariants, system.formula_names());
  invariant_names = table.names();
  invariants.resize(invariant_names.size());
  t.push_back(problem.start());
  HamiltonianEvaluator evaluator(hamiltonian);
  const std::size_t n = system.q.size();
  std::vector<double> gradient(orbit.dimension), inputs;
  for (std::size_t k = 0; k <= orbit.segments(); ++k) {
    const NodeEnergy node = law(orbit.node(k).data());
    gamma.push_back(node.gamma);
    node_energy.push_back(node.energy);
    const std::span<const double> z = orbit.node(k);
    inputs.assign(z.begin(), z.end());
    if (system.L) {
      evaluator.gradient(z.data(), gradient.data());
      const std::span<const double> velocities = std::span(gradient).last(n);  // q̇ = ∂H/∂p
      q_dot.insert(q_dot.end(), velocities.begin(), velocities.end());
      inputs.insert(inputs.begin() + static_cast<std::ptrdiff_t>(n), velocities.begin(), velocities.end());
    }
    const std::span<const double> values = table(inputs);
    for (std::size_t i = 0; i < values.size(); ++i) {
      invariants[i].push_back(values[i]);
    }
    if (k < orbit.segments()) {
      t.push_back(t.back() + orbit.h[k]);
    }
  }
  rounding = solution_roundings * std::numeric_limits<double>::epsilon() * energy_scale(hamiltonian, orbit);
  const int order = make_segment_equation(hamiltonian, lagrangian)->order();
  h = orbit.h;
  energy = solution.energy;
  for (std::size_t k = 0; k < orbit.segments(); ++k) {
    const StepPotential::Part f = solution.potential.at(h[k]);
    potential.push_back(f.energy);
    // dE/dh along the solved step, by the node laws at both its ends.
    const double mean = 0.5 * (node_energy[k] + node_energy[k + 1]);
    const double slope = order * (energy[k] - f.energy - mean) / h[k] + f.slope;
    const double left = std::abs(energy[k] - solution.conserved) + rounding;
    condition.push_back(problem.scheme.levels == Levels::variable ? left / std::abs(h[k] * slope) : undefined);
  }
}

figures::Statistics SolutionRows::statistics(const BoundaryValueSolution& solution) const {
  figures::Statistics result;
  result.name(invariant_names, {}, {}, {});
  std::vector<double> values(invariants.size());
  for (std::size_t k = 0; k < t.size(); ++k) {
    result.add_level({.t = t[k], .node_energy = node_energy[k], .gamma = gamma[k]});
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = invariants[i][k];
    }
    result.add_laws(values, {});
    if (k > 0) {
      result.add_step({.h = h[k - 1],
                       .energy = energy[k - 1],
                       .target = solution.conserved,
                       .condition = condition[k - 1],
                       .rounding = rounding,
                       .potential = potential[k - 1],
                       .iterations = 0.0,
                       .off_law = false});
    }
  }
  if (solution.potential.active()) {
    result.potential_length = solution.potential.length;
    result.potential_exponent = solution.potential.exponent;
  }
  return result;
}

BoundaryValueOptions make_boundary_value_options(const Problem& problem) {
  const StatedSolve& stated = *problem.solve;
  BoundaryValueOptions options{.lagrangian = make_discretisation(problem),
                               .levels = problem.scheme.levels,
                               .potential = problem.scheme.potential,
                               .duration = stated.duration,
                               .energy = stated.energy,
                               .tolerance = stated.tolerance,
                               .most_iterations = stated.most_iterations};
  if (problem.scheme.usual_potential) {
    options.potential.kind = StepPotentialChoice::Kind::usual;
  }
  if (stated.energy_of_start) {
    const HamiltonianProblem& system = *problem.hamiltonian();
    std::vector<double> z = system.initial.q;
    z.insert(z.end(), system.initial.p.begin(), system.initial.p.end());
    options.energy = HamiltonianEvaluator(make_hamiltonian(problem)).value(z.data());
  }
  return options;
}

}  // namespace rubato
