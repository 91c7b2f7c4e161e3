#include <algorithm>
#include <array>
#include <span>

#include <fmt/format.h>

#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// \throws ProblemError if L names no field, or a place that the equation does not depend on
void check_density(const Problem& problem, const FormulaText& text, const CornerDensity& density) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  bool names_any = false;
  for (int f = 0; f < density.fields; ++f) {
    names_any = names_any || density.names(f);
  }
  if (!names_any) {
    throw ProblemError(text.location,
                       fmt::format("L names no value of a field: those at the corners of a cell are {}, …",
                                   corner_names(pde.fields, density.dimensions).front()));
  }
  formula::Graph graph;
  const std::vector<std::string> quantities = quantity_names(pde);
  const auto of_S = formula::variables_of(problem.build(pde.S, graph, quantities));
  for (int a = 0; a < density.dimensions; ++a) {
    const std::string& axis = pde.axes[static_cast<std::size_t>(a)].name;
    const auto number = formula::variables_of(graph.variable(axis)).front();
    if (density.names_place(a) && std::ranges::find(of_S, number) == of_S.end()) {
      throw ProblemError(text.location,
                         fmt::format("L names {0}, and S does not: the equation is the same at every {0}, so leave {0} "
                                     "out of L",
                                     axis));
    }
  }
}

/// Of a driven system: t, which is that of the lower level, by the field `time`, and the part of `time` and
/// `minus_work`, the last two fields.
void extend_by_time(CornerDensity& density) {
  const int clock = density.fields - 2, work = density.fields - 1, upper = density.corner_count() / 2;
  const formula::Expression t = density.graph->variable("t"), h = density.spacings.front();
  const auto mean = [&](int field) { return 0.5 * (density.corner(field, 0) + density.corner(field, upper)); };
  density.L = formula::substitute(density.L, std::array{t}, std::array{mean(clock) - 0.5 * h}) +
              mean(work) * ((density.corner(clock, upper) - density.corner(clock, 0)) / h - 1.0);
}

}  // namespace

std::shared_ptr<const CornerDensity> read_corner_density(const FormulaText& text, const Problem& problem) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  const int dimensions = static_cast<int>(pde.axes.size());
  CornerDensity density = corner_variables(pde.fields, dimensions);
  std::vector<std::string> names = corner_names(pde.fields, dimensions);
  if (pde.driven) {
    names.emplace_back("t");
  }
  density.L = build_formula(text, *density.graph, {names}, problem.parameters);
  check_density(problem, text, density);
  if (pde.driven) {
    extend_by_time(density);
  }
  check_density_jumps(pde, text, density);
  check_density_twists(problem, text, density);
  check_density_walls(problem, text, density);
  return std::make_shared<CornerDensity>(make_jumps(problem).seen(std::move(density)));
}

}  // namespace rubato
