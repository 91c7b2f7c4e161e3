#include <rubato/ode/splitting_formula.hpp>

#include <fmt/format.h>

namespace rubato {

using formula::Expression;

SplittingHalf::SplittingHalf(Expression energy, std::span<const Expression> of)
    : variables(of.begin(), of.end()), outputs(1, energy) {
  const auto gradient = formula::gradient(energy, of);
  outputs.insert(outputs.end(), gradient.begin(), gradient.end());
  code = formula::Bytecode(outputs, of);
}

std::vector<Expression> SplittingHalf::at(std::span<const Expression> point, formula::Graph& graph) const {
  return formula::substitute(outputs, graph, variables, point);
}

std::vector<Expression> SplittingFormula::inputs() const {
  std::vector<Expression> all = high;
  all.insert(all.end(), low.begin(), low.end());
  all.push_back(h);
  return all;
}

bool is_long(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition) {
  const std::size_t n = V.variables.size();
  std::size_t instructions = 0;
  for (const Composition::Part& part : composition.parts) {
    instructions += (part.drift ? T : V).code.instructions().size() + 4 * n;
  }
  return instructions > longest_splitting_formula;
}

std::optional<SplittingFormula> splitting_formula(const SplittingHalf& T, const SplittingHalf& V,
                                                  const Composition& composition) {
  if (is_long(T, V, composition)) {
    return std::nullopt;
  }
  const std::size_t n = V.variables.size();
  SplittingFormula step;
  step.graph = std::make_shared<formula::Graph>();
  formula::Graph& graph = *step.graph;
  for (std::size_t i = 0; i < 2 * n; ++i) {
    step.high.push_back(graph.variable(fmt::format("high{}", i)));
  }
  for (std::size_t i = 0; i < 2 * n; ++i) {
    step.low.push_back(graph.variable(fmt::format("low{}", i)));
  }
  step.h = graph.variable("h");
  step.delta.assign(2 * n, graph.constant(0.0));
  std::vector<Expression> point;
  for (std::size_t i = 0; i < 2 * n; ++i) {
    point.push_back(step.high[i] + step.low[i]);
  }
  step.energy = graph.constant(0.0);
  for (const Composition::Part& part : composition.parts) {
    const std::size_t moved = part.drift ? 0 : n;
    const auto value = (part.drift ? T : V).at(std::span(point).subspan(n - moved, n), graph);
    step.energy += part.length * value[0];
    const Expression length = (part.drift ? part.length : -part.length) * step.h;
    for (std::size_t i = 0; i < n; ++i) {
      Expression& change = step.delta[moved + i];
      change += length * value[1 + i];
      point[moved + i] = step.high[moved + i] + (step.low[moved + i] + change);
    }
  }
  return step;
}

}  // namespace rubato
