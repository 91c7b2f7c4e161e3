#include <rubato/pde/node_formula.hpp>

#include <algorithm>
#include <functional>
#include <iterator>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/grids/buffer.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/local_polynomial.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/variation/node_code.hpp>
#include <rubato/variation/node_pass.hpp>

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
  std::vector<formula::Expression> outputs;
  std::vector<std::string> fields, numbers;
  grids::Grid grid;
  std::vector<Input> inputs;
  std::vector<formula::Expression> variables;           ///< of the inputs
  std::optional<grids::SpectralDerivative> derivative;  ///< where one is needed
  /// Made when they are first needed: the values at nodes, their sums, and the values at a point.
  ///@{
  std::optional<NodeCode> at_nodes;
  std::optional<NodePass> sums;
  std::optional<formula::ScalarEvaluator> at_point;
  ///@}

  Storage(std::shared_ptr<const formula::Graph> g, std::vector<formula::Expression> expressions,
          std::vector<std::string> names, const grids::Grid& on, std::vector<std::string> more)
      : graph(std::move(g)),
        outputs(std::move(expressions)),
        fields(std::move(names)),
        numbers(std::move(more)),
        grid(on) {
    std::vector<std::size_t> found;
    for (const formula::Expression& expression : outputs) {
      for (const std::size_t number : formula::variables_of(expression)) {
        if (std::ranges::find(found, number) == found.end()) {
          found.push_back(number);
        }
      }
    }
    for (const std::size_t number : found) {
      const std::string& name = graph->variable_name(number);
      inputs.push_back(understand(name));
      if (!inputs.back().derivatives.empty() && !derivative) {
        derivative.emplace(grid);
      }
      variables.push_back(known(name));
    }
  }

  /// The graph makes no new node for a variable that it has.
  [[nodiscard]] formula::Expression known(const std::string& name) const {
    return outputs.front().graph()->variable(name);
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
                                        const PotentialSlopes& slopes, grids::Buffer& room) const {
    const double* from = values[static_cast<std::size_t>(input.number)];
    if (input.derivatives.empty()) {
      return from;
    }
    room = grids::Buffer(grid.size());
    for (const int axis : input.derivatives) {
      if (grid.axis(axis).has_walls()) {
        grids::local_derivative(grid, axis, from, room.data());
      } else {
        (*derivative)(axis, from, room.data());
      }
      from = room.data();
    }
    if (input.derivatives == std::vector<int>{0} && !slopes.of_field.empty()) {
      grids::for_each_block(room.size(), grids::nodes_per_block, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
          room[i] += slopes.at(input.number, i / grid.cells(0));
        }
      });
    }
    return from;
  }

  /// Arrays of a code are the inputs, its numbers t and the others.
  [[nodiscard]] NodeCode code(std::span<const formula::Expression> formulas,
                              std::span<const formula::Expression> weights = {}) const {
    std::vector<NodeInput> of_code;
    std::vector<PlaceNumbers> of_axes(static_cast<std::size_t>(grid.dimensions()));
    for (int a = 0; a < grid.dimensions(); ++a) {
      of_axes[static_cast<std::size_t>(a)].axis = a;
      for (std::size_t i = 0; i < grid.cells(a); ++i) {
        of_axes[static_cast<std::size_t>(a)].values.push_back(grid.axis(a).node(i));
      }
    }
    for (std::size_t j = 0; j < inputs.size(); ++j) {
      NodeInput& input = of_code.emplace_back();
      input.variable = variables[j];
      switch (inputs[j].kind) {
        case Input::Kind::field: input.number = static_cast<int>(j); break;
        case Input::Kind::time: input.kind = NodeInput::Kind::uniform; break;
        case Input::Kind::number:
          input.kind = NodeInput::Kind::uniform;
          input.number = 1 + inputs[j].number;
          break;
        case Input::Kind::axis: input.kind = NodeInput::Kind::axis; input.number = inputs[j].number;
      }
    }
    for (std::size_t a = 0; a < weights.size(); ++a) {
      NodeInput& input = of_code.emplace_back();
      input.variable = weights[a];
      input.kind = NodeInput::Kind::axis;
      input.number = static_cast<int>(of_axes.size());
      PlaceNumbers& weight = of_axes.emplace_back();
      weight.axis = static_cast<int>(a);
      for (std::size_t i = 0; i < grid.cells(weight.axis); ++i) {
        weight.values.push_back(grid.axis(weight.axis).weight(i));
      }
    }
    return NodeCode(formulas, of_code, grid, std::move(of_axes));
  }

  /// Lets a code read a level, and evaluates what it is for.
  void read_for(NodeCode& code, std::span<const double* const> values, double t, const PotentialSlopes& slopes,
                std::span<const double> constants, const std::function<void()>& evaluate) const {
    std::vector<grids::Buffer> rooms(inputs.size());
    std::vector<const double*> arrays(inputs.size(), nullptr);
    for (std::size_t j = 0; j < inputs.size(); ++j) {
      if (inputs[j].kind == Input::Kind::field) {
        arrays[j] = values_of(inputs[j], values, slopes, rooms[j]);
      }
    }
    std::vector<double> all = {t};
    all.insert(all.end(), constants.begin(), constants.end());
    code.read(arrays, all, slopes);
    evaluate();
  }
};

