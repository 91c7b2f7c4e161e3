#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/ode/constraints.hpp>
#include <rubato/ode/orbit_methods.hpp>
#include <rubato/problem/orbit_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// \throws ProblemError if a constraint names anything but coordinates, or no coordinate
void check_constraint(const NamedFormula& constraint, const HamiltonianProblem& orbit, const Parameters& parameters) {
  std::vector<std::string> names = orbit.formula_names();
  names.emplace_back("t");
  formula::Graph graph;
  const formula::Expression value = build_formula(constraint.formula, graph, {names}, parameters);
  bool names_coordinate = false;
  for (const std::string& name : names) {
    const bool depends = !formula::derivative(value, graph.variable(name)).is_constant(0.0);
    const bool is_coordinate = std::ranges::find(orbit.q, name) != orbit.q.end();
    names_coordinate = names_coordinate || (depends && is_coordinate);
    if (depends && !is_coordinate) {
      throw ProblemError(constraint.formula.location,
                         fmt::format("the constraint {} names {}: constraints are formulas of the coordinates ({}) and "
                                     "parameters that are the same at all times",
                                     constraint.name, name, fmt::join(orbit.q, ", ")));
    }
  }
  if (!names_coordinate) {
    throw ProblemError(constraint.formula.location,
                       fmt::format("the constraint {} names no coordinate ({}); leave it out", constraint.name,
                                   fmt::join(orbit.q, ", ")));
  }
}

void check_constraint_name(const Entry& entry, const HamiltonianProblem& orbit) {
  if (!is_identifier(entry.key)) {
    refuse_name(entry, "a constraint", malformed_name);
  }
  const auto is_taken = [&](const std::string& name) {
    return std::ranges::find(orbit.constraints, name, &NamedFormula::name) != orbit.constraints.end();
  };
  constexpr std::string_view dot = "_dot";
  const std::string_view name = entry.key;
  if (is_taken(entry.key + std::string(dot)) ||
      (name.ends_with(dot) && is_taken(std::string(name.substr(0, name.size() - dot.size()))))) {
    throw ProblemError(entry.location, fmt::format("{}: the rate of a constraint is reported with _dot after its name, "
                                                   "and another constraint has that name; rename one of them",
                                                   entry.key));
  }
}

}  // namespace

void read_constraints(Section& root, HamiltonianProblem& orbit, const Parameters& parameters) {
  const auto section = root.take_section("constraints");
  if (!section) {
    return;
  }
  if (orbit.fictitious_time || orbit.driven) {
    throw ProblemError(section->location(),
                       fmt::format("[constraints] needs an H that does not name t, and no time_scale; {}",
                                   orbit.driven ? "write H without t" : "leave time_scale out"));
  }
  if (orbit.next) {
    throw ProblemError(orbit.next->location,
                       "[initial.next] begins a two-step form, and constraints are for one-step maps; leave it out");
  }
  for (const Entry& entry : section->entries()) {
    check_constraint_name(entry, orbit);
    orbit.constraints.push_back({entry.key, read_formula(entry.value, entry.key)});
    check_constraint(orbit.constraints.back(), orbit, parameters);
  }
  if (orbit.constraints.size() >= orbit.q.size()) {
    throw ProblemError(section->location(),
                       fmt::format("{} constraints on {} coordinates ({}) leave nothing to move: keep fewer",
                                   orbit.constraints.size(), orbit.q.size(), fmt::join(orbit.q, ", ")));
  }
}

void check_constrained(const Problem& problem) {
  const HamiltonianProblem* const orbit = problem.hamiltonian();
  if (orbit == nullptr || orbit->constraints.empty()) {
    return;
  }
  for (const std::string& parameter : problem.scheme.tangents.parameters) {
    for (const NamedFormula& constraint : orbit->constraints) {
      formula::Graph graph;
      std::vector<std::string> names = orbit->q;
      names.push_back(parameter);
      const formula::Expression value = problem.build(constraint.formula, graph, names);
      if (!formula::derivative(value, graph.variable(parameter)).is_constant(0.0)) {
        throw ProblemError(problem.scheme.tangents.location,
                           fmt::format("the constraint {} names {}, and a start that is held fixed would not satisfy "
                                       "it with another value: leave {} out of parameters",
                                       constraint.name, parameter, parameter));
      }
    }
  }
  if (!orbit->L) {
    try {
      require_constrained(make_hamiltonian(problem), make_discretisation(problem));
    } catch (const std::invalid_argument& error) {
      throw ProblemError(problem.scheme.lagrangian_location, error.what());
    }
  }
}

Constraints make_constraints(const Problem& problem, std::span<const std::string> q_names) {
  auto graph = std::make_shared<formula::Graph>();
  std::vector<formula::Expression> q, values;
  std::vector<std::string> names;
  for (const std::string& name : q_names) {
    q.push_back(graph->variable(name));
  }
  for (const NamedFormula& constraint : problem.hamiltonian()->constraints) {
    names.push_back(constraint.name);
    values.push_back(problem.build(constraint.formula, *graph, q_names));
  }
  return {graph, q, std::move(names), values};
}

}  // namespace rubato
