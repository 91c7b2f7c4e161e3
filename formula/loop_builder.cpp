#include <rubato/formula/loop_builder.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/reachable.hpp>
#include <rubato/formula/sum.hpp>

namespace rubato::formula {

namespace {

constexpr double largest_index = 1e9;

bool is_integer(double value) {
  return value == std::round(value) && std::abs(value) <= largest_index;
}

/// Whether a formula of the indices grows linearly with one of them.
bool is_linear(Expression formula, Expression index) {
  const Graph& graph = *formula.graph();
  const bool is_polynomial = std::ranges::all_of(reachable(std::span(&formula, 1)), [&](NodeIndex i) {
    return graph.node(i).operation <= Operation::multiply || graph.node(i).operation == Operation::negate;
  });
  return is_polynomial && derivative(formula, index).is_constant();
}

}  // namespace

Expression LoopBuilder::import(Expression of_other) {
  if (of_other.graph() == graph_.get()) {
    return of_other;
  }
  if (of_other.is_constant()) {
    return graph_->constant(of_other.constant_value());
  }
  const Expression variable = graph_->variable(fmt::format("import {}", of_other.index()));
  imports_.emplace(variable.index(), of_other);
  return variable;
}

Expression LoopBuilder::new_index() {
  indices_.push_back(graph_->variable(fmt::format("index {}", indices_.size())));
  return indices_.back();
}

Expression LoopBuilder::element(std::string_view vector, Expression index) {
  const Expression variable = graph_->variable(fmt::format("element {} {}", index.index(), vector));
  elements_.emplace(variable.index(), Element{std::string(vector), index});
  return variable;
}

Expression LoopBuilder::sum(Expression index, Expression first, Expression last, Expression term) {
  std::vector<Nest> nests;
  expand(
      term, [](Expression x) { return x; }, nests);
  for (Nest& nest : nests) {
    nest.ranges.insert(nest.ranges.begin(), Range{index, first, last});
  }
  const Expression variable = graph_->variable(fmt::format("sum {}", sums_.size()));
  sums_.emplace(variable.index(), std::move(nests));
  return variable;
}

bool LoopBuilder::is_of_indices(Expression expression) const {
  return std::ranges::all_of(variables_of(expression), [&](std::size_t number) {
    return std::ranges::find(indices_, graph_->variable(graph_->variable_name(number))) != indices_.end();
  });
}

LoopBuilder::Shifted LoopBuilder::shifted(Expression index) const {
  const Node node = graph_->node(index.index());
  const bool is_sum = node.operation == Operation::add || node.operation == Operation::subtract;
  if (!is_sum || graph_->node(node.b).operation != Operation::constant || !is_integer(graph_->node(node.b).value)) {
    return {index, 0};
  }
  const auto offset = static_cast<std::int64_t>(graph_->node(node.b).value);
  const Shifted inner = shifted({graph_.get(), node.a});
  return {inner.base, inner.offset + (node.operation == Operation::add ? offset : -offset)};
}

std::optional<std::int64_t> LoopBuilder::distance(Expression first, Expression last) const {
  const Shifted a = shifted(first), b = shifted(last);
  return a.base == b.base ? std::optional(b.offset - a.offset) : std::nullopt;
}

bool LoopBuilder::has_sums(Expression expression) const {
  return std::ranges::any_of(reachable(std::span(&expression, 1)), [&](NodeIndex i) { return sums_.contains(i); });
}

/// The terms of an expression that is linear in the sums within it, each with the ranges of its sum.
void LoopBuilder::expand(Expression expression, const Wrap& wrap, std::vector<Nest>& nests) const {
  if (const auto inner = sums_.find(expression.index()); inner != sums_.end()) {
    for (const Nest& nest : inner->second) {
      nests.push_back({nest.ranges, wrap(nest.term)});
    }
    return;
  }
  if (!has_sums(expression)) {
    nests.push_back({{}, wrap(expression)});
    return;
  }
  const Node node = graph_->node(expression.index());
  const Expression a(graph_.get(), node.a), b(graph_.get(), node.b);
  const auto negated = [&](Expression x) { return wrap(-x); };
  switch (node.operation) {
    case Operation::add: expand(a, wrap, nests), expand(b, wrap, nests); return;
    case Operation::subtract: expand(a, wrap, nests), expand(b, negated, nests); return;
    case Operation::negate: expand(a, negated, nests); return;
    case Operation::multiply:
      if (!has_sums(a)) {
        return expand(
            b, [&](Expression x) { return wrap(a * x); }, nests);
      }
      if (!has_sums(b)) {
        return expand(
            a, [&](Expression x) { return wrap(x * b); }, nests);
      }
      break;
    case Operation::divide:
      if (!has_sums(b)) {
        return expand(
            a, [&](Expression x) { return wrap(x / b); }, nests);
      }
      break;
    default: break;
  }
  throw NotALoop("the term is not linear in a sum within it");
}

/// Nested ranges, and the terms that are summed over them.
class LoopBuilder::Chain {
public:
  Chain(const LoopBuilder& builder, std::vector<Range> ranges)
      : builder_(builder), graph_(*builder.graph_), ranges_(std::move(ranges)), values_(ranges_.size(), 0.0) {
    for (const Range& range : ranges_) {
      const std::array bounds{range.first, range.last};
      bounds_.emplace_back(Bytecode(bounds, indices()), Engine::interpreter);
    }
  }