NodeFormula::NodeFormula(std::shared_ptr<const formula::Graph> graph, std::vector<formula::Expression> outputs,
                         std::vector<std::string> fields, const grids::Grid& grid, std::vector<std::string> numbers)
    : storage_(std::make_unique<Storage>(std::move(graph), std::move(outputs), std::move(fields), grid,
                                         std::move(numbers))) {}
NodeFormula::~NodeFormula() = default;
NodeFormula::NodeFormula(NodeFormula&&) noexcept = default;
NodeFormula& NodeFormula::operator=(NodeFormula&&) noexcept = default;

std::vector<std::vector<double>> NodeFormula::operator()(std::span<const double* const> values, double t,
                                                         const PotentialSlopes& slopes,
                                                         std::span<const double> numbers) {
  Storage& s = *storage_;
  if (!s.at_nodes) {
    s.at_nodes = s.code(s.outputs);
  }
  std::vector<std::vector<double>> results(s.outputs.size(), std::vector<double>(s.grid.size()));
  std::vector<double*> out;
  std::ranges::transform(results, std::back_inserter(out), [](auto& result) { return result.data(); });
  s.read_for(*s.at_nodes, values, t, slopes, numbers, [&] { (*s.at_nodes)(out); });
  return results;
}

std::vector<std::vector<double>> NodeFormula::operator()(const LatticeLevel& level, double t,
                                                         std::span<const double> numbers) {
  return (*this)(level.fields.pointers(), t, level.slopes, numbers);
}

std::vector<double> NodeFormula::at_point(const LatticeLevel& level, double t, const grids::PointInterpolation& point,
                                          std::span<const double> numbers) {
  Storage& s = *storage_;
  std::vector<double> inputs;
  grids::Buffer room;
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
  if (!s.at_point) {
    s.at_point.emplace(formula::Bytecode(s.outputs, s.variables));
  }
  std::vector<double> results(s.outputs.size());
  (*s.at_point)(inputs, results);
  return results;
}

std::vector<double> NodeFormula::integrals(const LatticeLevel& level, double t) {
  Storage& s = *storage_;
  if (!s.sums) {
    std::vector<formula::Expression> weights, weighed = s.outputs;
    for (int a = 0; s.grid.has_walls() && a < s.grid.dimensions(); ++a) {
      weights.push_back(s.known(fmt::format("the weight along {}", s.grid.axis(a).name)));
      std::ranges::transform(weighed, weighed.begin(), [&](const auto& one) { return one * weights.back(); });
    }
    s.sums.emplace(s.grid);
    s.sums->add(s.code(weighed, weights), {});
  }
  s.read_for(s.sums->code(0), level.fields.pointers(), t, level.slopes, {}, [&s] { (*s.sums)(0); });
  std::vector<double> totals(s.sums->sums().begin(), s.sums->sums().end());
  for (double& total : totals) {
    total *= s.grid.cell_volume();
  }
  return totals;
}

}  // namespace rubato
