#include <rubato/problem/broken_term.hpp>

#include <map>
#include <random>
#include <vector>

namespace rubato {

std::optional<formula::ChangedTerm> find_broken_term(formula::Expression formula, const ImageOfVariable& image) {
  const formula::Graph& graph = *formula.graph();
  std::vector<std::string> names;
  std::vector<formula::Expression> variables;
  for (const std::size_t number : formula::variables_of(formula)) {
    names.push_back(graph.variable_name(number));
    variables.push_back(formula.graph()->variable(names.back()));
  }
  formula::ImageTest test(formula, variables);
  std::mt19937_64 random(20);
  std::uniform_real_distribution<double> value(0.1, 1.4);
  std::vector<double> point(names.size()), moved(point);
  constexpr int points = 10;
  // A difference of rounding: that of the argument, J, times the slope.
  constexpr double same = 1e-11;
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
    if (auto changed = test.find_changed_term(point, moved, same)) {
      return changed;
    }
  }
  return std::nullopt;
}

}  // namespace rubato
