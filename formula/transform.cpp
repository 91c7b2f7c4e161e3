#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/formula/expression.hpp>
#include <rubato/formula/loop.hpp>
#include <rubato/formula/reachable.hpp>

namespace rubato::formula {

namespace {

/// How tightly the text of a node binds, as the parser reads it.
enum Precedence : int { sum = 1, product = 2, prefix = 3, exponentiation = 4, atom = 5 };

Precedence precedence(const Node& node) {
  switch (node.operation) {
    case Operation::add:
    case Operation::subtract: return sum;
    case Operation::multiply:
    case Operation::divide: return product;
    case Operation::negate: return prefix;
    case Operation::power: return exponentiation;
    case Operation::constant: return std::signbit(node.value) ? prefix : atom;
    default: return atom;
  }
}

/// What is still to be written: a node that must bind at least so tightly, or a piece of text.
struct Pending {
  std::string_view text;
  NodeIndex node = 0;
  int at_least = 0;
};

}  // namespace

std::string to_string(Expression expression) {
  if (!expression.valid()) {
    return "(empty)";
  }
  if (has_loops(expression)) {
    Graph own;
    return to_string(unrolled(substitute(std::array{expression}, own, {}, {}).front()));
  }
  const Graph& graph = *expression.graph();
  std::string result;
  std::vector<Pending> stack{{{}, expression.index(), sum}};
  const auto text = [](std::string_view piece) { return Pending{piece, 0, 0}; };
  const auto child = [](NodeIndex node, int at_least) { return Pending{{}, node, at_least}; };
  while (!stack.empty()) {
    const Pending next = stack.back();
    stack.pop_back();
    if (next.at_least == 0) {
      result += next.text;
      continue;
    }
    const Node& node = graph.node(next.node);
    const bool parenthesized = precedence(node) < next.at_least;
    if (parenthesized) {
      result += '(';
      stack.push_back(text(")"));
    }
    switch (node.operation) {  // pushed last to first
      case Operation::constant: result += fmt::format("{}", node.value); break;
      case Operation::variable: result += graph.variable_name(node.a); break;
      case Operation::add:
      case Operation::subtract:
        stack.insert(stack.end(), {child(node.b, product), text(node.operation == Operation::add ? " + " : " - "),
                                   child(node.a, sum)});
        break;
      case Operation::multiply:
      case Operation::divide:
        stack.insert(stack.end(), {child(node.b, exponentiation), text(name(node.operation)), child(node.a, product)});
        break;
      case Operation::negate:
        result += '-';
        stack.push_back(child(node.a, exponentiation));
        break;
      case Operation::power: stack.insert(stack.end(), {child(node.b, atom), text("^"), child(node.a, atom)}); break;
      case Operation::where_positive:
        result += "where(";
        stack.insert(stack.end(), {text(", 0)"), child(node.b, sum), text(" > 0, "), child(node.a, sum)});
        break;
      case Operation::where_negative:
        result += "where(";
        stack.insert(stack.end(), {text(")"), child(node.b, sum), text(" > 0, 0, "), child(node.a, sum)});
        break;
      default:
        result += name(node.operation);
        result += '(';
        stack.push_back(text(")"));
        if (arity(node.operation) == 2) {
          stack.insert(stack.end(), {child(node.b, sum), text(", ")});
        }
        stack.push_back(child(node.a, sum));
        break;
    }
  }
  return result;
}

std::vector<std::size_t> variables_of(Expression expression) {
  std::vector<std::size_t> numbers;
  if (!expression.valid()) {
    return numbers;
  }
  const Graph& graph = *expression.graph();
  const std::array roots{expression};
  for (const NodeIndex index : reachable(roots)) {
    if (graph.node(index).operation == Operation::variable) {
      numbers.push_back(graph.node(index).a);
    }
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

std::vector<Expression> substitute(std::span<const Expression> expressions, Graph& into,
                                   std::span<const Expression> from, std::span<const Expression> to) {
  if (from.size() != to.size()) {
    throw std::invalid_argument(
        fmt::format("substitute: {} parts to replace, but {} replacements", from.size(), to.size()));
  }
  if (expressions.empty()) {
    return {};
  }
  const std::vector<NodeIndex> order = reachable(expressions);
  Graph& source = *expressions.front().graph();
  std::vector<Expression> image(order.empty() ? 0 : order.back() + 1);
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (from[i].graph() != &source) {
      throw std::invalid_argument(
          fmt::format("substitute: '{}' is not in the graph of the expressions", to_string(from[i])));
    }
    if (to[i].graph() != &into) {
      throw std::invalid_argument(
          fmt::format("substitute: the replacement '{}' is not in the graph of the results", to_string(to[i])));
    }
    if (from[i].index() < image.size()) {
      image[from[i].index()] = to[i];
    }
  }
  for (const NodeIndex index : order) {
    const Node node = source.node(index);
    if (image[index].valid()) {
      continue;
    }
    if (node.operation == Operation::constant) {
      image[index] = into.constant(node.value);
    } else if (node.operation == Operation::variable) {
      image[index] = into.variable(source.variable_name(node.a));
    } else if (node.operation >= Operation::list) {
      image[index] = into.make(source, node, image[node.a], image[node.b]);
    } else if (arity(node.operation) == 1) {
      image[index] = into.make(node.operation, image[node.a]);
    } else {
      image[index] = into.make(node.operation, image[node.a], image[node.b]);
    }
  }
  std::vector<Expression> results;
  results.reserve(expressions.size());
  for (const Expression expression : expressions) {
    results.push_back(image[expression.index()]);
  }
  return results;
}

Expression substitute(Expression expression, std::span<const Expression> from, std::span<const Expression> to) {
  Graph& into = to.empty() ? *expression.graph() : *to.front().graph();
  const std::array expressions{expression};
  return substitute(expressions, into, from, to).front();
}

}  // namespace rubato::formula
