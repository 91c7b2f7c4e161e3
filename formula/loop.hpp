#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/formula/expression.hpp>

namespace rubato::formula {

/// The iterations of a loop, one after the other, and integers that each of them has: the columns of a table. Stored
/// are the stretches along which all columns grow linearly: of a sum over pairs, one for each value of the outer index.
class Iterations {
public:
  struct Column {
    std::int32_t first, stride;
  };

  explicit Iterations(std::size_t columns) : columns_(columns) {}

  /// Appends `count` iterations; `columns` are the values of the first, and what each further one adds.
  void append(std::size_t count, std::span<const Column> columns);

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t columns() const { return columns_; }
  [[nodiscard]] std::span<const std::size_t> lengths() const { return lengths_; }  ///< of the stretches
  [[nodiscard]] const Column& column(std::size_t stretch, std::size_t column) const {
    return table_[stretch * columns_ + column];
  }

private:
  std::size_t columns_, size_ = 0;
  std::vector<std::size_t> lengths_;
  std::vector<Column> table_;
};

/// The sums r_o = Σ f_s(x_1, …, x_k) over the iterations and terms with target o: in each iteration the slots x of the
/// terms are elements of the arguments. A node `loop` of a graph is a loop at a list of arguments of that graph; its
/// outputs are nodes `component`. Immutable.
struct Loop {
  /// Element `offset` of the arguments or outputs, or `offset` plus the value of a column.
  struct Place {
    std::optional<std::size_t> column;
    std::int64_t offset = 0;

    [[nodiscard]] std::int64_t at(const Iterations& iterations, std::size_t stretch, std::size_t k) const {
      if (!column) {
        return offset;
      }
      const auto [first, stride] = iterations.column(stretch, *column);
      return offset + first + static_cast<std::int64_t>(k) * stride;
    }
  };
  struct Slot {
    Expression variable;  ///< of `graph`, called slot_name(place)
    Place place;
  };
  struct Term {
    Expression value;  ///< of `graph`
    Place target;
  };

  std::shared_ptr<const Iterations> iterations;
  std::shared_ptr<const Graph> graph;
  std::vector<Slot> slots;
  std::vector<Term> terms;
  std::size_t output_count = 1;

  [[nodiscard]] static std::string slot_name(const Place& place);
  /// Whether this is one sum of one term.
  [[nodiscard]] bool is_sum() const { return output_count == 1 && terms.size() == 1; }
};

/// The loop whose outputs are the derivatives Σ_o r̄_o ∂r_o/∂(argument) by each of the `arguments`: sums of r̄ ∂f/∂x over
/// the slots and iterations that read it. Of a sum r̄ is 1; of other loops it is read from as many further arguments as
/// the loop has outputs, behind its own.
[[nodiscard]] std::shared_ptr<const Loop> gradient_of(const Loop& loop, std::size_t arguments);

/// Whether the expressions depend on a loop.
[[nodiscard]] bool has_loops(std::span<const Expression> expressions);
[[nodiscard]] bool has_loops(Expression expression);

/// The same without loops: each iteration written out, in the same graph.
[[nodiscard]] std::vector<Expression> unrolled(std::span<const Expression> expressions);
[[nodiscard]] Expression unrolled(Expression expression);

/// The terms of a sum of which those that are loops are replaced by sums of the magnitudes of their terms.
[[nodiscard]] std::vector<Expression> magnitudes_of_loops(std::vector<Expression> terms);

}  // namespace rubato::formula
