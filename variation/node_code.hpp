#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/grids/field_set.hpp>
#include <rubato/grids/grid.hpp>
#include <rubato/grids/stencil.hpp>
#include <rubato/variation/potential_slopes.hpp>

namespace rubato {

/// A place `by` further than `offset` or, with sign = -1, before it; in nodes along each axis.
[[nodiscard]] inline std::array<int, 3> shifted(std::array<int, 3> offset, const std::array<int, 3>& by, int sign = 1) {
  for (std::size_t a = 0; a < offset.size(); ++a) {
    offset[a] += sign * by[a];
  }
  return offset;
}

/// What a variable of a NodeCode stands for at a node.
struct NodeInput {
  enum class Kind {
    node,    ///< an array's value at the node so many nodes further along each axis, cyclically
    slope,   ///< the slope of a potential, of the line so much further: of PotentialSlopes, field `number`
    axis,    ///< a number of each place along an axis, at that so much further: of PlaceNumbers `number`
    uniform  ///< the same number everywhere
  };
  formula::Expression variable;
  Kind kind = Kind::node;
  int number = 0;               ///< of the array, the field, the PlaceNumbers, or the uniform number
  std::array<int, 3> offset{};  ///< in nodes
};

/// A number of each place along one axis.
struct PlaceNumbers {
  int axis = 0;
  std::vector<double> values;

  bool operator==(const PlaceNumbers&) const = default;
};

/// Formulas of a node and its neighbours, evaluated at all nodes of a periodic grid: neighbours are read where they
/// are, and copied only where a line comes round its seam. A node's result depends on neither the number of threads
/// nor how a range is split.
class NodeCode {
public:
  NodeCode() = default;
  /// Of the inputs those that no output depends on are left out.
  /// \throws std::invalid_argument if an output depends on a variable that is none of the inputs
  NodeCode(std::span<const formula::Expression> outputs, std::span<const NodeInput> inputs, const grids::Grid& grid,
           std::vector<PlaceNumbers> of_axes = {});

  /// What evaluations read from now on: it has to stay there. Arrays are the fields of one set after those of the
  /// other.
  ///@{
  void read(std::span<const double* const> arrays, std::span<const double> numbers, const PotentialSlopes& slopes);
  void read(std::span<const grids::FieldSet* const> arrays, std::span<const double> numbers,
            const PotentialSlopes& slopes);
  void read(std::initializer_list<const grids::FieldSet*> arrays, std::span<const double> numbers,
            const PotentialSlopes& slopes) {
    read(std::span(arrays.begin(), arrays.size()), numbers, slopes);
  }
  ///@}
  /// outputs[j][i] at the nodes i in [begin, end). No output may be an array that is read.
  void operator()(std::size_t begin, std::size_t end, std::span<double* const> outputs);
  void operator()(std::span<double* const> outputs) { (*this)(0, cells_[0] * cells_[1] * cells_[2], outputs); }
  /// The same by the thread of this number alone. Outputs after the first ones, as many as `from_begin` has, are
  /// reported from the first node of the range on: from_begin[k][i - begin].
  void evaluate(std::size_t thread, std::size_t begin, std::size_t end, std::span<double* const> outputs,
                std::span<double* const> from_begin = {});

  [[nodiscard]] std::size_t outputs() const { return outputs_; }
  /// How far in the order of nodes, but for the seams of the last axis, the nodes of some arrays are that it reads at a
  /// node; nothing if it reads none of these arrays.
  [[nodiscard]] std::optional<std::size_t> reach(std::span<const int> arrays) const;

private:
  static constexpr std::size_t piece = 256;

  /// One thread's.
  struct Workspace {
    formula::BatchEvaluator code;
    std::vector<const double*> in;
    std::vector<double*> out;
    std::vector<std::array<double, piece>> copies;  ///< of each input
    /// Makes all of a copy this number.
    void fill(std::size_t input, double value);
  };
  /// The rest of read().
  void prepare(std::span<const double> numbers, const PotentialSlopes& slopes);
  /// Lets the code read `count` nodes of a line.
  void place_inputs(Workspace& work, std::size_t line, std::size_t begin, std::size_t count) const;

