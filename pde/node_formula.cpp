#include <rubato/pde/node_formula.hpp>

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/local_polynomial.hpp>
#include <rubato/grids/reductions.hpp>

namespace rubato {

namespace {

/// Where the values of a variable come from.
struct Input {
  enum class Kind { time, axis, field, number } kind = Kind::time;
  int number = 0;                ///< of the axis, the field or the number
  std::vector<int> derivatives;  ///< axes, the innermost first
  std::vector<double> places;    ///< of the nodes along the axis
};

}  // namespace

struct NodeFormula::Storage {
  std::shared_ptr<const formula::Graph> graph;
  std::vector<std::string> fields, numbers;
  grids::Grid grid;
  std::size_t outputs;
  std::vector<Input> inputs;
  formula::BatchEvaluator evaluate;
  grids::SpectralDerivative derivative;

  Storage(std::shared_ptr<const formula::Graph> g, std::span<const formula::Expression> expressions,
          std::vector<std::string> names, const grids::Grid& on, std::vector<std::string> more)
      : graph(std::move(g)),
        fields(std::move(names)),
        numbers(std::move(more)),
        grid(on),
        outputs(expressions.size()),
        derivative(on) {
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
      input.places.resize(grid.size());
      for (std::size_t i = 0; i < grid.size(); ++i) {
        input.places[i] = grid.axis(input.number).node(i / grid.stride(input.number) % grid.cells(input.number));
      }
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

  /// The values of one input at every node, made in `room` where they are nowhere else.
  [[nodiscard]] const double* values_of(const Input& input, std::span<const double* const> values, double t,
                                        const PotentialSlopes& slopes, std::span<const double> constants,
                                        std::vector<double>& room) const {
    const auto number = static_cast<std::size_t>(input.number);
    switch (input.kind) {
      case Input::Kind::time: room.assign(grid.size(), t); break;
      case Input::Kind::number: room.assign(grid.size(), constants[number]); break;
      case Input::Kind::axis: return input.places.data();
      case Input::Kind::field:
        if (input.derivatives.empty()) {
          return values[number];
        }
        room.assign(values[number], values[number] + grid.size());
        for (const int axis : input.derivatives) {
          if (grid.axis(axis).has_walls()) {
            grids::local_derivative(grid, axis, room.data(), room.data());
          } else {
            derivative(axis, room.data(), room.data());
          }
        }
        if (input.derivatives == std::vector<int>{0}) {
          for (std::size_t i = 0; i < room.size(); ++i) {
            room[i] += slopes.at(input.number, i / grid.cells(0));
          }
        }
    }
    return room.data();
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
  std::vector<std::vector<double>> rooms(s.inputs.size());
  std::vector<const double*> in;
  for (std::size_t i = 0; i < rooms.size(); ++i) {
    in.push_back(s.values_of(s.inputs[i], values, t, slopes, numbers, rooms[i]));
  }
  std::vector<std::vector<double>> results(s.outputs, std::vector<double>(s.grid.size()));
  std::vector<double*> out;
  out.reserve(results.size());
  for (auto& result : results) {
    out.push_back(result.data());
  }
  s.evaluate(s.grid.size(), in, out);
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
        inputs.push_back(point(
            std::span(s.values_of(input, level.fields.pointers(), t, level.slopes, numbers, room), s.grid.size())));
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
  const std::vector<std::vector<double>> values = (*this)(level, t);
  const std::vector<std::span<const double>> rows(values.begin(), values.end());
  return grids::integrals(storage_->grid, rows);
}

}  // namespace rubato
