#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/expression.hpp>
#include <rubato/formula/loop.hpp>
#include <rubato/formula/partials.hpp>
#include <rubato/formula/reachable.hpp>

namespace rubato::formula {

namespace {

/// One reverse sweep over a formula f: adjoints v̄_i = ∂f/∂v_i of its nodes, and, for the Hessian, the second-order
/// adjoints W_ij of each pair of nodes, pushed from a node to its arguments (edge pushing: R. M. Gower and M. P. Mello,
/// A new framework for the computation of Hessians, Optim. Methods Softw. 27 (2012)):
///
///   v_i = φ(v_a, v_b):   W_ap += φ_a W_ip  (p ≠ i),   W_ab += φ_a φ_b W_ii + φ_ab v̄_i,
///
/// with W symmetric. Each entry of the Hessian is built once, and a product of differences such as (x_i - x_j)² leaves
/// one block that its corners share. Terms that vanish identically are never made.
class Sweep {
public:
  Sweep(Expression f, std::span<const Expression> variables, bool second_order)
      : graph_(*f.graph()), second_order_(second_order) {
    for (std::size_t i = 0; i < variables.size(); ++i) {
      if (variables[i].graph() != &graph_ || graph_.node(variables[i].index()).operation != Operation::variable) {
        throw std::invalid_argument(
            fmt::format("differentiating a formula: '{}' is not a variable of its graph", to_string(variables[i])));
      }
      if (!number_.emplace(variables[i].index(), i).second) {
        throw std::invalid_argument(
            fmt::format("differentiating a formula: the variable '{}' is given twice", to_string(variables[i])));
      }
    }
    const std::array roots{f};
    const std::vector<NodeIndex> order = reachable(roots);
    active_.assign(std::size_t{f.index()} + 1, 0);
    adjoint_terms_.resize(active_.size());
    if (second_order_) {
      pairs_.resize(active_.size());
    }
    for (const NodeIndex index : order) {
      const Node& node = graph_.node(index);
      const bool is_flat = node.operation == Operation::sign || node.operation == Operation::floor;
      const int arguments = is_flat ? 0 : arity(node.operation);
      active_[index] = number_.contains(index) || (arguments >= 1 && active_[node.a] != 0 && !is_choice(node)) ||
                       (arguments == 2 && active_[node.b] != 0);
    }
    if (active_[f.index()] == 0) {
      return;
    }
    adjoint_terms_[f.index()].push_back({});
    for (std::size_t i = order.size(); i-- > 0;) {
      if (active_[order[i]] != 0 && !is_leaf(order[i])) {
        visit(order[i]);
      }
    }
  }

  /// ∂f/∂(variable).
  Expression first(Expression variable) {
    return variable.index() < adjoint_terms_.size() ? materialize(graph_, sum(adjoint_terms_[variable.index()]))
                                                    : graph_.constant(0.0);
  }

  /// Entries of the upper triangle of the Hessian, row by row.
  std::vector<HessianEntry> second(std::span<const Expression> variables) {
    std::vector<HessianEntry> entries;
    for (const Expression variable : variables) {
      if (variable.index() >= active_.size()) {
        continue;
      }
      for (const auto& [partner, w] : row(variable.index())) {
        const auto [i, j] = std::minmax(number_.at(variable.index()), number_.at(partner));
        if (const Expression value = materialize(graph_, w); !value.is_constant(0.0)) {
          entries.push_back({i, j, value});
        }
      }
    }
    std::ranges::sort(entries, {}, [](const HessianEntry& entry) { return std::pair(entry.row, entry.column); });
    return entries;
  }

private:
  struct Pair {
    NodeIndex partner;
    Scaled term;
  };

  [[nodiscard]] bool is_leaf(NodeIndex index) const { return graph_.node(index).operation == Operation::variable; }
  [[nodiscard]] bool is_active(NodeIndex index) const { return active_[index] != 0; }

  [[nodiscard]] static bool is_choice(const Node& node) {
    return node.operation == Operation::where_positive || node.operation == Operation::where_negative;
  }

