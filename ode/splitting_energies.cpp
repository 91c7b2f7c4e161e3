#include <rubato/ode/splitting_energies.hpp>

#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>

#include <rubato/base/limits.hpp>
#include <rubato/formula/rolled_code.hpp>
#include <rubato/formula/single_assignment.hpp>
#include <rubato/ode/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::splitting_energies;
using formula::Expression;

/// Of which a step goes in vectors by itself, on machines that have them; asked in the same way on all.
bool goes_in_loops_by_itself(const formula::Bytecode& code) {
  return formula::roll(code, formula::single_assignment(code), SplittingEnergies::count).has_value();
}

/// Formulas that follow each other along the parts of a step: z as it is moved, and E.
struct Moving {
  std::vector<Expression> z;
  Expression energy;

  /// `change` times the gradient of a half to what it moves; `weight` times its value to E.
  void by(const SplittingHalf& half, bool drift, Expression change, Expression weight, formula::Graph& graph) {
    const std::size_t n = half.variables.size(), moved = drift ? 0 : n;
    const auto value = half.at(std::span(z).subspan(n - moved, n), graph);
    energy += weight * value[0];
    for (std::size_t i = 0; i < n; ++i) {
      z[moved + i] += change * value[1 + i];
    }
  }
};

std::vector<Expression> named(formula::Graph& graph, std::size_t count) {
  std::vector<Expression> variables;
  for (std::size_t i = 0; i < count; ++i) {
    variables.push_back(graph.variable(fmt::format("x{}", i)));
  }
  return variables;
}

/// (z, h) ↦ E: the step's own formula (splitting_formula.hpp) without what it does for the last digits of the level,
/// which would wait for each other.
formula::Bytecode whole_code(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition) {
  const std::size_t n = V.variables.size();
  formula::Graph graph;
  const std::vector<Expression> inputs = named(graph, 2 * n + 1);
  Moving step{{inputs.begin(), inputs.end() - 1}, graph.constant(0.0)};
  for (const Composition::Part& part : composition.parts) {
    step.by(part.drift ? T : V, part.drift, (part.drift ? part.length : -part.length) * inputs.back(),
            graph.constant(part.length), graph);
  }
  return {std::span(&step.energy, 1), inputs};
}

/// Of one part or two: (z, E, for each part its length times ±h and its weight) ↦ (z, E).
formula::Bytecode parts_code(const SplittingHalf& T, const SplittingHalf& V, std::span<const Composition::Part> parts) {
  const std::size_t n = V.variables.size();
  formula::Graph graph;
  const std::vector<Expression> inputs = named(graph, 2 * n + 1 + 2 * parts.size());
  Moving step{{inputs.begin(), inputs.begin() + static_cast<std::ptrdiff_t>(2 * n)}, inputs[2 * n]};
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const bool drift = parts[k].drift;
    step.by(drift ? T : V, drift, inputs[2 * n + 1 + 2 * k], inputs[2 * n + 2 + 2 * k], graph);
  }
  std::vector<Expression> outputs = step.z;
  outputs.push_back(step.energy);
  return {outputs, inputs};
}

}  // namespace

SplittingEnergies::SplittingEnergies(const SplittingHalf& T, const SplittingHalf& V, const Composition& composition)
    : composition_(&composition), n_(V.variables.size()), price_(infinity) {
  if (V.code.instructions().size() > longest_formula || goes_in_loops_by_itself(V.code)) {
    return;
  }
  is_whole_ = !is_long(T, V, composition);
  price_ = is_whole_ ? price_of_whole : price_of_parts;
  const std::size_t states = 2 * n_ + 1;
  if (is_whole_) {
    stages_.emplace_back(whole_code(T, V, composition));
    inputs_.resize(states);
    outputs_.resize(1);
    from_.resize(states);
    to_.resize(1);
    return;
  }
  // Two parts at a time, which all pairs of a composition are alike in; of an odd number the last one alone.
  const std::span parts(composition.parts);
  stages_.emplace_back(parts_code(T, V, parts.first(2)));
  if (parts.size() % 2 == 1) {
    stages_.emplace_back(parts_code(T, V, parts.last(1)));
  }
  inputs_.resize(states);
  outputs_.resize(states);
  changes_.resize(2);
  for (const Composition::Part& part : parts) {
    std::ranges::fill(weights_.emplace_back().values, part.length);
  }
  from_.resize(states + 4);
  to_.resize(states);
}

void SplittingEnergies::operator()(std::span<const double> z, std::span<const double, count> h,
                                   std::span<double, count> energies) {
  for (std::size_t i = 0; i < 2 * n_; ++i) {
    std::ranges::fill(inputs_[i].values, z[i]);
  }
  if (!is_whole_) {
    by_parts(h, energies);
    return;
  }
  std::ranges::copy(h, inputs_.back().values);
  for (std::size_t i = 0; i < inputs_.size(); ++i) {
    from_[i] = inputs_[i].values;
  }
  to_[0] = outputs_[0].values;
  stages_[0](count, from_, to_);
  std::ranges::copy(outputs_[0].values, energies.begin());
}

/// From one place of z and E to the other, and back.
void SplittingEnergies::by_parts(std::span<const double, count> h, std::span<double, count> energies) {
  const std::size_t states = 2 * n_ + 1;
  std::array<std::vector<Row>*, 2> place{&inputs_, &outputs_};
  std::ranges::fill(inputs_.back().values, 0.0);
  const std::span parts(composition_->parts);
  for (std::size_t k = 0; k < parts.size(); k += 2) {
    const std::size_t of_pair = std::min<std::size_t>(2, parts.size() - k);
    for (std::size_t i = 0; i < states; ++i) {
      from_[i] = (*place[0])[i].values;
      to_[i] = (*place[1])[i].values;
    }
    for (std::size_t j = 0; j < of_pair; ++j) {
      const double length = parts[k + j].drift ? parts[k + j].length : -parts[k + j].length;
      for (std::size_t m = 0; m < count; ++m) {
        changes_[j].values[m] = length * h[m];
      }
      from_[states + 2 * j] = changes_[j].values;
      from_[states + 2 * j + 1] = weights_[k + j].values;
    }
    stages_[of_pair == 2 ? 0 : 1](count, std::span(from_).first(states + 2 * of_pair), to_);
    std::swap(place[0], place[1]);
  }
  std::ranges::copy(place[0]->back().values, energies.begin());
}

}  // namespace rubato
