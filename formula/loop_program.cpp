#include <rubato/formula/loop_program.hpp>

#include <algorithm>
#include <map>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/reachable.hpp>

namespace rubato::formula {

namespace {

/// How many loops follow each other until the value of each node is known.
std::vector<std::uint32_t> levels_of(const Graph& graph, std::span<const NodeIndex> order) {
  std::vector<std::uint32_t> levels(order.back() + 1, 0);
  for (const NodeIndex index : order) {
    const Node& node = graph.node(index);
    const int arguments = arity(node.operation);
    if (arguments >= 1) {
      levels[index] = levels[node.a] + (node.operation == Operation::loop ? 1 : 0);
    }
    if (arguments == 2) {
      levels[index] = std::max(levels[index], levels[node.b]);
    }
  }
  return levels;
}

/// Merges loops: their terms in one graph, in which equal slots and equal parts are shared.
class Merging {
public:
  explicit Merging(std::shared_ptr<const Iterations> iterations) { code_.iterations = std::move(iterations); }

  void add(const Loop& loop) {
    std::vector<Expression> values;
    for (const Loop::Term& term : loop.terms) {
      values.push_back(term.value);
    }
    std::ranges::copy(substitute(values, *graph_, {}, {}), std::back_inserter(terms_));
    for (const Loop::Slot& slot : loop.slots) {
      const Expression variable =
          graph_->variable(slot.variable.graph()->variable_name(slot.variable.graph()->node(slot.variable.index()).a));
      if (std::ranges::find(variables_, variable) == variables_.end()) {
        variables_.push_back(variable);
        code_.slots.push_back(slot.place);
      }
    }
    for (Loop::Term term : loop.terms) {
      term.target.offset += static_cast<std::int64_t>(code_.output_count);
      code_.targets.push_back(term.target);
    }
    code_.output_count += loop.output_count;
  }

  [[nodiscard]] std::size_t output_count() const { return code_.output_count; }
  [[nodiscard]] LoopCode code() {
    code_.body = Bytecode(terms_, variables_);
    return std::move(code_);
  }

private:
  std::unique_ptr<Graph> graph_ = std::make_unique<Graph>();
  std::vector<Expression> terms_, variables_;
  LoopCode code_;
};

}  // namespace

std::shared_ptr<const LoopProgram> LoopProgram::of(std::span<const Expression> outputs,
                                                   std::span<const Expression> inputs) {
  Graph& source = *outputs.front().graph();
  const std::vector<NodeIndex> order = reachable(outputs);
  const std::vector<std::uint32_t> levels = levels_of(source, order);
  const std::uint32_t last = std::ranges::max(order, {}, [&](NodeIndex i) { return levels[i]; });
  // Components become inputs of what follows, named by their nodes.
  Graph graph;
  std::vector<Expression> known, names, places;
  for (const Expression input : inputs) {
    places.push_back(graph.variable(source.variable_name(source.node(input.index()).a)));
  }
  const auto result = std::make_shared<LoopProgram>();
  for (std::uint32_t level = 1; level <= levels[last]; ++level) {
    struct Group {
      Merging merging;
      std::vector<Expression> arguments;
      std::map<NodeIndex, std::size_t> first_output;  ///< by loop
    };
    std::vector<Group> groups;
    std::map<std::pair<const Iterations*, NodeIndex>, std::size_t> group_of;
    for (const NodeIndex index : order) {
      const Node node = source.node(index);
      if (node.operation != Operation::loop || levels[index] != level) {
        continue;
      }
      const std::shared_ptr<const Loop>& loop = source.loop(node);
      const auto [entry, is_new] = group_of.try_emplace({loop->iterations.get(), node.a}, groups.size());
      if (is_new) {
        groups.push_back({Merging(loop->iterations), source.arguments(node), {}});
      }
      Group& group = groups[entry->second];
      group.first_output.emplace(index, group.merging.output_count());
      group.merging.add(*loop);
    }
    std::vector<Expression> arguments;
    for (const Group& group : groups) {
      const auto own = substitute(group.arguments, graph, known, names);
      arguments.insert(arguments.end(), own.begin(), own.end());
    }
    Stage stage{.arguments = Bytecode(arguments, places), .loops = {}};
    std::int64_t first_argument = 0;
    for (Group& group : groups) {
      std::vector<Expression> own;
      for (std::size_t i = 0; i < group.merging.output_count(); ++i) {
        own.push_back(graph.variable(fmt::format("loop {}", places.size() + i)));
      }
      for (const NodeIndex index : order) {
        const Node& node = source.node(index);
        if (const auto first = group.first_output.find(node.a);
            node.operation == Operation::component && first != group.first_output.end()) {
          known.emplace_back(&source, index);
          names.push_back(own[first->second + static_cast<std::size_t>(node.value)]);
        }
      }
      places.insert(places.end(), own.begin(), own.end());
      LoopCode code = group.merging.code();
      for (Loop::Place& slot : code.slots) {
        slot.offset += first_argument;
      }
      first_argument += static_cast<std::int64_t>(group.arguments.size());
      stage.loops.push_back(std::move(code));
    }
    result->stages.push_back(std::move(stage));
  }
  result->rest = Bytecode(substitute(outputs, graph, known, names), places);
  result->value_count = places.size();
  return result;
}

}  // namespace rubato::formula
