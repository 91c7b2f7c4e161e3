#include <rubato/ode/splitting_formula.hpp>

#include <initializer_list>

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

SplittingState::SplittingState(std::size_t n, formula::Graph& graph) {
  std::size_t next = 0;
  for (auto* const part : {&low_q_, &q_, &p_, &low_p_}) {
    for (std::size_t i = 0; i < n; ++i) {
      part->push_back(graph.variable(fmt::format("x{}", next++)));
    }
  }
}

namespace {

std::vector<Expression> one_after_another(std::initializer_list<std::span<const Expression>> pieces) {
  std::vector<Expression> all;
  for (const std::span<const Expression> piece : pieces) {
    all.insert(all.end(), piece.begin(), piece.end());
  }
  return all;
}

}  // namespace

std::vector<Expression> SplittingState::all() const {
  return one_after_another({low_q_, q_, p_, low_p_});
}
std::vector<Expression> SplittingState::positions() const {
  return one_after_another({low_q_, q_});
}
std::vector<Expression> SplittingState::momenta() const {
  return one_after_another({p_, low_p_});
}
std::vector<Expression> SplittingState::high() const {
  return one_after_another({q_, p_});
}
std::vector<Expression> SplittingState::move(const SplittingHalf& half, bool drift, Expression length) {
  std::vector<Expression> value = half.at(drift ? p_ : q_, *length.graph());
  move_along(std::span(value).subspan(1), drift, length);
  return value;
}

void SplittingState::move_along(std::span<const Expression> gradient, bool drift, Expression length) {
  auto& moved = drift ? q_ : p_;
  auto& low = drift ? low_q_ : low_p_;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const Expression change = low[i] + length * gradient[i];
    const Expression sum = moved[i] + change;
    low[i] = change - (sum - moved[i]);
    moved[i] = sum;
  }
}

std::vector<Expression> SplittingFormula::inputs() const {
  std::vector<Expression> all = here.all();
  all.push_back(h);
  return all;
}

bool is_long(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition) {
  if (T.code.loops() != nullptr || V.code.loops() != nullptr) {
    return true;
  }
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
  const auto shared = std::make_shared<formula::Graph>();
  formula::Graph& graph = *shared;
  const SplittingState here(n, graph);
  SplittingFormula step{
      .graph = shared, .here = here, .there = here, .h = graph.variable("h"), .energy = graph.constant(0.0)};
  for (const Composition::Part& part : composition.parts) {
    const SplittingHalf& half = part.drift ? T : V;
    const Expression value = step.there.move(half, part.drift, (part.drift ? part.length : -part.length) * step.h)[0];
    step.energy += part.length * value;
  }
  return step;
}

}  // namespace rubato
