#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/formula/loop.hpp>

namespace rubato::formula {

/// A sum that does not stay a loop: its terms are written out.
class NotALoop : public std::runtime_error {
public:
  using std::runtime_error::runtime_error;
};

/// Makes a loop (loop.hpp) of a sum whose term was read once, in a graph of its own: in terms of the indices of the sum
/// and of those within it, of elements of vectors at such indices, and of formulas of the graph it goes into.
class LoopBuilder {
public:
  explicit LoopBuilder(Graph& into) : into_(into) {}

  [[nodiscard]] Graph& graph() { return *graph_; }
  /// A formula of the other graph.
  [[nodiscard]] Expression import(Expression of_other);
  [[nodiscard]] Expression new_index();
  [[nodiscard]] Expression element(std::string_view vector, Expression index);
  /// Σ term over the values of the index from `first` to `last`; a variable of this graph stands for it.
  [[nodiscard]] Expression sum(Expression index, Expression first, Expression last, Expression term);

  /// Whether a formula is a number once the indices are known.
  [[nodiscard]] bool is_of_indices(Expression expression) const;
  /// last - first, if it is the same for all values of the indices.
  [[nodiscard]] std::optional<std::int64_t> distance(Expression first, Expression last) const;

  using FindComponent = std::function<std::optional<Expression>(std::string_view vector, std::int64_t index)>;
  /// The outermost sum in the other graph; none if it has less than shortest_loop iterations, or less than
  /// fewest_per_variable for each variable that it reads, or is a number.
  /// \throws NotALoop
  [[nodiscard]] std::optional<Expression> finish(Expression sum, const FindComponent& find);

  /// Fewer iterations are written out: in straight code values that several of them need are computed once.
  static constexpr std::size_t shortest_loop = 1024;
  /// Likewise: the code of chains and lattices, which have one or two, is no longer than their states.
  static constexpr std::size_t fewest_per_variable = 4;

private:
  struct Range {
    Expression index, first, last;
  };
  /// A term that is summed over ranges, the outermost first.
  struct Nest {
    std::vector<Range> ranges;
    Expression term;
  };
  struct Element {
    std::string vector;
    Expression index;
  };
  /// index = base + offset
  struct Shifted {
    Expression base;
    std::int64_t offset;
  };
  class Chain;

  [[nodiscard]] Shifted shifted(Expression index) const;
  [[nodiscard]] bool has_sums(Expression expression) const;
  using Wrap = std::function<Expression(Expression)>;
  void expand(Expression expression, const Wrap& wrap, std::vector<Nest>& nests) const;
  [[nodiscard]] std::vector<Chain> chains_of(const std::vector<Nest>& nests) const;

  Graph& into_;
  std::shared_ptr<Graph> graph_ = std::make_shared<Graph>();
  std::vector<Expression> indices_;
  std::map<NodeIndex, Expression> imports_;  ///< by variable of this graph
  std::map<NodeIndex, Element> elements_;
  std::map<NodeIndex, std::vector<Nest>> sums_;
};

}  // namespace rubato::formula
