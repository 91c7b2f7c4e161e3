#include <rubato/pde/node_formula.hpp>

#include <algorithm>
#include <array>
#include <iterator>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/local_polynomial.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/grids/weights.hpp>

namespace rubato {

namespace {

/// Where the values of a variable come from.
struct Input {
  enum class Kind { time, axis, field, number } kind = Kind::time;
  int number = 0;                ///< of the axis, the field or the number
  std::vector<int> derivatives;  ///< axes, the innermost first
};

}  // namespace

struct NodeFormula::Storage {
  std::shared_ptr<const formula::Graph> graph;
  std::vector<std::string> fields, numbers;
  grids::Grid grid;
  std::size_t outputs;
  std::vector<Input> inputs;
  formula::BatchEvaluator evaluate;
  std::optional<grids::SpectralDerivative> derivative;  ///< where one is needed

  Storage(std::shared_ptr<const formula::Graph> g, std::span<const formula::Expression> expressions,
          std::vector<std::string> names, const grids::Grid& on, std::vector<std::string> more)
      : graph(std::move(g)), fields(std::move(names)), numbers(std::move(more)), grid(on), outputs(expressions.size()) {
    std::vector<std::size_t> found;
    for (const formula::Expression expression : expressions) {
      for (const std::size_t number : formula::variables_of(expression)) {
        if (std::ranges::find(found, number) == found.end()) {
          found.push_back(number);
        }
      }
    }
    std::vector<formula::Expression> variables;
    for (const std::size_t number : found) {
      const std::string& name = graph->variable_name(number);
      inputs.push_back(understand(name));
      if (!inputs.back().derivatives.empty() && !derivative) {
        derivative.emplace(grid);
      }
      // The graph makes no new node for a variable that it has.
      variables.push_back(expressions.front().graph()->variable(name));
    }
    evaluate = formula::BatchEvaluator(formula::Bytecode(expressions, variables));
  }

  [[nodiscard]] Input understand(std::string name) const {
    const std::string whole = name;
    Input input;
    while (name.size() > 4 && name[0] == 'd' && name[2] == '(' && name.back() == ')') {
      const int axis = find_axis(name.substr(1, 1));
      if (axis < 0) {
        break;
      }
      input.derivatives.insert(input.derivatives.begin(), axis);
      name = name.substr(3, name.size() - 4);
    }
    if (const auto field = std::ranges::find(fields, name); field != fields.end()) {
      input.kind = Input::Kind::field;
      input.number = static_cast<int>(field - fields.begin());
      return input;
    }
    if (input.derivatives.empty() && name == "t") {
      return input;
    }
    if (const auto place = std::ranges::find(numbers, name); place != numbers.end()) {
      input.kind = Input::Kind::number;
      input.number = static_cast<int>(place - numbers.begin());
      return input;
    }
    if (input.derivatives.empty() && find_axis(name) >= 0) {
      input.kind = Input::Kind::axis;
      input.number = find_axis(name);
      return input;
    }
    throw std::invalid_argument(
        fmt::format("a formula on the grid names {}; it may name the fields {}, their derivatives, the grid's "
                    "coordinates and t",
                    whole, fmt::join(fields, ", ")));
  }

  [[nodiscard]] int find_axis(const std::string& name) const {
    for (int a = 0; a < grid.dimensions(); ++a) {
      if (grid.axis(a).name == name) {
        return a;
      }
    }
    return -1;
  }

  /// A derivative of a field at every node, made in `room`; a field itself is where it is.
  [[nodiscard]] const double* values_of(const Input& input, std::span<const double* const> values,
                                        const PotentialSlopes& slopes, std::vector<double>& room) const {
    const double* const field = values[static_cast<std::size_t>(input.number)];
    if (input.derivatives.empty()) {
      return field;
    }
    room.assign(field, field + grid.size());
    for (const int axis : input.derivatives) {
      if (grid.axis(axis).has_walls()) {
        grids::local_derivative(grid, axis, room.data(), room.data());
      } else {
        (*derivative)(axis, room.data(), room.data());
      }
    }
    if (input.derivatives == std::vector<int>{0}) {
      for (std::size_t i = 0; i < room.size(); ++i) {
        room[i] += slopes.at(input.number, i / grid.cells(0));
      }
    }
    return room.data();
  }

  static constexpr std::size_t block_nodes = grids::nodes_per_block;

