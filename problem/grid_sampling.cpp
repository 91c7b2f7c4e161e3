#include <rubato/problem/grid_sampling.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <rubato/base/larger.hpp>
#include <rubato/pde/node_formula.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// A grid with all nodes along one axis, periodic, and few along the others; moved by a part of a cell along it.
grids::Grid lines_of(const grids::Grid& grid, int axis, double part) {
  constexpr std::size_t few = 16;
  std::vector<grids::Axis> axes;
  for (int a = 0; a < grid.dimensions(); ++a) {
    const grids::Axis& whole = grid.axis(a);
    const double move = a == axis ? part * whole.spacing() : 0.0;
    const std::size_t cells = whole.cell_count();
    axes.push_back({.name = whole.name,
                    .from = whole.from + move,
                    .to = whole.to + move,
                    .cells = a == axis ? cells : std::min(few, cells)});
  }
  return grids::Grid(std::move(axes));
}

double rms(const std::vector<double>& values) {
  double squares = 0.0;
  for (const double value : values) {
    squares += value * value;
  }
  return std::sqrt(squares / static_cast<double>(values.size()));
}

/// Of one formula on these lines.
class Sampling {
public:
  Sampling(std::shared_ptr<const formula::Graph> graph, formula::Expression formula, std::vector<std::string> fields,
           std::span<const double> typical, double t)
      : graph_(std::move(graph)), formula_(formula), fields_(std::move(fields)), typical_(typical), t_(t) {}

  [[nodiscard]] double lost_along(const grids::Grid& grid, int axis) const {
    const std::vector<double> here = at(lines_of(grid, axis, 0.0)), next = at(lines_of(grid, axis, 1.0));
    double lost = std::numeric_limits<double>::quiet_NaN();
    for (const double part : {0.5 * (3.0 - std::sqrt(5.0)), 0.5}) {
      std::vector<double> between = at(lines_of(grid, axis, part)), off = between;
      double mean = 0.0;
      for (std::size_t i = 0; i < off.size(); ++i) {
        off[i] -= (1.0 - part) * here[i] + part * next[i];
        mean += between[i] / static_cast<double>(between.size());
      }
      const double size = std::abs(mean);
      std::ranges::for_each(between, [mean](double& value) { value -= mean; });
      // A constant, but for rounding.
      const double all = rms(between), least = 64.0 * std::numeric_limits<double>::epsilon() * size;
      if (all > least && !(rms(off) / all <= lost)) {
        lost = rms(off) / all;
      }
    }
    return lost;
  }

private:
  [[nodiscard]] std::vector<double> at(const grids::Grid& lines) const {
    std::vector<std::vector<double>> values;
    std::vector<const double*> fields;
    for (const double value : typical_) {
      values.emplace_back(lines.size(), value);
    }
    fields.resize(fields_.size(), nullptr);
    std::ranges::transform(values, fields.begin(), [](const std::vector<double>& field) { return field.data(); });
    return std::move(NodeFormula(graph_, {formula_}, fields_, lines)(fields, t_).front());
  }

  std::shared_ptr<const formula::Graph> graph_;
  formula::Expression formula_;
  std::vector<std::string> fields_;
  std::span<const double> typical_;
  double t_;
};

}  // namespace

double lost_between_nodes(const Problem& problem, const MultisymplecticSystem& system, const grids::Grid& grid,
                          std::span<const double> typical) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  double lost = std::numeric_limits<double>::quiet_NaN();
  const auto look_at = [&](const Sampling& formula) {
    for (int a = 0; a < grid.dimensions(); ++a) {
      if (const double here = formula.lost_along(grid, a); !(here <= lost) && !std::isnan(here)) {
        lost = here;
      }
    }
  };
  for (const auto& text : pde.initial) {
    if (!text) {
      continue;
    }
    auto graph = std::make_shared<formula::Graph>();
    std::vector<formula::Expression> parts;
    parts.push_back(build_initial(*text, *graph, pde, problem.parameters, parts));
    const auto names_field = [&](std::size_t variable) {
      const std::string& name = graph->variable_name(variable);
      return name != "t" && std::ranges::find(grid.axes(), name, &grids::Axis::name) == grid.axes().end();
    };
    if (parts.size() == 1 && std::ranges::none_of(formula::variables_of(parts.front()), names_field)) {
      look_at(Sampling(graph, parts.front(), {}, {}, pde.start));
    }
  }
  if (!system.coordinates().empty()) {
    const std::span<const formula::Expression> fields =
        std::span(system.variables()).first(static_cast<std::size_t>(system.field_count()));
    for (const formula::Expression& slope : formula::gradient(system.expression(), fields)) {
      look_at(Sampling(system.graph(), slope, system.fields(), typical, pde.start));
    }
  }
  return lost;
}

}  // namespace rubato
