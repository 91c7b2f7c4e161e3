#include <rubato/variation/weighted_terms.hpp>

#include <rubato/variation/node_code.hpp>

namespace rubato {

namespace {

using formula::Expression;
using formula::Node;
using formula::NodeIndex;
using formula::Operation;

bool is_of_variables(const formula::Graph& graph, NodeIndex index) {
  const Node& node = graph.node(index);
  switch (node.operation) {
    case Operation::variable: return true;
    case Operation::negate: return is_of_variables(graph, node.a);
    case Operation::add:
    case Operation::subtract: return is_of_variables(graph, node.a) && is_of_variables(graph, node.b);
    default: return false;
  }
}

}  // namespace

void WeightedTerms::add(Expression sum, double weight) {
  formula::Graph& graph = *sum.graph();
  const Node node = graph.node(sum.index());
  const auto at = [&](NodeIndex index) { return Expression(&graph, index); };
  const auto constant = [&](NodeIndex index) { return graph.node(index).operation == Operation::constant; };
  if (node.operation == Operation::negate) {
    add(at(node.a), -weight);
  } else if (node.operation == Operation::multiply && constant(node.a)) {
    add(at(node.b), weight * graph.node(node.a).value);
  } else if (node.operation == Operation::divide && constant(node.b)) {
    add(at(node.a), weight / graph.node(node.b).value);
  } else if ((node.operation == Operation::add || node.operation == Operation::subtract) &&
             !is_of_variables(graph, sum.index())) {
    add(at(node.a), weight);
    add(at(node.b), node.operation == Operation::add ? weight : -weight);
  } else if (const auto [place, is_new] = places_.try_emplace(sum.index(), terms_.size()); is_new) {
    terms_.emplace_back(sum, weight);
  } else {
    terms_[place->second].second += weight;
  }
}

Expression WeightedTerms::sum() const {
  Expression sum;
  for (const auto& [term, weight] : terms_) {
    if (weight != 0.0) {
      add_weighted(sum, weight, term);
    }
  }
  return sum;
}

}  // namespace rubato