  /// Evaluates the formulas at the nodes of [first, end), a block at a time: place(begin) says where the values of
  /// each go, used(begin, count) reads them.
  template <class Place, class Use>
  void in_blocks(std::span<const double* const> values, double t, const PotentialSlopes& slopes,
                 std::span<const double> constants, std::size_t first, std::size_t end, const Place& place,
                 const Use& used) {
    std::vector<std::vector<double>> rooms(inputs.size());
    std::vector<const double*> whole(inputs.size(), nullptr), in(inputs.size());
    for (std::size_t j = 0; j < inputs.size(); ++j) {
      const Input& input = inputs[j];
      switch (input.kind) {
        case Input::Kind::field: whole[j] = values_of(input, values, slopes, rooms[j]); break;
        case Input::Kind::time: rooms[j].assign(block_nodes, t); break;
        case Input::Kind::number:
          rooms[j].assign(block_nodes, constants[static_cast<std::size_t>(input.number)]);
          break;
        case Input::Kind::axis: rooms[j].resize(block_nodes);
      }
    }
    for (std::size_t begin = first; begin < end; begin += block_nodes) {
      const std::size_t count = std::min(block_nodes, end - begin);
      for (std::size_t j = 0; j < inputs.size(); ++j) {
        const int axis = inputs[j].number;
        for (std::size_t i = 0; inputs[j].kind == Input::Kind::axis && i < count; ++i) {
          rooms[j][i] = grid.axis(axis).node((begin + i) / grid.stride(axis) % grid.cells(axis));
        }
        in[j] = whole[j] != nullptr ? whole[j] + begin : rooms[j].data();
      }
      evaluate(count, in, place(begin));
      used(begin, count);
    }
  }
};

NodeFormula::NodeFormula(std::shared_ptr<const formula::Graph> graph, std::vector<formula::Expression> outputs,
                         std::vector<std::string> fields, const grids::Grid& grid, std::vector<std::string> numbers)
    : storage_(std::make_unique<Storage>(std::move(graph), outputs, std::move(fields), grid, std::move(numbers))) {}
NodeFormula::~NodeFormula() = default;
NodeFormula::NodeFormula(NodeFormula&&) noexcept = default;
NodeFormula& NodeFormula::operator=(NodeFormula&&) noexcept = default;

std::vector<std::vector<double>> NodeFormula::operator()(std::span<const double* const> values, double t,
                                                         const PotentialSlopes& slopes,
                                                         std::span<const double> numbers) {
  Storage& s = *storage_;
  std::vector<std::vector<double>> results(s.outputs, std::vector<double>(s.grid.size()));
  std::vector<double*> out(s.outputs);
  const auto place = [&](std::size_t begin) -> std::span<double* const> {
    std::ranges::transform(results, out.begin(), [begin](std::vector<double>& result) { return &result[begin]; });
    return out;
  };
  s.in_blocks(values, t, slopes, numbers, 0, s.grid.size(), place, [](std::size_t, std::size_t) {});
  return results;
}

std::vector<std::vector<double>> NodeFormula::operator()(const LatticeLevel& level, double t,
                                                         std::span<const double> numbers) {
  return (*this)(level.fields.pointers(), t, level.slopes, numbers);
}

std::vector<double> NodeFormula::at_point(const LatticeLevel& level, double t, const grids::PointInterpolation& point,
                                          std::span<const double> numbers) {
  Storage& s = *storage_;
  std::vector<double> inputs, room;
  for (const Input& input : s.inputs) {
    const auto number = static_cast<std::size_t>(input.number);
    switch (input.kind) {
      case Input::Kind::time: inputs.push_back(t); break;
      case Input::Kind::number: inputs.push_back(numbers[number]); break;
      case Input::Kind::axis: inputs.push_back(point.coordinates()[number]); break;
      case Input::Kind::field:
        inputs.push_back(
            point(std::span(s.values_of(input, level.fields.pointers(), level.slopes, room), s.grid.size())));
    }
  }
  std::vector<const double*> in;
  for (const double& value : inputs) {
    in.push_back(&value);
  }
  std::vector<double> results(s.outputs);
  std::vector<double*> out;
  for (double& value : results) {
    out.push_back(&value);
  }
  s.evaluate(1, in, out);
  return results;
}

std::vector<double> NodeFormula::integrals(const LatticeLevel& level, double t) {
  Storage& s = *storage_;
  const grids::Slab* const slab = grids::Slab::of(s.grid);
  const std::size_t first = slab == nullptr ? 0 : slab->first_node();
  const std::size_t end = slab == nullptr ? s.grid.size() : first + slab->owned();
  std::vector<std::array<double, Storage::block_nodes>> values(s.outputs);
  std::vector<double*> out;
  std::ranges::transform(values, std::back_inserter(out), [](auto& of_one) { return of_one.data(); });
  std::vector<CompensatedSum> sums(s.outputs);
  s.in_blocks(
      level.fields.pointers(), t, level.slopes, {}, first, end,
      [&](std::size_t) -> std::span<double* const> { return out; },
      [&](std::size_t begin, std::size_t count) {
        for (std::size_t j = 0; j < s.outputs; ++j) {
          const auto terms = std::span<double>(values[j]).first(count);
          if (s.grid.has_walls()) {
            grids::weigh(s.grid, begin, terms);
          }
          grids::LaneSum sum;
          sum.add(terms);
          sums[j].add(sum.total());
        }
      });
  std::vector<double> totals(s.outputs);
  if (slab != nullptr) {
    slab->reduce(sums, totals, {});
  } else {
    std::ranges::transform(sums, totals.begin(), &CompensatedSum::value);
  }
  for (double& total : totals) {
    total *= s.grid.cell_volume();
  }
  return totals;
}

}  // namespace rubato
