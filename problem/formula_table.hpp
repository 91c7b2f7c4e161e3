#pragma once

#include <span>
#include <string>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// Formulas of one section of the problem, evaluated together.
class FormulaTable {
public:
  FormulaTable(const Problem& problem, const std::vector<NamedFormula>& formulas,
               const std::vector<std::string>& inputs)
      : values_(formulas.size()) {
    formula::Graph graph;
    std::vector<formula::Expression> variables, outputs;
    for (const std::string& name : inputs) {
      variables.push_back(graph.variable(name));
    }
    for (const NamedFormula& formula : formulas) {
      names_.push_back(formula.name);
      outputs.push_back(problem.build(formula.formula, graph, inputs));
    }
    evaluator_ = formula::ScalarEvaluator(formula::Bytecode(outputs, variables));
  }

  /// Formulas without names, of a graph whose variables the inputs are.
  FormulaTable(formula::Graph& graph, const std::vector<formula::Expression>& formulas,
               const std::vector<std::string>& inputs)
      : values_(formulas.size()) {
    std::vector<formula::Expression> variables;
    for (const std::string& name : inputs) {
      variables.push_back(graph.variable(name));
    }
    evaluator_ = formula::ScalarEvaluator(formula::Bytecode(formulas, variables));
  }

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  std::span<const double> operator()(std::span<const double> inputs) {
    evaluator_(inputs, values_);
    return values_;
  }

private:
  std::vector<std::string> names_;
  formula::ScalarEvaluator evaluator_;
  std::vector<double> values_;
};

}  // namespace rubato
