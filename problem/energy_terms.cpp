#include <rubato/problem/energy_terms.hpp>

#include <array>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/formula/sum.hpp>

namespace rubato {

FormulaTable make_energy_terms(const Problem& problem) {
  const HamiltonianProblem& orbit = *problem.hamiltonian();
  const std::vector<std::string> names = orbit.formula_names();
  formula::Graph graph;
  std::vector<formula::Expression> terms =
      formula::terms_of(problem.build(orbit.statement(), graph, names), formula::Products::expanded);
  if (orbit.L) {
    for (std::size_t i = 0; i < orbit.q.size(); ++i) {
      terms.push_back(graph.variable(orbit.p[i]) * graph.variable(orbit.q_dot[i]));
    }
  }
  return {graph, terms, names};
}

std::vector<std::vector<formula::Expression>> energy_density_terms(const MultisymplecticSystem& system,
                                                                   const grids::Grid& grid, formula::Graph& graph) {
  std::vector<formula::Expression> absent, zeros;
  for (int f = 0; f < system.field_count(); ++f) {
    if (system.structure().at_midpoints(f)) {
      absent.push_back(system.variables()[static_cast<std::size_t>(f)]);
      zeros.push_back(graph.constant(0.0));
    }
  }
  std::vector<std::vector<formula::Expression>> terms = {formula::terms_of(
      formula::substitute(std::array{system.expression()}, graph, absent, zeros).front(), formula::Products::expanded)};
  for (int direction = 0; direction < system.directions(); ++direction) {
    const Eigen::MatrixXd& K = system.structure().K_plus[static_cast<std::size_t>(direction)];
    for (int a = 0; a < system.field_count(); ++a) {
      for (int b = 0; b < system.field_count(); ++b) {
        if (K(a, b) != 0.0 && !system.structure().at_midpoints(a) && !system.structure().at_midpoints(b)) {
          const auto name = [&](int field) { return system.fields()[static_cast<std::size_t>(field)]; };
          const std::string slope = fmt::format("d{}({})", grid.axis(direction).name, name(a));
          terms.push_back({K(a, b) * graph.variable(slope) * graph.variable(name(b))});
        }
      }
    }
  }
  return terms;
}

std::vector<NodeFormula> make_energy_terms(const MultisymplecticSystem& system, const grids::Grid& grid) {
  auto graph = std::make_shared<formula::Graph>();
  std::vector<NodeFormula> formulas;
  for (std::vector<formula::Expression>& terms : energy_density_terms(system, grid, *graph)) {
    if (!terms.empty()) {
      formulas.emplace_back(graph, std::move(terms), system.fields(), grid);
    }
  }
  return formulas;
}

}  // namespace rubato