  [[nodiscard]] const std::vector<Range>& ranges() const { return ranges_; }

  /// Sums of parts of a term apart, each as it is: what depends on momenta alone is then a term of its own.
  void add(Expression term) { std::ranges::copy(terms_of(term), std::back_inserter(terms_)); }

  [[nodiscard]] std::size_t size() {
    std::size_t count = 0;
    for_each_innermost(
        [&](std::int64_t first, std::int64_t last) { count += static_cast<std::size_t>(last - first + 1); });
    return count;
  }

  /// Of the terms built: the most variables that one reads.
  [[nodiscard]] std::size_t most_read() const { return most_read_; }

  [[nodiscard]] std::optional<Expression> build(Graph& into, const FindComponent& find) {
    find_slots();
    count_iterations();
    std::vector<Expression> sums;
    for (const Expression term : terms_) {
      const auto body = std::make_shared<Graph>();
      Loop loop{.iterations = iterations_, .graph = body, .slots = {}, .terms = {}};
      std::vector<Expression> arguments, from, to;
      for (const Loop::Slot& slot : slots_of(term, arguments, into, find)) {
        const Expression variable = body->variable(Loop::slot_name(slot.place));
        if (std::ranges::find(loop.slots, variable, &Loop::Slot::variable) == loop.slots.end()) {
          loop.slots.push_back({variable, slot.place});
        }
        from.push_back(slot.variable);
        to.push_back(variable);
      }
      loop.terms.push_back({substitute(std::array{term}, *body, from, to).front(), {}});
      sums.push_back(into.make(std::make_shared<const Loop>(std::move(loop)), arguments).front());
      const auto read = std::ranges::count_if(arguments, [](Expression x) { return !x.is_constant(); });
      most_read_ = std::max(most_read_, static_cast<std::size_t>(read));
    }
    return most_read_ == 0 ? std::nullopt : std::optional(folded_sum(std::move(sums)));
  }

private:
  [[nodiscard]] const std::vector<Expression>& indices() const { return builder_.indices_; }

  /// Calls body(first, last) of the innermost index, with the values of the outer ones in values_.
  template <typename Body>
  void for_each_innermost(Body body, std::size_t depth = 0) {
    const auto [first, last] = bounds(depth);
    if (depth + 1 == ranges_.size()) {
      if (first <= last) {
        body(first, last);
      }
      return;
    }
    for (std::int64_t i = first; i <= last; ++i) {
      values_[depth] = static_cast<double>(i);
      for_each_innermost(body, depth + 1);
    }
  }

  std::pair<std::int64_t, std::int64_t> bounds(std::size_t depth) {
    set_inputs(bounds_[depth]);
    bounds_[depth].run();
    const double first = bounds_[depth].output(0), last = bounds_[depth].output(1);
    if (!is_integer(first) || !is_integer(last)) {
      throw NotALoop("the bounds of a sum are no integers");
    }
    return {static_cast<std::int64_t>(first), static_cast<std::int64_t>(last)};
  }

  void set_inputs(ScalarEvaluator& evaluator) {
    for (std::size_t d = 0; d < ranges_.size(); ++d) {
      const auto number = std::ranges::find(indices(), ranges_[d].index) - indices().begin();
      evaluator.inputs()[static_cast<std::size_t>(number)] = values_[d];
    }
  }