  std::array<std::size_t, 3> cells_{};
  std::vector<NodeInput> inputs_;
  std::vector<PlaceNumbers> of_axes_;
  formula::BatchEvaluator prototype_;
  std::size_t outputs_ = 0;
  std::vector<Workspace> workspaces_;
  std::vector<const double*> arrays_;
  std::vector<double> numbers_;
  const PotentialSlopes* slopes_ = nullptr;
};

/// Makes the variables of such formulas.
class NodeFormulas {
public:
  explicit NodeFormulas(const grids::Grid& grid) : grid_(grid), graph_(std::make_shared<formula::Graph>()) {}

  [[nodiscard]] formula::Graph& graph() { return *graph_; }
  [[nodiscard]] const grids::Grid& grid() const { return grid_; }

  /// An array's value at the node so much further.
  [[nodiscard]] formula::Expression node(int array, std::array<int, 3> offset = {}) {
    return variable({{}, NodeInput::Kind::node, array, offset});
  }
  /// The slope of a potential, of the line so much further.
  [[nodiscard]] formula::Expression slope(int field, std::array<int, 3> offset = {}) {
    return variable({{}, NodeInput::Kind::slope, field, {0, offset[1], offset[2]}});
  }
  [[nodiscard]] formula::Expression uniform(int number) { return variable({{}, NodeInput::Kind::uniform, number, {}}); }
  /// A number of each place along an axis, at the place so much further.
  [[nodiscard]] formula::Expression along_axis(const PlaceNumbers& numbers, int offset = 0);
  /// What an input stands for at a node so far from this one.
  [[nodiscard]] formula::Expression at(const NodeInput& input, const std::array<int, 3>& offset);
  /// Those inputs that a formula depends on.
  [[nodiscard]] std::vector<NodeInput> inputs_of(formula::Expression formula) const;

  /// A term whose sum between walls is wanted, times the part of it that is there (grids::Axis::ghosts): one half where
  /// the middle of what it reads is on a wall, and 0 beyond. \param middle twice the place of that, in nodes from this
  /// one
  [[nodiscard]] formula::Expression between_walls(formula::Expression term, const std::array<int, 3>& middle);
  /// The same of each term of a sum. \param shift(input) twice the distance of a value from its node
  ///@{
  using Shift = std::function<std::array<int, 3>(const NodeInput& input)>;
  [[nodiscard]] formula::Expression between_walls(formula::Expression sum, const Shift& shift);
  [[nodiscard]] formula::Expression between_walls(formula::Expression sum) {
    return between_walls(sum, [](const NodeInput&) { return std::array<int, 3>{}; });
  }
  ///@}
  /// Twice the middle of what a formula reads.
  [[nodiscard]] std::array<int, 3> middle_of(formula::Expression formula, const Shift& shift) const;
  /// A box operator of an array in a cell, nodes added with their signs first and scaled once: a difference of equal
  /// values is exactly zero.
  /// \throws std::invalid_argument for a spectral derivative, which reads all nodes
  [[nodiscard]] formula::Expression in_cell(const grids::SpaceOperator& op, int array, std::array<int, 3> cell = {});

  /// What a box operator takes of the nodes around a cell.
  using Weights = std::vector<std::pair<std::array<int, 3>, double>>;
  [[nodiscard]] Weights weights(const grids::SpaceOperator& op) const;

  /// What has been asked for.
  [[nodiscard]] std::span<const NodeInput> inputs() const { return inputs_; }

  /// Such formulas as code.
  [[nodiscard]] NodeCode code(std::span<const formula::Expression> outputs) const {
    return {outputs, inputs_, grid_, of_axes_};
  }

private:
  formula::Expression variable(NodeInput input);

  grids::Grid grid_;
  std::shared_ptr<formula::Graph> graph_;
  std::vector<NodeInput> inputs_;
  std::vector<PlaceNumbers> of_axes_;
};

/// sum + weight·term of formulas, a weight of ±1 as a sign; without what is zero. An invalid sum is none yet.
void add_weighted(formula::Expression& sum, double weight, const formula::Expression& term);

}  // namespace rubato
