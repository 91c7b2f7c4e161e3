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

/// The parts of formulas that are of one level, and the same parts at other nodes and of the other level.
class LevelParts {
public:
  enum Level : unsigned { steady = 0, lower = 1, upper = 2, both = 3 };

  LevelParts(NodeFormulas& formulas, LevelValues::Arrays arrays) : formulas_(formulas), arrays_(arrays) {}

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
  /// The first node that its functions read, so that those of one value stay together; else that it reads.
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
    const auto argument_of = [&](int k) -> const Part& { return known_.at(k == 0 ? node.a : node.b); };
    bool functions_alone = false;
    for (int k = 0; k < formula::arity(node.operation) && !part.calls; ++k) {
      functions_alone = functions_alone || argument_of(k).calls;
    }
    for (int k = 0; k < formula::arity(node.operation); ++k) {
      const Part& argument = argument_of(k);
      if (!part.level || !argument.level) {
        part.level.reset();
      } else {
        const auto level = static_cast<Level>(*part.level | *argument.level);
        part.level = level == both ? std::nullopt : std::optional(level);
      }
      part.calls = part.calls || argument.calls;
      if (argument.anchor && (argument.calls || !functions_alone)) {
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
    if (input.kind == Kind::uniform || input.kind == Kind::axis ||
        input.number >= 2 * arrays_.of_level + arrays_.steady) {
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
      const Offset offset = shifted(input.offset, by, -1);
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

/// Which parts are kept, and read in the place of which.
class Choice {
public:
  Choice(NodeFormulas& formulas, LevelValues::Arrays arrays, std::span<const Expression> always,
         std::span<const Expression> outputs, bool of_one_level)
      : graph_(formulas.graph()), parts_(formulas, arrays), kept_(always.begin(), always.end()) {
    std::vector<Expression> everything(outputs.begin(), outputs.end());
    everything.insert(everything.end(), always.begin(), always.end());
    parts_.find(everything);
    note(outputs, of_one_level ? LevelParts::both : 0U);
    note(always, LevelParts::both);
    for (std::size_t k = 0; k < always.size(); ++k) {
      const Operation operation = graph_.node(always[k].index()).operation;
      if (operation != Operation::variable && operation != Operation::constant) {  // these are read as they are
        places_.try_emplace(parts_.canonical(always[k].index()).index(),
                            Place{static_cast<int>(k), parts_.anchor(always[k].index())});
      }
    }
    find_reads(outputs);
  }

  /// Formulas of the upper level.
  [[nodiscard]] const std::vector<Expression>& kept() const { return kept_; }

  /// A part, and what is kept of it: at the node so far from this one, of the lower or the upper level.
  struct Read {
    Expression part;
    int number = 0;
    bool is_lower = false;
    Offset offset{};
  };
  [[nodiscard]] const std::vector<Read>& reads() const { return reads_; }

private:
  /// Where a part is kept: its number, and at which node of its own.
  struct Place {
    int number = 0;
    Offset anchor{};
  };

  /// Of which levels parts that call functions are asked for, these and `more`.
  void note(std::span<const Expression> formulas, unsigned more) {
    for (const NodeIndex index : formulas.empty() ? std::vector<NodeIndex>() : formula::reachable(formulas)) {
      if (parts_.is_of_one_level(index) && parts_.calls(index)) {
        const LevelParts::Level level = parts_.level(index);
        levels_[parts_.canonical(index).index()] |= level == LevelParts::steady ? LevelParts::both : level | more;
      }
    }
  }
  /// The largest parts, from the outputs down.
  void find_reads(std::span<const Expression> outputs) {
    std::map<NodeIndex, bool> is_needed;
    for (const Expression& output : outputs) {
      is_needed[output.index()] = true;
    }
    const std::vector<NodeIndex> order = outputs.empty() ? std::vector<NodeIndex>() : formula::reachable(outputs);
    for (const NodeIndex index : std::ranges::reverse_view(order)) {
      if (!is_needed[index]) {
        continue;
      }
      if (const auto place = place_of(index)) {
        reads_.push_back({Expression(&graph_, index), place->number, parts_.level(index) != LevelParts::upper,
                          shifted(parts_.anchor(index), place->anchor, -1)});
        continue;
      }
      const Node node = graph_.node(index);
      for (int k = 0; k < formula::arity(node.operation); ++k) {
        is_needed[k == 0 ? node.a : node.b] = true;
      }
    }
  }
  [[nodiscard]] std::optional<Place> place_of(NodeIndex index) {
    if (!parts_.is_of_one_level(index)) {
      return std::nullopt;
    }
    const Expression canonical = parts_.canonical(index);
    if (const auto known = places_.find(canonical.index()); known != places_.end()) {
      return known->second;
    }
    if (!parts_.calls(index) || levels_[canonical.index()] != LevelParts::both) {
      return std::nullopt;
    }
    kept_.push_back(canonical);
    return places_[canonical.index()] = {static_cast<int>(kept_.size()) - 1, {}};
  }

  formula::Graph& graph_;
  LevelParts parts_;
  std::map<NodeIndex, unsigned> levels_;  ///< by canonical forms, as all here
  std::map<NodeIndex, Place> places_;
  std::vector<Expression> kept_;
  std::vector<Read> reads_;
};

}  // namespace

LevelValues::LevelValues(NodeFormulas& formulas, Arrays arrays, std::span<const Expression> always,
                         std::initializer_list<std::vector<Expression>*> outputs) {
  keep(formulas, arrays, always, std::span(outputs.begin(), outputs.end()), false);
}

LevelValues::LevelValues(NodeFormulas& formulas, Arrays arrays, std::vector<Expression>& of_lower) {
  std::vector<Expression>* const outputs[] = {&of_lower};
  keep(formulas, arrays, {}, outputs, true);
}

void LevelValues::keep(NodeFormulas& formulas, Arrays arrays, std::span<const Expression> always,
                       std::span<std::vector<Expression>* const> outputs, bool of_one_level) {
  std::vector<Expression> all;
  for (const std::vector<Expression>* some : outputs) {
    all.insert(all.end(), some->begin(), some->end());
  }
  if (all.empty() && always.empty()) {
    return;
  }
  const Choice choice(formulas, arrays, always, all, of_one_level);
  kept_ = choice.kept();
  const auto count = static_cast<int>(choice.kept().size());
  std::vector<Expression> from, to;
  for (const Choice::Read& read : choice.reads()) {
    from.push_back(read.part);
    to.push_back(formulas.node(arrays.kept + read.number + (read.is_lower ? 0 : count), read.offset));
  }
  for (std::vector<Expression>* some : outputs) {
    *some = formula::substitute(*some, formulas.graph(), from, to);
  }
  if (count > 0) {
    code_ = formulas.code(kept_);
    lower_ = grids::FieldSet(count, formulas.grid().size());
    upper_ = grids::FieldSet(count, formulas.grid().size());
  }
}

}  // namespace rubato
