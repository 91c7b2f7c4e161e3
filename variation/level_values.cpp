#include <rubato/variation/level_values.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <ranges>

#include <rubato/formula/operations.hpp>
#include <rubato/formula/reachable.hpp>

namespace rubato {

namespace {

using formula::Expression;
using formula::Node;
using formula::NodeIndex;
using formula::Operation;
using Offset = std::array<int, 3>;

Offset sum(Offset a, const Offset& b, int sign = 1) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    a[i] += sign * b[i];
  }
  return a;
}

/// The parts of formulas that are of one level, and the same parts at other nodes and of the other level.
class Parts {
public:
  enum Level : unsigned { steady = 0, lower = 1, upper = 2, both = 3 };

  Parts(NodeFormulas& formulas, LevelValues::Arrays arrays) : formulas_(formulas), arrays_(arrays) {}

  /// Has to be called before others are asked of any part of these.
  void find(std::span<const Expression> outputs) {
    for (const NodeInput& input : formulas_.inputs()) {
      inputs_.emplace(input.variable.index(), input);
    }
    for (const NodeIndex index : formula::reachable(outputs)) {
      known_.emplace(index, found(index));
    }
  }
  /// Reads one level, or no array but steady ones.
  [[nodiscard]] bool is_of_one_level(NodeIndex index) const { return known_.at(index).level.has_value(); }
  [[nodiscard]] Level level(NodeIndex index) const { return *known_.at(index).level; }
  [[nodiscard]] bool calls(NodeIndex index) const { return known_.at(index).calls; }
  /// The first node that it reads.
  [[nodiscard]] Offset anchor(NodeIndex index) const { return known_.at(index).anchor.value_or(Offset{}); }
  /// The same of the upper level, where the first node is the node itself.
  [[nodiscard]] Expression canonical(NodeIndex index) { return moved(index, anchor(index)); }

private:
  struct Part {
    std::optional<Level> level = steady;  ///< none: it reads both, or what belongs to the slab
    bool calls = false;                   ///< a function that is no instruction of the machine
    std::optional<Offset> anchor;         ///< none if it reads no node
  };

  [[nodiscard]] formula::Graph& graph() { return formulas_.graph(); }

  [[nodiscard]] Part found(NodeIndex index) {
    const Node node = graph().node(index);
    if (node.operation == Operation::variable) {
      return of_variable(inputs_.at(index));
    }
    Part part;
    part.calls = is_call(node);
    for (int k = 0; k < formula::arity(node.operation); ++k) {
      const Part& argument = known_.at(k == 0 ? node.a : node.b);
      if (!part.level || !argument.level) {
        part.level.reset();
      } else {
        const auto level = static_cast<Level>(*part.level | *argument.level);
        part.level = level == both ? std::nullopt : std::optional(level);
      }
      part.calls = part.calls || argument.calls;
      if (argument.anchor) {
        part.anchor = part.anchor ? std::min(*part.anchor, *argument.anchor) : argument.anchor;
      }
    }
    return part;
  }
  [[nodiscard]] Part of_variable(const NodeInput& input) const {
    using Kind = NodeInput::Kind;
    if (input.kind == Kind::slope) {
      return {};
    }
    if (input.kind == Kind::uniform || input.number >= 2 * arrays_.of_level + arrays_.steady) {
      return {.level = std::nullopt, .anchor = {}};
    }
    const Level level = input.number >= 2 * arrays_.of_level ? steady
                        : input.number >= arrays_.of_level   ? upper
                                                             : lower;
    return {.level = level, .anchor = input.offset};
  }
  [[nodiscard]] bool is_call(const Node& node) {
    if (node.operation == Operation::power) {
      const Node exponent = graph().node(node.b);
      return exponent.operation != Operation::constant || exponent.value != std::round(exponent.value);
    }
    return formula::traits_of(node.operation).is_called;
  }

  /// Of the upper level, at the nodes so much before.
  [[nodiscard]] Expression moved(NodeIndex index, const Offset& by) {
    if (const auto known = moved_.find({index, by}); known != moved_.end()) {
      return known->second;
    }
    const Node node = graph().node(index);
    Expression result(&graph(), index);
    if (node.operation == Operation::variable) {
      const NodeInput input = inputs_.at(index);
      const Offset offset = sum(input.offset, by, -1);
      result = input.kind == NodeInput::Kind::slope
                   ? formulas_.slope(input.number, offset)
                   : formulas_.node(input.number < arrays_.of_level ? input.number + arrays_.of_level : input.number,
                                    offset);
    } else if (formula::arity(node.operation) == 1) {
      result = graph().make(node.operation, moved(node.a, by));
    } else if (formula::arity(node.operation) == 2) {
      const Expression a = moved(node.a, by), b = moved(node.b, by);
      result = graph().make(node.operation, a, b);
    }
    moved_.emplace(std::pair(index, by), result);
    return result;
  }

