#include <rubato/formula/branches.hpp>

#include <algorithm>
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

/// \param b of operations with one argument: not valid
Expression on_branch(Operation operation, Expression a, Expression b, double scale, Graph& graph) {
  switch (operation) {
    case Operation::abs: return random_sign(a) * a;
    case Operation::sign: return random_sign(a);
    case Operation::min: return 0.5 * (a + b - random_sign(a - b) * (a - b));
    case Operation::max: return 0.5 * (a + b + random_sign(a - b) * (a - b));
    case Operation::floor: return a - 0.5 + 0.125 * sin(2.0 * std::numbers::pi * a);
    case Operation::where_positive: return 0.5 * (1.0 + random_sign(a)) * b;
    case Operation::where_negative: return 0.5 * (1.0 - random_sign(a)) * b;
    default: break;
  }
  if (arity(operation) == 1) {
    return graph.make(operation, grows_fast(operation) ? scale * a : a);
  }
  return graph.make(operation, a, b);
}

bool has_pieces(Operation operation) {
  switch (operation) {
    case Operation::abs:
    case Operation::sign:
    case Operation::min:
    case Operation::max:
    case Operation::floor:
    case Operation::where_positive:
    case Operation::where_negative: return true;
    default: return false;
  }
}

}  // namespace

bool have_one_branch(std::span<const Expression> formulas) {
  return formulas.empty() || std::ranges::none_of(reachable(formulas), [&](NodeIndex index) {
           const Operation operation = formulas.front().graph()->node(index).operation;
           return has_pieces(operation) || grows_fast(operation);
         });
}

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
      default:
        image[index] = on_branch(node.operation, image[node.a],
                                 arity(node.operation) == 2 ? image[node.b] : Expression(), scale, into);
    }
  }
  std::vector<Expression> results;
  for (const Expression& formula : formulas) {
    results.push_back(image[formula.index()]);
  }
  return results;
}

}  // namespace rubato::formula
