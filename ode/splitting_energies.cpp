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
    make_rows(states);
    stages_.emplace_back(whole_code(T, V, composition));
    bind(stages_[0], rows_[0], rows_[1].first(1));
    return;
  }
  // Two parts at a time, which all pairs of a composition are alike in; of an odd number the last one alone.
  make_rows(states + 4);
  const std::span parts(composition.parts);
  stages_.reserve(4);
  for (const std::size_t of_pair : {std::size_t{2}, parts.size() % 2}) {
    if (of_pair == 0) {
      continue;
    }
    const formula::Bytecode code = parts_code(T, V, of_pair == 2 ? parts.first(2) : parts.last(1));
    for (std::size_t from = 0; from < 2; ++from) {
      stages_.emplace_back(code);
      bind(stages_.back(), rows_[from].first(states + 2 * of_pair), rows_[1 - from].first(states));
    }
  }
}

/// Two places for so many rows. What is written to one is not to stand where the next numbers of the other are read
/// from, by the last twelve bits of addresses, which is all that processors look at before they let a load go ahead of
/// a store.
void SplittingEnergies::make_rows(std::size_t count_of_rows) {
  constexpr std::size_t page = 4096 / sizeof(Row), half = page / 2;
  const std::size_t apart = (count_of_rows + half) / page * page + half;
  memory_.resize(apart + count_of_rows);
  rows_ = {std::span(memory_).first(count_of_rows), std::span(memory_).last(count_of_rows)};
}

void SplittingEnergies::bind(formula::BatchEvaluator& stage, std::span<Row> from, std::span<Row> to) {
  std::vector<const double*> inputs;
  std::vector<double*> outputs;
  for (const Row& row : from) {
    inputs.push_back(row.values);
  }
  for (Row& row : to) {
    outputs.push_back(row.values);
  }
  stage.bind(count, inputs, outputs);
}

void SplittingEnergies::operator()(std::span<const double> z, std::span<const double, count> h,
                                   std::span<double, count> energies) {
  for (std::size_t i = 0; i < 2 * n_; ++i) {
    std::ranges::fill(rows_[0][i].values, z[i]);
  }
  if (!is_whole_) {
    by_parts(h, energies);
    return;
  }
  std::ranges::copy(h, rows_[0][2 * n_].values);
  stages_[0].run();
  std::ranges::copy(rows_[1][0].values, energies.begin());
}

/// From one place of z and E to the other, and back.
void SplittingEnergies::by_parts(std::span<const double, count> h, std::span<double, count> energies) {
  const std::size_t states = 2 * n_ + 1;
  std::ranges::fill(rows_[0][2 * n_].values, 0.0);
  std::size_t place = 0;
  const std::span parts(composition_->parts);
  for (std::size_t k = 0; k < parts.size(); k += 2) {
    const std::size_t of_pair = std::min<std::size_t>(2, parts.size() - k);
    for (std::size_t j = 0; j < of_pair; ++j) {
      const double length = parts[k + j].drift ? parts[k + j].length : -parts[k + j].length;
      Row* const takes = &rows_[place][states + 2 * j];
      for (std::size_t m = 0; m < count; ++m) {
        takes[0].values[m] = length * h[m];
      }
      std::ranges::fill(takes[1].values, parts[k + j].length);
    }
    stages_[(of_pair == 2 ? 0 : 2) + place].run();
    place = 1 - place;
  }
  std::ranges::copy(rows_[place][2 * n_].values, energies.begin());
}

}  // namespace rubato