  /// The parts of the terms that are read from arguments: imports, elements, and the largest parts that depend on one
  /// index alone, which are numbers.
  void find_slots() {
    const std::vector<NodeIndex> order = reachable(terms_);
    std::map<NodeIndex, std::vector<std::size_t>> variables;  // of parts that depend on indices alone
    const auto is_table = [&](NodeIndex i) { return variables.contains(i) && variables.at(i).size() == 1; };
    for (const NodeIndex index : order) {
      const Node& node = graph_.node(index);
      const Expression part(&graph_, index);
      if (builder_.is_of_indices(part)) {
        variables.emplace(index, variables_of(part));
      } else if (node.operation == Operation::variable) {
        slots_.push_back(index);
      } else if (node.operation == Operation::power && variables.contains(node.b) && !variables.at(node.b).empty()) {
        throw NotALoop("an exponent depends on an index");
      }
    }
    std::vector<NodeIndex> read;
    for (const NodeIndex index : order) {
      const Node& node = graph_.node(index);
      const int arguments = arity(node.operation);
      if (!is_table(index) && arguments >= 1) {
        read.push_back(node.a);
      }
      if (!is_table(index) && arguments == 2) {
        read.push_back(node.b);
      }
    }
    for (const Expression term : terms_) {
      read.push_back(term.index());
    }
    std::ranges::sort(read);
    const auto [first, last] = std::ranges::unique(read);
    read.erase(first, last);
    std::ranges::copy_if(read, std::back_inserter(slots_), is_table);
    std::ranges::sort(slots_);
    for (const NodeIndex slot : slots_) {
      if (const auto element = builder_.elements_.find(slot); element != builder_.elements_.end()) {
        add_column(builder_.shifted(element->second.index).base);
      } else if (!builder_.imports_.contains(slot)) {
        add_column(index_of(slot));
      }
    }
  }

  [[nodiscard]] Expression index_of(NodeIndex table) const {
    return graph_.variable(graph_.variable_name(variables_of({&graph_, table}).front()));
  }

  void add_column(Expression base) {
    if (std::ranges::find(columns_, base) == columns_.end()) {
      columns_.push_back(base);
    }
  }
  [[nodiscard]] std::size_t known_column(Expression base) const {
    return static_cast<std::size_t>(std::ranges::find(columns_, base) - columns_.begin());
  }

  void count_iterations() {
    constexpr auto most = std::numeric_limits<std::int32_t>::max();
    lowest_.assign(columns_.size(), most);
    highest_.assign(columns_.size(), -most);
    iterations_ = std::make_shared<Iterations>(columns_.size());
    ScalarEvaluator evaluator(Bytecode(columns_, indices()), Engine::interpreter);
    const bool linear =
        std::ranges::all_of(columns_, [&](Expression base) { return is_linear(base, ranges_.back().index); });
    std::vector<std::int32_t> here(columns_.size()), next(columns_.size());
    std::vector<Iterations::Column> stretch(columns_.size());
    const auto evaluate = [&](std::int64_t k, std::vector<std::int32_t>& into) {
      values_.back() = static_cast<double>(k);
      set_inputs(evaluator);
      evaluator.run();
      for (std::size_t c = 0; c < columns_.size(); ++c) {
        if (!is_integer(evaluator.output(c))) {
          throw NotALoop("an index is no integer");
        }
        into[c] = static_cast<std::int32_t>(evaluator.output(c));
        lowest_[c] = std::min(lowest_[c], into[c]);
        highest_[c] = std::max(highest_[c], into[c]);
      }
    };
    for_each_innermost([&](std::int64_t first, std::int64_t last) {
      for (std::int64_t k = first; k <= last;) {
        evaluate(k, here);
        std::int64_t end = k + 1;  // of the stretch
        if (end <= last) {
          evaluate(end, next);
        } else {
          next = here;
        }
        for (std::size_t c = 0; c < columns_.size(); ++c) {
          stretch[c] = {here[c], next[c] - here[c]};
        }
        const auto continues = [&] {
          for (std::size_t c = 0; c < columns_.size(); ++c) {
            if (next[c] != stretch[c].first + static_cast<std::int32_t>(end - k) * stretch[c].stride) {
              return false;
            }
          }
          return true;
        };
        if (linear) {
          evaluate(last, next);
          end = last + 1;
        } else {
          while (end <= last && continues()) {
            if (++end <= last) {
              evaluate(end, next);
            }
          }
        }
        iterations_->append(static_cast<std::size_t>(end - k), stretch);
        k = end;
      }
    });
  }

