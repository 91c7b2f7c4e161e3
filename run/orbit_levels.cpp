#include <rubato/run/orbit_levels.hpp>

#include <algorithm>
#include <iterator>

#include <fmt/format.h>

#include <rubato/figures/statistics.hpp>
#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/variation/total_variation.hpp>

namespace rubato {

namespace {

/// Of an 𝕃 that depends on t no state between levels is known: H does not show its rates.
void refuse_dependence_on_time(const Problem& problem, std::string_view asked_for) {
  if (problem.scheme.lagrangian != LagrangianName::custom) {
    return;
  }
  const auto action = make_action(make_hamiltonian(problem), make_discretisation(problem));
  const std::vector<double> z = start_of(*problem.hamiltonian());
  const double start = problem.start(), step = problem.scheme.step.value_or(1.0);
  std::vector<double> corners = {start};
  corners.insert(corners.end(), z.begin(), z.end());
  corners.push_back(start + step);
  corners.insert(corners.end(), z.begin(), z.end());
  if (!is_autonomous(*action, corners)) {
    throw ProblemError(problem.scheme.L->location,
                       fmt::format("L depends on t, and states between levels would be interpolated with the rates of "
                                   "H, which does not: leave out {}; every level is stored with every = 1",
                                   asked_for));
  }
}

std::unique_ptr<OneStepScheme> make_quadrature(const Problem& problem) {
  const PhasePoint& start = problem.hamiltonian()->initial;
  return make_one_step_scheme(make_lagrangian(problem).without_constant(), make_discretisation(problem), start.q,
                              start.q_dot);
}

}  // namespace

std::vector<NamedFormula> momentum_maps_of(const HamiltonianProblem& orbit) {
  std::vector<NamedFormula> maps;
  std::ranges::copy_if(orbit.invariants, std::back_inserter(maps), [&](const NamedFormula& invariant) {
    return std::ranges::find(orbit.symmetries, invariant.name) != orbit.symmetries.end();
  });
  return maps;
}

FormulaTable make_constraint_table(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  formula::Graph graph;
  std::vector<formula::Expression> values, rates;
  if (!orbit.constraints.empty()) {
    std::vector<formula::Expression> q, velocities;
    for (const std::string& name : orbit.q) {
      q.push_back(graph.variable(name));
    }
    if (orbit.L) {
      std::ranges::transform(orbit.q_dot, std::back_inserter(velocities),
                             [&](const std::string& name) { return graph.variable(name); });
    } else {
      std::vector<formula::Expression> p;
      std::ranges::transform(orbit.p, std::back_inserter(p),
                             [&](const std::string& name) { return graph.variable(name); });
      velocities = formula::gradient(problem.build(orbit.H, graph, orbit.names()), p);
    }
    for (const NamedFormula& constraint : orbit.constraints) {
      values.push_back(problem.build(constraint.formula, graph, orbit.q));
      const std::vector<formula::Expression> row = formula::gradient(values.back(), q);
      formula::Expression rate = row.front() * velocities.front();
      for (std::size_t a = 1; a < q.size(); ++a) {
        rate = rate + row[a] * velocities[a];
      }
      rates.push_back(rate);
    }
    std::ranges::copy(rates, std::back_inserter(values));
  }
  return {graph, values, orbit.formula_names()};
}

std::vector<std::string> constraint_laws(const HamiltonianProblem& orbit) {
  std::vector<std::string> names;
  for (const char* suffix : {"", "_dot"}) {
    for (const NamedFormula& constraint : orbit.constraints) {
      names.push_back(fmt::format("{}{}{}", figures::constraint_group, constraint.name, suffix));
    }
  }
  return names;
}

std::vector<double> start_of(const HamiltonianProblem& orbit) {
  std::vector<double> z = orbit.initial.q;
  z.insert(z.end(), orbit.initial.p.begin(), orbit.initial.p.end());
  return z;
}

OrbitBetween make_between(const Problem& problem, std::string_view asked_for) {
  refuse_dependence_on_time(problem, asked_for);
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  const std::vector<double> z = start_of(orbit);
  if (orbit.L) {
    return {make_quadrature(problem), z.size()};
  }
  return {make_hamiltonian(problem), make_discretisation(problem), orbit.next.has_value(), z};
}

std::unique_ptr<OneStepScheme> make_velocities(const Problem& problem) {
  return problem.hamiltonian()->L ? make_quadrature(problem) : nullptr;
}

}  // namespace rubato
