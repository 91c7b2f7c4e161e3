#include <rubato/formula/loop.hpp>

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/reachable.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato::formula {

void Iterations::append(std::size_t count, std::span<const Column> columns) {
  if (count == 0) {
    return;
  }
  lengths_.push_back(count);
  table_.insert(table_.end(), columns.begin(), columns.end());
  size_ += count;
}

namespace {

/// A loop with the same iterations and slots, whose terms are yet to be made in its own graph.
struct Rebuilt {
  Loop loop;
  std::shared_ptr<Graph> graph = std::make_shared<Graph>();
  std::vector<Expression> values;  ///< of the terms of the loop that it is made from

  explicit Rebuilt(const Loop& from) : loop(from) {
    std::vector<Expression> old;
    for (const Loop::Term& term : from.terms) {
      old.push_back(term.value);
    }
    values = substitute(old, *graph, {}, {});
    for (Loop::Slot& slot : loop.slots) {
      slot.variable = graph->variable(from.graph->variable_name(from.graph->node(slot.variable.index()).a));
    }
    loop.graph = graph;
    loop.terms.clear();
  }
};

}  // namespace

std::shared_ptr<const Loop> gradient_of(const Loop& loop, std::size_t arguments) {
  Rebuilt of(loop);
  Expression weighted = of.values.front();
  if (!loop.is_sum()) {
    weighted = of.graph->constant(0.0);
    for (std::size_t s = 0; s < of.values.size(); ++s) {
      Loop::Place adjoint = loop.terms[s].target;
      adjoint.offset += static_cast<std::int64_t>(arguments);
      const Expression variable = of.graph->variable(Loop::slot_name(adjoint));
      of.loop.slots.push_back({variable, adjoint});
      weighted += variable * of.values[s];
    }
  }
  std::vector<Expression> variables;
  for (std::size_t k = 0; k < loop.slots.size(); ++k) {
    variables.push_back(of.loop.slots[k].variable);
  }
  const std::vector<Expression> gradient = formula::gradient(weighted, variables);
  for (std::size_t k = 0; k < gradient.size(); ++k) {
    if (!gradient[k].is_constant(0.0)) {
      of.loop.terms.push_back({gradient[k], loop.slots[k].place});
    }
  }
  of.loop.output_count = arguments;
  return std::make_shared<const Loop>(std::move(of.loop));
}

std::string Loop::slot_name(const Place& place) {
  return fmt::format("{} {}", place.column ? std::to_string(*place.column) : "all", place.offset);
}

bool has_loops(std::span<const Expression> expressions) {
  if (expressions.empty() || !expressions.front().valid()) {
    return false;
  }
  const Graph& graph = *expressions.front().graph();
  return graph.has_loops() && std::ranges::any_of(reachable(expressions), [&](NodeIndex index) {
           return graph.node(index).operation == Operation::loop;
         });
}

bool has_loops(Expression expression) {
  return has_loops(std::span(&expression, 1));
}

namespace {

std::vector<Expression> outputs_of(const Loop& loop, std::span<const Expression> arguments, Graph& graph) {
  std::vector<std::vector<Expression>> summands(loop.output_count);
  std::vector<Expression> values, from, to(loop.slots.size());
  for (const Loop::Term& term : loop.terms) {
    values.push_back(term.value);
  }
  for (const Loop::Slot& slot : loop.slots) {
    from.push_back(slot.variable);
  }
  const Iterations& iterations = *loop.iterations;
  for (std::size_t stretch = 0; stretch < iterations.lengths().size(); ++stretch) {
    for (std::size_t k = 0; k < iterations.lengths()[stretch]; ++k) {
      std::ranges::transform(loop.slots, to.begin(), [&](const Loop::Slot& slot) {
        return arguments[static_cast<std::size_t>(slot.place.at(iterations, stretch, k))];
      });
      const std::vector<Expression> here = substitute(values, graph, from, to);
      for (std::size_t s = 0; s < here.size(); ++s) {
        summands[static_cast<std::size_t>(loop.terms[s].target.at(iterations, stretch, k))].push_back(here[s]);
      }
    }
  }
  std::vector<Expression> outputs;
  for (std::vector<Expression>& terms : summands) {
    outputs.push_back(terms.empty() ? graph.constant(0.0) : folded_sum(std::move(terms)));
  }
  return outputs;
}

}  // namespace

std::vector<Expression> unrolled(std::span<const Expression> expressions) {
  if (!has_loops(expressions)) {
    return {expressions.begin(), expressions.end()};
  }
  Graph& graph = *expressions.front().graph();
  std::vector<Expression> components, values;
  NodeIndex last_loop = 0;
  std::vector<Expression> outputs;
  // Arguments come before the loops that read them, and loops before their components.
  for (const NodeIndex index : reachable(expressions)) {
    const Node node = graph.node(index);
    if (node.operation != Operation::component) {
      continue;
    }
    if (outputs.empty() || node.a != last_loop) {
      const Node loop = graph.node(node.a);
      const std::vector<Expression> arguments = graph.arguments(loop);
      outputs = outputs_of(*graph.loop(loop), substitute(arguments, graph, components, values), graph);
      last_loop = node.a;
    }
    components.emplace_back(&graph, index);
    values.push_back(outputs[static_cast<std::size_t>(node.value)]);
  }
  return substitute(expressions, graph, components, values);
}

Expression unrolled(Expression expression) {
  return unrolled(std::span(&expression, 1)).front();
}

std::vector<Expression> magnitudes_of_loops(std::vector<Expression> terms) {
  for (Expression& term : terms) {
    Graph& graph = *term.graph();
    const Node whole = graph.node(term.index());
    // number · component, or ±component
    const bool is_multiple = whole.operation == Operation::multiply || whole.operation == Operation::negate;
    const NodeIndex index = whole.operation == Operation::multiply ? whole.b : is_multiple ? whole.a : term.index();
    const Node component = graph.node(index);
    if (component.operation != Operation::component) {
      continue;
    }
    const Node node = graph.node(component.a);
    if (const std::shared_ptr<const Loop> loop = graph.loop(node); loop->is_sum()) {
      Rebuilt of(*loop);
      of.loop.terms.push_back({abs(of.values.front()), loop->terms.front().target});
      const std::vector<Expression> arguments = graph.arguments(node);
      const auto magnitude = graph.make(std::make_shared<const Loop>(std::move(of.loop)), arguments).front();
      term = substitute(term, std::array{Expression(&graph, index)}, std::array{magnitude});
    }
  }
  return terms;
}

}  // namespace rubato::formula
