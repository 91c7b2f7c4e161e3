#include <rubato/formula/branches.hpp>

#include <algorithm>
#include <array>
#include <numbers>

#include <rubato/formula/loop.hpp>
#include <rubato/formula/reachable.hpp>

namespace rubato::formula {

namespace {

Expression random_sign(Expression a) {
  // The sign changes 7.7/π times over a unit of a: often between random points, seldom within a finite difference.
  constexpr double turns = 7.7;
  return sign(sin(turns * a));
}

bool grows_fast(Operation operation) {
  switch (operation) {
    case Operation::exp:
    case Operation::expm1:
    case Operation::sinh:
    case Operation::cosh:
    case Operation::tanh:
    case Operation::sech:
    case Operation::csch:
    case Operation::erf: return true;
    default: return false;
  }
}

/// Another branch of an operation that has several; of others a formula that is not valid.
/// \param b of operations with one argument: not valid
Expression on_branch(Operation operation, Expression a, Expression b) {
  switch (operation) {
    case Operation::abs: return random_sign(a) * a;
    case Operation::sign: return random_sign(a);
    case Operation::min: return 0.5 * (a + b - random_sign(a - b) * (a - b));
    case Operation::max: return 0.5 * (a + b + random_sign(a - b) * (a - b));
    case Operation::floor: return a - 0.5 + 0.125 * sin(2.0 * std::numbers::pi * a);
    case Operation::where_positive: return 0.5 * (1.0 + random_sign(a)) * b;
    case Operation::where_negative: return 0.5 * (1.0 - random_sign(a)) * b;
    default: return {};
  }
}

}  // namespace

std::vector<Expression> on_other_branches(std::span<const Expression> formulas, Graph& into, double scale) {
  for (const Expression& formula : formulas) {
    if (has_loops(formula)) {
      return substitute(formulas, into, {}, {});
    }
  }
  if (formulas.empty()) {
    return {};
  }
  const std::vector<NodeIndex> order = reachable(formulas);
  const Graph& source = *formulas.front().graph();
  std::vector<Expression> image(order.back() + 1);
  for (const NodeIndex index : order) {
    const Node node = source.node(index);  // a copy: `into` may be the graph that grows
    switch (node.operation) {
      case Operation::constant: image[index] = into.constant(node.value); break;
      case Operation::variable: image[index] = into.variable(source.variable_name(node.a)); break;
      default: {
        const Expression a = image[node.a], b = arity(node.operation) == 2 ? image[node.b] : Expression();
        image[index] = on_branch(node.operation, a, b);
        if (!image[index].valid()) {
          image[index] = b.valid() ? into.make(node.operation, a, b)
                                   : into.make(node.operation, grows_fast(node.operation) ? scale * a : a);
        }
      }
    }
  }
  std::vector<Expression> results;
  for (const Expression& formula : formulas) {
    results.push_back(image[formula.index()]);
  }
  return results;
}

bool have_one_branch(std::span<const Expression> formulas) {
  Graph graph;
  constexpr double scale = 0.5;
  return on_other_branches(formulas, graph, scale) == substitute(formulas, graph, {}, {});
}

bool is_piecewise(Expression formula, std::span<const Expression> variables) {
  const auto names_some = [&](Expression e) {
    const std::vector<std::size_t> named = variables_of(e);
    return std::ranges::any_of(variables, [&](Expression variable) {
      return std::ranges::binary_search(named, variables_of(variable).front());
    });
  };
  Graph scratch;
  const Expression any = scratch.variable("any");
  return std::ranges::any_of(reachable(std::array{formula}), [&](NodeIndex index) {
    const Node node = formula.graph()->node(index);
    if (node.operation == Operation::constant || node.operation == Operation::variable) {
      return false;
    }
    const bool two_sided = node.operation == Operation::min || node.operation == Operation::max;
    return on_branch(node.operation, any, any).valid() &&
           (names_some({formula.graph(), node.a}) || (two_sided && names_some({formula.graph(), node.b})));
  });
}

std::vector<ScalarEvaluator> evaluators_on_branches(std::span<const Expression> formulas,
                                                    std::span<const Expression> variables) {
  std::vector<ScalarEvaluator> evaluators;
  for (const double scale : branch_scales) {
    Graph other;
    std::vector<Expression> inputs;
    for (const Expression& variable : variables) {
      const Graph& graph = *variable.graph();
      inputs.push_back(other.variable(graph.variable_name(graph.node(variable.index()).a)));
    }
    evaluators.emplace_back(Bytecode(on_other_branches(formulas, other, scale), inputs));
  }
  return evaluators;
}

std::vector<ScalarEvaluator> evaluators_on_branches(std::span<const Expression> formulas) {
  std::vector<Expression> variables;
  if (!formulas.empty()) {
    Graph* const graph = formulas.front().graph();
    for (const NodeIndex index : reachable(formulas)) {
      if (graph->node(index).operation == Operation::variable) {
        variables.emplace_back(graph, index);
      }
    }
  }
  return evaluators_on_branches(formulas, variables);
}

}  // namespace rubato::formula
