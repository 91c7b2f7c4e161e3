#include <rubato/formula/sum.hpp>

#include <cmath>
#include <numeric>
#include <optional>
#include <set>
#include <unordered_map>

namespace rubato::formula {

namespace {

/// Nodes of a formula that are looked at for terms: sums that share their parts (x + x with x = y + y …) have more
/// terms than anybody wants to see one by one.
constexpr std::size_t most_looks = 200'000;
/// Products that are expanded, and the terms of one: two factors of n terms make n² of them.
constexpr std::size_t most_expansions = 4096;
constexpr int deepest_product = 64;

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

namespace {

struct Term {
  Expression expression;
  double factor;
};

class Splitter {
public:
  Splitter(Graph& graph, Products products) : graph_(graph), products_(products) {}

  [[nodiscard]] std::vector<Term> split(Expression formula, int depth = 0) {
    std::vector<Term> terms, open = {{formula, 1.0}};
    while (!open.empty()) {
      const auto [part, factor] = open.back();
      open.pop_back();
      const Node node = graph_.node(part.index());
      const Linear linear = looks_++ < most_looks ? linear_arguments(graph_, node) : Linear{};
      const auto value_of = [&](NodeIndex index) { return graph_.node(index).value; };
      if (node.operation == Operation::multiply && (linear.a || linear.b)) {
        open.push_back({at(linear.a ? node.a : node.b), factor * value_of(linear.a ? node.b : node.a)});
      } else if (node.operation == Operation::divide && linear.a) {
        open.push_back({at(node.a), factor / value_of(node.b)});
      } else if (linear.a) {
        if (linear.b) {
          open.push_back({at(node.b), node.operation == Operation::subtract ? -factor : factor});
        }
        open.push_back({at(node.a), node.operation == Operation::negate ? -factor : factor});
      } else if (!expand(node, factor, depth, terms)) {
        terms.push_back({part, factor});
      }
    }
    return terms;
  }

private:
  [[nodiscard]] Expression at(NodeIndex index) const { return {&graph_, index}; }

  /// Multiplies out a product of sums, or a quotient of one. \return false if it is none, or has too many terms
  bool expand(const Node& node, double factor, int depth, std::vector<Term>& terms) {
    const bool is_product = node.operation == Operation::multiply;
    if (products_ == Products::kept || !(is_product || node.operation == Operation::divide) ||
        depth == deepest_product || expansions_ == most_expansions) {
      return false;
    }
    ++expansions_;
    const std::vector<Term> left = split(at(node.a), depth + 1);
    const std::vector<Term> right = is_product ? split(at(node.b), depth + 1) : std::vector<Term>{{at(node.b), 1.0}};
    if (left.size() * right.size() == 1 || left.size() * right.size() > most_expansions) {
      return false;
    }
    for (const Term& a : left) {
      for (const Term& b : right) {
        terms.push_back({graph_.make(node.operation, a.expression, b.expression), factor * a.factor * b.factor});
      }
    }
    return true;
  }

  Graph& graph_;
  Products products_;
  std::size_t looks_ = 0, expansions_ = 0;
};

}  // namespace

std::vector<Expression> terms_of(Expression expression, Products products) {
  Graph& graph = *expression.graph();
  std::vector<Expression> terms;
  for (const auto& [term, factor] : Splitter(graph, products).split(expression)) {
    terms.push_back(factor == 1.0 ? term : factor == -1.0 ? -term : graph.constant(factor) * term);
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