  /// The slots of a term, whose elements are appended to `arguments`: of vectors, all that the iterations reach.
  std::vector<Loop::Slot> slots_of(Expression term, std::vector<Expression>& arguments, Graph& into,
                                   const FindComponent& find) const {
    std::vector<NodeIndex> read = reachable(std::span(&term, 1));
    std::erase_if(read, [&](NodeIndex index) { return !std::ranges::binary_search(slots_, index); });
    std::map<std::string, std::pair<std::int64_t, std::int64_t>> reach;  // of vectors: lowest and highest index
    for (const NodeIndex slot : read) {
      if (const auto element = builder_.elements_.find(slot); element != builder_.elements_.end()) {
        const auto [base, offset] = builder_.shifted(element->second.index);
        const std::size_t column = known_column(base);
        const auto [entry, is_new] = reach.try_emplace(element->second.vector, offset + lowest_[column], 0);
        auto& [lowest, highest] = entry->second;
        lowest = std::min(lowest, offset + lowest_[column]);
        highest = std::max(is_new ? lowest : highest, offset + highest_[column]);
      }
    }
    std::map<std::string, std::int64_t> zeros;  // the places of components 0
    for (const auto& [vector, range] : reach) {
      zeros[vector] = static_cast<std::int64_t>(arguments.size()) - range.first;
      for (std::int64_t i = range.first; i <= range.second; ++i) {
        const auto component = i < 0 ? std::nullopt : find(vector, i);
        if (!component) {
          throw NotALoop(fmt::format("there is no {}[{}]", vector, i));
        }
        arguments.push_back(*component);
      }
    }
    std::vector<Loop::Slot> slots;
    for (const NodeIndex slot : read) {
      Loop::Slot& added = slots.emplace_back(Loop::Slot{.variable = {&graph_, slot}, .place = {}});
      const auto end = static_cast<std::int64_t>(arguments.size());
      if (const auto import = builder_.imports_.find(slot); import != builder_.imports_.end()) {
        arguments.push_back(import->second);
        added.place.offset = end;
      } else if (const auto element = builder_.elements_.find(slot); element != builder_.elements_.end()) {
        const auto [base, offset] = builder_.shifted(element->second.index);
        added.place = {known_column(base), zeros.at(element->second.vector) + offset};
      } else {
        const std::size_t column = known_column(index_of(slot));
        added.place = {column, end - lowest_[column]};
        append_table(slot, column, arguments, into);
      }
    }
    return slots;
  }

  /// The numbers that a part of a term is for the values of its index.
  void append_table(NodeIndex part, std::size_t column, std::vector<Expression>& arguments, Graph& into) const {
    for (std::int32_t i = lowest_[column]; i <= highest_[column]; ++i) {
      const std::array value{graph_.constant(static_cast<double>(i))};
      const Expression number = substitute({&graph_, part}, std::array{columns_[column]}, value);
      if (!number.is_constant()) {
        throw NotALoop("a number that depends on an index is not finite");
      }
      arguments.push_back(into.constant(number.constant_value()));
    }
  }

  const LoopBuilder& builder_;
  Graph& graph_;
  std::vector<Range> ranges_;
  std::vector<ScalarEvaluator> bounds_;
  std::vector<double> values_;  ///< of the indices
  std::vector<Expression> terms_;
  std::vector<NodeIndex> slots_;
  std::vector<Expression> columns_;
  std::vector<std::int32_t> lowest_, highest_;  ///< values of the columns
  std::shared_ptr<Iterations> iterations_;
  std::size_t most_read_ = 0;
};

std::vector<LoopBuilder::Chain> LoopBuilder::chains_of(const std::vector<Nest>& nests) const {
  std::vector<Chain> chains;
  for (const Nest& nest : nests) {
    auto chain = std::ranges::find_if(chains, [&](const Chain& known) {
      return std::ranges::equal(known.ranges(), nest.ranges, {}, &Range::index, &Range::index);
    });
    if (chain == chains.end()) {
      chains.emplace_back(*this, nest.ranges);
      chain = std::prev(chains.end());
    }
    chain->add(nest.term);
  }
  return chains;
}

std::optional<Expression> LoopBuilder::finish(Expression sum, const FindComponent& find) {
  std::vector<Chain> chains = chains_of(sums_.at(sum.index()));
  std::size_t size = 0;
  for (Chain& chain : chains) {
    size += chain.size();
  }
  if (size < shortest_loop) {
    return std::nullopt;
  }
  std::vector<Expression> sums;
  std::size_t read = 0;
  for (Chain& chain : chains) {
    if (chain.size() == 0) {
      continue;
    }
    const auto built = chain.build(into_, find);
    if (!built) {
      return std::nullopt;
    }
    sums.push_back(*built);
    read += chain.most_read();
  }
  if (size < fewest_per_variable * read) {
    return std::nullopt;
  }
  return folded_sum(std::move(sums));
}

}  // namespace rubato::formula