  /// A value that is chosen by a condition: its derivatives are taken on their own and chosen by the same, since where
  /// it is not chosen they may be undefined, and no product with 0 would take that back.
  void visit_choice(NodeIndex index, const Scaled& adjoint) {
    const Node node = graph_.node(index);
    const Expression value(&graph_, node.b);
    std::vector<Expression> variables;
    for (const std::size_t number : variables_of(value)) {
      const Expression variable = graph_.variable(graph_.variable_name(number));
      if (number_.contains(variable.index())) {
        variables.push_back(variable);
      }
    }
    const auto chosen = [&](Expression derivative) {
      return derivative.is_constant(0.0)
                 ? Scaled{0.0, {}}
                 : scaled(graph_, graph_.make(node.operation, Expression(&graph_, node.a), derivative));
    };
    const std::size_t n = variables.size();
    std::vector<Scaled> first;
    for (const Expression derivative : gradient(value, variables)) {
      first.push_back(chosen(derivative));
    }
    for (std::size_t i = 0; i < n && !adjoint.is_zero(); ++i) {
      add_adjoint(variables[i].index(), times(graph_, first[i], adjoint));
    }
    if (!second_order_) {
      return;
    }
    for (const auto& [partner, w] : row(index)) {
      for (std::size_t i = 0; i < n; ++i) {
        const Scaled part = times(graph_, first[i], w);
        if (partner != index) {
          add_pair(variables[i].index(), partner, part);
          continue;
        }
        add_diagonal(variables[i].index(), times(graph_, first[i], part));
        for (std::size_t j = i + 1; j < n; ++j) {
          add_pair(variables[i].index(), variables[j].index(), times(graph_, first[j], part));
        }
      }
    }
    pairs_[index] = {};
    if (adjoint.is_zero()) {
      return;
    }
    const std::vector<Expression> second = hessian_upper(value, variables);
    for (std::size_t i = 0, k = 0; i < n; ++i) {
      for (std::size_t j = i; j < n; ++j, ++k) {
        const Scaled term = times(graph_, chosen(second[k]), adjoint);
        if (i == j) {
          add_diagonal(variables[i].index(), term);
        } else {
          add_pair(variables[i].index(), variables[j].index(), term);
        }
      }
    }
  }

  /// A loop, once the adjoints of its components are known: its derivatives are those of another loop, and reach its
  /// arguments at once. For second-order adjoints loops are unrolled before.
  void visit_loop(NodeIndex index, const Node& node) {
    std::vector<Expression> arguments = graph_.arguments(node);
    const std::size_t count = arguments.size();
    const auto gradient = gradient_of(*graph_.loop(node), count);
    std::map<std::size_t, Scaled>& adjoints = of_components_[index];
    Scaled factor;
    if (graph_.loop(node)->is_sum()) {
      factor = adjoints[0];
    } else {
      for (std::size_t i = 0; i < graph_.loop(node)->output_count; ++i) {
        const auto adjoint = adjoints.find(i);
        arguments.push_back(adjoint == adjoints.end() ? graph_.constant(0.0) : materialize(graph_, adjoint->second));
      }
    }
    const std::vector<Expression> slopes = graph_.make(gradient, arguments);
    for (std::size_t i = 0; i < count; ++i) {
      if (is_active(arguments[i].index())) {
        add_adjoint(arguments[i].index(), times(graph_, {1.0, slopes[i]}, factor));
      }
    }
  }

  void visit(NodeIndex index) {
    const Node node = graph_.node(index);
    const Scaled adjoint = sum(adjoint_terms_[index]);
    if (is_choice(node)) {
      visit_choice(index, adjoint);
      return;
    }
    if (node.operation == Operation::component && !adjoint.is_zero()) {
      of_components_[node.a].emplace(static_cast<std::size_t>(node.value), adjoint);
    } else if (node.operation == Operation::loop && of_components_.contains(index)) {
      visit_loop(index, node);
    }
    if (node.operation >= Operation::list) {
      return;
    }
    const bool has_b = arity(node.operation) == 2;
    const bool a_active = is_active(node.a);
    const bool b_active = has_b && is_active(node.b);
    const FirstPartials d = first_partials(graph_, index, a_active, b_active);
    if (!adjoint.is_zero()) {
      if (a_active) {
        add_adjoint(node.a, times(graph_, d.a, adjoint));
      }
      if (b_active) {
        add_adjoint(node.b, times(graph_, d.b, adjoint));
      }
    }
    if (!second_order_) {
      return;
    }
    for (const auto& [partner, w] : row(index)) {
      if (partner != index) {
        if (a_active) {
          add_pair(node.a, partner, times(graph_, d.a, w));
        }
        if (b_active) {
          add_pair(node.b, partner, times(graph_, d.b, w));
        }
        continue;
      }
      if (a_active) {
        add_diagonal(node.a, times(graph_, square(graph_, d.a), w));
      }
      if (b_active) {
        add_diagonal(node.b, times(graph_, square(graph_, d.b), w));
      }
      if (a_active && b_active) {
        add_pair(node.a, node.b, times(graph_, d.b, times(graph_, d.a, w)));
      }
    }
    pairs_[index] = {};
    if (!adjoint.is_zero()) {
      const SecondPartials dd = second_partials(graph_, index, a_active, b_active);
      if (a_active && !dd.aa.is_zero()) {
        add_diagonal(node.a, times(graph_, dd.aa, adjoint));
      }
      if (b_active && !dd.bb.is_zero()) {
        add_diagonal(node.b, times(graph_, dd.bb, adjoint));
      }
      if (a_active && b_active && !dd.ab.is_zero()) {
        add_pair(node.a, node.b, times(graph_, dd.ab, adjoint));
      }
    }
  }

