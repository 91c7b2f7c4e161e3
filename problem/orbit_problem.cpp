#include <rubato/problem/orbit_problem.hpp>

#include <fmt/format.h>

#include <rubato/ode/first_step.hpp>
#include <rubato/ode/legendre.hpp>
#include <rubato/problem/scheme_options.hpp>

namespace rubato {

namespace {

Generating make_generating(const Scheme& scheme) {
  Generating generating{.order = *scheme.order};
  switch (scheme.darboux) {
    case DarbouxKind::midpoint: generating.darboux = DarbouxType::midpoint; break;
    case DarbouxKind::euler_a: generating.darboux = DarbouxType::euler_a; break;
    case DarbouxKind::euler_b: generating.darboux = DarbouxType::euler_b; break;
    case DarbouxKind::matrix: {
      const auto size = static_cast<Eigen::Index>(scheme.darboux_matrix->size);
      generating.darboux = Eigen::MatrixXd(
          Eigen::Map<const Eigen::MatrixXd>(scheme.darboux_matrix->entries.data(), size, size));  // symmetric
      break;
    }
  }
  return generating;
}

/// 𝕃 as a formula of the corners alone: parameters and definitions put in.
Custom make_custom(const Problem& problem) {
  formula::Graph graph;
  return {.L = to_string(problem.build(*problem.scheme.L, graph, custom_lagrangian_names(*problem.hamiltonian())))};
}

}  // namespace

formula::Expression build_hamiltonian(const Problem& problem, formula::Graph& graph,
                                      std::span<const std::string> parameters) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  std::vector<std::string> names = orbit.L ? orbit.lagrangian_names() : orbit.names();
  names.insert(names.end(), parameters.begin(), parameters.end());
  const formula::Expression stated = problem.build(orbit.statement(), graph, names);
  if (!orbit.L) {
    return stated;
  }
  std::vector<formula::Expression> q_dot, p;
  for (std::size_t i = 0; i < orbit.q.size(); ++i) {
    q_dot.push_back(graph.variable(orbit.q_dot[i]));
    p.push_back(graph.variable(orbit.p[i]));
  }
  try {
    return legendre_transform(stated, q_dot, p);
  } catch (const std::invalid_argument& error) {
    throw ProblemError(orbit.L->location,
                       fmt::format("{}: state the problem by its H, in [hamiltonian]", error.what()));
  }
}

Hamiltonian make_hamiltonian(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  auto graph = std::make_shared<formula::Graph>();
  const formula::Expression H = build_hamiltonian(problem, *graph);
  return Hamiltonian(graph, orbit.q, orbit.p, H).constrained(make_constraints(problem, orbit.q));
}

Hamiltonian make_hamiltonian(const Problem& problem, std::span<const std::string> parameters, bool as_momenta) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  auto graph = std::make_shared<formula::Graph>();
  std::vector<std::string> q = orbit.q, p = orbit.p;
  const formula::Expression H = build_hamiltonian(problem, *graph, parameters);
  for (const std::string& name : parameters) {
    (as_momenta ? p : q).push_back(name);
    (as_momenta ? q : p).push_back("partner of " + name);  // no name of a user's
  }
  for (const std::vector<std::string>* list : {&q, &p}) {
    for (const std::string& name : *list) {
      static_cast<void>(graph->variable(name));
    }
  }
  return Hamiltonian(graph, q, p, H).constrained(make_constraints(problem, q));
}

Lagrangian make_lagrangian(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  auto graph = std::make_shared<formula::Graph>();
  const formula::Expression L = problem.build(*orbit.L, *graph, orbit.lagrangian_names());
  return Lagrangian(graph, orbit.q, orbit.q_dot, L).constrained(make_constraints(problem, orbit.q));
}

SegmentLagrangian make_discretisation(const Problem& problem) {
  const Scheme& scheme = problem.scheme;
  switch (scheme.lagrangian) {
    case LagrangianName::midpoint: return Midpoint{};
    case LagrangianName::forward: return Forward{.allow_unstable = scheme.allow_unstable};
    case LagrangianName::custom: return make_custom(problem);
    case LagrangianName::generating: return make_generating(scheme);
    case LagrangianName::gauss: return Gauss{.stages = *scheme.stages};
    case LagrangianName::splitting: return Splitting{.composition = scheme.composition};
    case LagrangianName::trapezoid: return Trapezoid{};
    case LagrangianName::lobatto: return Lobatto{.points = *scheme.stages};
    default:
      throw ProblemError(
          scheme.lagrangian_location,
          fmt::format("lagrangian = \"{}\" is not available for an orbit in this version", scheme.word()));
  }
}

IntegrationOptions make_integration_options(const Problem& problem) {
  IntegrationOptions options{.lagrangian = make_discretisation(problem),
                             .max_steps = static_cast<std::size_t>(problem.scheme.max_steps)};
  set_run_options(problem.scheme, options);
  if (const std::optional<PhasePoint>& next = problem.hamiltonian()->next) {
    options.next = InitialState{.q = next->q, .p = next->p, .t = next->t};
  }
  return options;
}

OrbitIntegrator make_integrator(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  const Scheme& scheme = problem.scheme;
  IntegrationOptions options = make_integration_options(problem);
  const auto make = [&](const auto& system, const auto& initial) {
    if (!scheme.step) {
      options.step = choose_first_step(system, initial, options, *scheme.energy_tolerance);
    }
    return OrbitIntegrator(system, initial, options);
  };
  try {
    return orbit.L ? make(make_lagrangian(problem),
                          InitialMotion{.q = orbit.initial.q, .q_dot = orbit.initial.q_dot, .t = orbit.initial.t})
                   : make(make_hamiltonian(problem),
                          InitialState{.q = orbit.initial.q, .p = orbit.initial.p, .t = orbit.initial.t});
  } catch (const ProblemError&) {
    throw;
  } catch (const StartingPairError& error) {
    throw ProblemError(orbit.next->location, error.what());
  } catch (const StepPotentialError& error) {
    throw ProblemError(scheme.potential_location, error.what());
  } catch (const UnstableError& error) {
    throw ProblemError(scheme.lagrangian_location, error.what());
  } catch (const std::invalid_argument& error) {
    throw ProblemError(orbit.initial.location, error.what());
  }
}

std::vector<std::string> custom_lagrangian_names(const HamiltonianProblem& problem) {
  std::vector<std::string> names;
  const auto coordinates = problem.names();
  for (const std::string_view suffix : {"_0", "_1"}) {
    names.push_back(fmt::format("t{}", suffix));
    for (const std::string& name : coordinates) {
      names.push_back(fmt::format("{}{}", name, suffix));
    }
  }
  return names;
}

}  // namespace rubato
