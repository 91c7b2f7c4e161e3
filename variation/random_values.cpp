#include <rubato/variation/random_values.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/branches.hpp>

namespace rubato {

namespace {

constexpr int trials = 16;
/// What rounding leaves of a sum of some tens of terms, relative to the largest; a thousand times that.
constexpr double rounding = 1e-11;

/// True if the first formula is 0 beside the others in the first range in which all are defined.
bool first_vanishes(const std::vector<formula::Expression>& all) {
  for (const auto& [low, high] : ranges_of_values) {
    std::mt19937_64 random(45);
    std::uniform_real_distribution<double> value(low, high);
    bool is_defined = true;
    for (int trial = 0; trial < trials && is_defined; ++trial) {
      const std::vector<double> found = values_at(all, [&](std::size_t) { return value(random); });
      is_defined = std::ranges::all_of(found, [](double one) { return std::isfinite(one); });
      double largest = 0.0;
      for (std::size_t i = 1; i < found.size(); ++i) {
        largest = std::max(largest, std::abs(found[i]));
      }
      if (is_defined && !(std::abs(found.front()) <= rounding * largest)) {
        return false;
      }
    }
    if (is_defined) {
      return true;
    }
  }
  return false;
}

}  // namespace

std::vector<double> values_at(std::span<const formula::Expression> formulas,
                              const std::function<double(std::size_t)>& of) {
  std::vector<double> values, results(formulas.size());
  std::vector<formula::Expression> variables;
  if (formulas.empty()) {
    return results;
  }
  formula::Graph& graph = *formulas.front().graph();
  std::map<std::size_t, double> inputs;
  for (const formula::Expression& formula : formulas) {
    for (const std::size_t variable : formula::variables_of(formula)) {
      inputs.try_emplace(variable, 0.0);
    }
  }
  std::vector<const double*> in;
  std::vector<double*> out;
  for (auto& [variable, value] : inputs) {
    value = of(variable);
    variables.push_back(graph.variable(graph.variable_name(variable)));
    in.push_back(&value);
  }
  for (double& result : results) {
    out.push_back(&result);
  }
  formula::BatchEvaluator code(formula::Bytecode(formulas, variables));
  code(1, in, out);
  return results;
}

bool vanishes_at_random(formula::Expression formula, std::span<const formula::Expression> terms) {
  std::vector<formula::Expression> all = {formula};
  all.insert(all.end(), terms.begin(), terms.end());
  return std::ranges::all_of(formula::branch_scales, [&](double scale) {
    formula::Graph other;
    return first_vanishes(formula::on_other_branches(all, other, scale));
  });
}

}  // namespace rubato