  void add_adjoint(NodeIndex node, const Scaled& term) {
    if (!term.is_zero()) {
      adjoint_terms_[node].push_back(term);
    }
  }

  void add_diagonal(NodeIndex node, const Scaled& term) {
    if (!term.is_zero()) {
      pairs_[node].push_back({node, term});
    }
  }

  /// W_ij and W_ji at once; where both are the same node, they meet on the diagonal.
  void add_pair(NodeIndex i, NodeIndex j, Scaled term) {
    if (i == j) {
      term.coefficient *= 2.0;
      add_diagonal(i, term);
    } else if (!term.is_zero()) {
      // Kept by the one visited first: variables, which are not visited, come last.
      const bool i_first = is_leaf(i) == is_leaf(j) ? i > j : is_leaf(j);
      pairs_[i_first ? i : j].push_back({i_first ? j : i, term});
    }
  }

  /// The row of W kept by a node: each partner once, with the sum of its terms.
  std::vector<Pair> row(NodeIndex index) {
    std::vector<Pair>& pairs = pairs_[index];
    std::stable_sort(pairs.begin(), pairs.end(), [](const Pair& x, const Pair& y) { return x.partner < y.partner; });
    std::vector<Pair> sums;
    std::vector<Scaled> terms;
    for (std::size_t i = 0; i < pairs.size();) {
      const NodeIndex partner = pairs[i].partner;
      terms.clear();
      for (; i < pairs.size() && pairs[i].partner == partner; ++i) {
        terms.push_back(pairs[i].term);
      }
      if (const Scaled w = sum(terms); !w.is_zero()) {
        sums.push_back({partner, w});
      }
    }
    return sums;
  }

  Scaled sum(std::vector<Scaled>& terms) { return sum_of(graph_, terms); }

  Graph& graph_;
  bool second_order_;
  std::unordered_map<NodeIndex, std::size_t> number_;  ///< place of each variable in the caller's list
  std::vector<std::uint8_t> active_;                   ///< depends on a variable
  std::vector<std::vector<Scaled>> adjoint_terms_;
  std::unordered_map<NodeIndex, std::map<std::size_t, Scaled>> of_components_;  ///< adjoints, by loop and output
  std::vector<std::vector<Pair>> pairs_;
};

void check(Expression expression) {
  if (!expression.valid()) {
    throw std::invalid_argument("an empty expression has no derivative");
  }
}

}  // namespace

std::vector<Expression> gradient(Expression expression, std::span<const Expression> variables) {
  check(expression);
  Sweep sweep(expression, variables, false);
  std::vector<Expression> result;
  result.reserve(variables.size());
  for (const Expression variable : variables) {
    result.push_back(sweep.first(variable));
  }
  return result;
}

std::vector<Expression> hessian_upper(Expression expression, std::span<const Expression> variables) {
  const std::size_t n = variables.size();
  const std::vector<HessianEntry> entries = hessian_entries(expression, variables);
  std::vector<Expression> upper(n * (n + 1) / 2, expression.graph()->constant(0.0));
  for (const auto& [i, j, value] : entries) {
    upper[i * n - i * (i + 1) / 2 + j] = value;
  }
  return upper;
}

std::vector<HessianEntry> hessian_entries(Expression expression, std::span<const Expression> variables) {
  check(expression);
  return Sweep(unrolled(expression), variables, true).second(variables);
}

Expression derivative(Expression expression, Expression variable) {
  const std::array variables{variable};
  return gradient(expression, variables).front();
}

}  // namespace rubato::formula