  NodeFormulas& formulas_;
  LevelValues::Arrays arrays_;
  std::map<NodeIndex, NodeInput> inputs_;
  std::map<NodeIndex, Part> known_;
  std::map<std::pair<NodeIndex, Offset>, Expression> moved_;
};

/// Which part is kept, and at which node of its own its array has it.
struct Kept {
  int number = 0;
  Offset anchor{};
};

}  // namespace

LevelValues::LevelValues(NodeFormulas& formulas, Arrays arrays, std::span<const Expression> always,
                         std::initializer_list<std::vector<Expression>*> outputs) {
  std::vector<Expression> all;
  for (const std::vector<Expression>* some : outputs) {
    all.insert(all.end(), some->begin(), some->end());
  }
  Parts parts(formulas, arrays);
  std::vector<Expression> everything(all);
  everything.insert(everything.end(), always.begin(), always.end());
  if (everything.empty()) {
    return;
  }
  parts.find(everything);

  // Of which levels each part is asked for; by its canonical form.
  std::map<NodeIndex, unsigned> levels;
  const auto note = [&](std::span<const Expression> of, unsigned more) {
    for (const NodeIndex index : of.empty() ? std::vector<NodeIndex>() : formula::reachable(of)) {
      if (parts.is_of_one_level(index) && parts.calls(index)) {
        const Parts::Level level = parts.level(index);
        levels[parts.canonical(index).index()] |= level == Parts::steady ? Parts::both : level | more;
      }
    }
  };
  note(all, 0);
  note(always, Parts::both);

  std::vector<Expression> kept(always.begin(), always.end());
  std::map<NodeIndex, Kept> of_canonical;
  for (std::size_t k = 0; k < always.size(); ++k) {
    const NodeIndex index = always[k].index();
    const Operation operation = formulas.graph().node(index).operation;
    if (operation != Operation::variable && operation != Operation::constant) {
      of_canonical.try_emplace(parts.canonical(index).index(), Kept{static_cast<int>(k), parts.anchor(index)});
    }
  }
  // The largest parts, from the outputs down.
  std::vector<std::pair<NodeIndex, Kept>> reads;
  const std::vector<NodeIndex> order = all.empty() ? std::vector<NodeIndex>() : formula::reachable(all);
  std::map<NodeIndex, bool> is_needed;
  for (const Expression& output : all) {
    is_needed[output.index()] = true;
  }
  for (const NodeIndex index : std::ranges::reverse_view(order)) {
    if (!is_needed[index]) {
      continue;
    }
    if (parts.is_of_one_level(index)) {
      const Expression canonical = parts.canonical(index);
      auto found = of_canonical.find(canonical.index());
      if (found == of_canonical.end() && parts.calls(index) && levels[canonical.index()] == Parts::both) {
        found = of_canonical.emplace(canonical.index(), Kept{static_cast<int>(kept.size())}).first;
        kept.push_back(canonical);
      }
      if (found != of_canonical.end()) {
        reads.emplace_back(index, found->second);
        continue;
      }
    }
    const Node node = formulas.graph().node(index);
    for (int k = 0; k < formula::arity(node.operation); ++k) {
      is_needed[k == 0 ? node.a : node.b] = true;
    }
  }
  std::vector<Expression> from, to;
  for (const auto& [index, read] : reads) {
    const bool is_lower = parts.level(index) == Parts::lower;
    from.emplace_back(&formulas.graph(), index);
    to.push_back(formulas.node(arrays.kept + read.number + (is_lower ? 0 : static_cast<int>(kept.size())),
                               sum(parts.anchor(index), read.anchor, -1)));
  }
  for (std::vector<Expression>* some : outputs) {
    *some = formula::substitute(*some, formulas.graph(), from, to);
  }
  if (!kept.empty()) {
    code_ = formulas.code(kept);
    lower_ = grids::FieldSet(static_cast<int>(kept.size()), formulas.grid().size());
    upper_ = lower_;
  }
}

}  // namespace rubato
