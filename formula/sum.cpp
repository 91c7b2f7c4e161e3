#include <rubato/formula/sum.hpp>

#include <cmath>
#include <numeric>
#include <optional>
#include <set>
#include <unordered_map>

namespace rubato::formula {

namespace {

/// Sums that share their parts (x + x with x = y + y …) have more terms than anybody wants to see one by one.
constexpr std::size_t most_summands = 100'000;

/// Through which arguments of a node its value is linear with constant coefficients.
struct Linear {
  bool a = false;
  bool b = false;
};

Linear linear_arguments(const Graph& graph, const Node& node) {
  const auto is_constant = [&](NodeIndex i) { return graph.node(i).operation == Operation::constant; };
  switch (node.operation) {
    case Operation::add:
    case Operation::subtract: return {true, true};
    case Operation::negate: return {true, false};
    case Operation::multiply: return {is_constant(node.b), is_constant(node.a) && !is_constant(node.b)};
    case Operation::divide: return {is_constant(node.b), false};
    default: return {};
  }
}

/// The nodes that the value depends on linearly, ascending: arguments before those who use them.
std::set<NodeIndex> linear_part(Expression expression) {
  const Graph& graph = *expression.graph();
  std::set<NodeIndex> found;
  std::vector<NodeIndex> next = {expression.index()};
  while (!next.empty()) {
    const NodeIndex index = next.back();
    next.pop_back();
    if (!found.insert(index).second) {
      continue;
    }
    const Node& node = graph.node(index);
    const Linear linear = linear_arguments(graph, node);
    if (linear.a) {
      next.push_back(node.a);
    }
    if (linear.b) {
      next.push_back(node.b);
    }
  }
  return found;
}

}  // namespace

WithoutConstant separate_constant(Expression expression) {
  struct Part {
    std::optional<Expression> rest;  ///< none: 0
    double constant = 0.0;
  };
  Graph& graph = *expression.graph();
  std::unordered_map<NodeIndex, Part> parts;
  for (const NodeIndex index : linear_part(expression)) {
    const Node node = graph.node(index);
    const Expression whole(&graph, index);
    const Linear linear = linear_arguments(graph, node);
    Part part{.rest = whole};
    if (node.operation == Operation::constant) {
      part = {.rest = std::nullopt, .constant = node.value};
    } else if (linear.a || linear.b) {
      const Part a = linear.a ? parts.at(node.a) : Part{.rest = Expression(&graph, node.a)};
      const Part b = linear.b ? parts.at(node.b) : Part{.rest = Expression(&graph, node.b)};
      const bool changes = (linear.a && a.constant != 0.0) || (linear.b && b.constant != 0.0);
      if (changes) {
        switch (node.operation) {
          case Operation::add:
            part.constant = a.constant + b.constant;
            part.rest = a.rest && b.rest ? *a.rest + *b.rest : a.rest ? a.rest : b.rest;
            break;
          case Operation::subtract:
            part.constant = a.constant - b.constant;
            part.rest = a.rest && b.rest ? *a.rest - *b.rest
                        : a.rest         ? a.rest
                        : b.rest         ? std::optional(-*b.rest)
                                         : b.rest;
            break;
          case Operation::negate:
            part.constant = -a.constant;
            part.rest = a.rest ? std::optional(-*a.rest) : a.rest;
            break;
          case Operation::multiply: {
            const Part& factor = linear.a ? b : a;
            const Part& sum = linear.a ? a : b;
            part.constant = factor.rest->constant_value() * sum.constant;
            part.rest = !sum.rest ? sum.rest : linear.a ? *sum.rest * *factor.rest : *factor.rest * *sum.rest;
            break;
          }
          default:  // a quotient
            part.constant = a.constant / b.rest->constant_value();
            part.rest = a.rest ? std::optional(*a.rest / *b.rest) : a.rest;
            break;
        }
      }
    }
    parts[index] = part;
  }
  const Part& whole = parts.at(expression.index());
  if (whole.constant == 0.0 || !std::isfinite(whole.constant)) {
    return {expression, 0.0};
  }
  return {whole.rest.value_or(graph.constant(0.0)), whole.constant};
}

std::vector<Expression> terms_of(Expression expression) {
  Graph& graph = *expression.graph();
  std::vector<Expression> terms;
  struct Term {
    NodeIndex index;
    double factor;
  };
  std::vector<Term> next = {{expression.index(), 1.0}};
  while (!next.empty()) {
    if (terms.size() + next.size() > most_summands) {
      return {expression};
    }
    const auto [index, factor] = next.back();
    next.pop_back();
    const Node node = graph.node(index);
    const Linear linear = linear_arguments(graph, node);
    const Expression whole(&graph, index);
    if (node.operation == Operation::multiply && (linear.a || linear.b)) {
      const NodeIndex constant = linear.a ? node.b : node.a;
      next.push_back({linear.a ? node.a : node.b, factor * graph.node(constant).value});
    } else if (node.operation == Operation::divide && linear.a) {
      next.push_back({node.a, factor / graph.node(node.b).value});
    } else if (linear.a || linear.b) {
      next.push_back({node.a, factor});
      if (linear.b) {
        next.push_back({node.b, factor});
      }
    } else {
      terms.push_back(factor == 1.0 ? whole : graph.constant(factor) * whole);
    }
  }
  return terms;
}

Expression folded_sum(std::vector<Expression> terms) {
  constexpr std::size_t longest_in_order = 16;
  if (terms.size() < longest_in_order) {
    return std::accumulate(terms.begin() + 1, terms.end(), terms.front());
  }
  while (terms.size() > 1) {
    const std::size_t half = terms.size() / 2, odd = terms.size() % 2;
    for (std::size_t i = 0; i < half; ++i) {
      terms[i] += terms[i + half];
    }
    if (odd != 0) {
      terms[half] = terms.back();
    }
    terms.erase(terms.begin() + static_cast<std::ptrdiff_t>(half + odd), terms.end());
  }
  return terms.front();
}

}  // namespace rubato::formula
