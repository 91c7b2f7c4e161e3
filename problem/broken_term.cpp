#include <rubato/problem/broken_term.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include <rubato/formula/branches.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato {

std::optional<BrokenTerm> find_broken_term(formula::Expression formula, const ImageOfVariable& image) {
  std::vector<formula::Expression> terms = formula::terms_of(formula, formula::Products::expanded);
  terms.push_back(formula);
  const formula::Graph& graph = *formula.graph();
  std::vector<std::string> names;
  std::vector<formula::Expression> variables;
  for (const std::size_t number : formula::variables_of(formula)) {
    names.push_back(graph.variable_name(number));
    variables.push_back(formula.graph()->variable(names.back()));
  }
  std::mt19937_64 random(20);
  std::uniform_real_distribution<double> value(0.1, 1.4);
  std::vector<double> point(names.size()), moved(point), before(terms.size()), after(terms.size());
  constexpr int points = 10;
  // A difference of rounding: that of the argument, J, times the slope.
  constexpr double same = 1e-11;
  std::vector<formula::ScalarEvaluator> evaluators = formula::evaluators_on_branches(terms, variables);
  for (int attempt = 0; attempt < points; ++attempt) {
    std::map<std::string, double> values;
    const ValueOfVariable value_of = [&](const std::string& name) {
      const auto found = values.find(name);
      return found == values.end() ? values.emplace(name, value(random)).first->second : found->second;
    };
    for (std::size_t i = 0; i < names.size(); ++i) {
      point[i] = value_of(names[i]);
    }
    for (std::size_t i = 0; i < names.size(); ++i) {
      moved[i] = image(names[i], value_of);
    }
    for (formula::ScalarEvaluator& evaluate : evaluators) {
      evaluate(point, before);
      evaluate(moved, after);
      double size = 0.0, most = 0.0;
      std::size_t worst = 0;
      for (std::size_t t = 0; t + 1 < terms.size(); ++t) {
        size = std::max({size, std::abs(before[t]), std::abs(after[t])});
        if (const double change = std::abs(after[t] - before[t]); change > most) {
          most = change;
          worst = t;
        }
      }
      if (std::abs(after.back() - before.back()) > same * (1.0 + size)) {
        return BrokenTerm{formula::to_string(terms[worst]), before[worst], after[worst]};
      }
    }
  }
  return std::nullopt;
}

}  // namespace rubato
