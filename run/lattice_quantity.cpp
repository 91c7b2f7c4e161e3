#include <rubato/run/lattice_quantity.hpp>

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include <rubato/grids/slab.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

void refuse_midpoints(const formula::Graph& graph, formula::Expression formula, const OutputQuantity& quantity,
                      const MultisymplecticSystem& system) {
  for (const std::size_t variable : formula::variables_of(formula)) {
    std::string name = graph.variable_name(variable);
    while (name.ends_with(")")) {  // dx(f)
      name = name.substr(3, name.size() - 4);
    }
    const auto found = std::ranges::find(system.fields(), name);
    if (found != system.fields().end() && system.structure().at_midpoints(system.field(name))) {
      throw ProblemError(
          quantity.formula.location,
          fmt::format("{} exists in the middle of steps only, and a quantity needs its value at a level", name));
    }
  }
}

}  // namespace

grids::Grid present_grid(const Problem& problem) {
  const grids::Slab* const slab = grids::Slab::present();
  return slab == nullptr ? make_grid(problem) : slab->grid();
}

LatticeQuantity::LatticeQuantity(const Problem& problem, const OutputQuantity& quantity,
                                 const MultisymplecticSystem& system, const grids::Grid& grid)
    : name_(quantity.name) {
  const MultisymplecticProblem& pde = *problem.multisymplectic();
  auto graph = std::make_shared<formula::Graph>();
  std::vector<formula::Expression> integrands;
  formula::Expression value =
      problem.build_quantity(quantity.formula, *graph, quantity_names(pde), pde.fields, integrands);
  for (const auto& formula : integrands) {
    refuse_midpoints(*graph, formula, quantity, system);
  }
  refuse_midpoints(*graph, value, quantity, system);
  const Jumps jumps = make_jumps(problem);
  value = jumps.seen({value}, *graph, pde.fields).front();
  integrands = jumps.seen(integrands, *graph, pde.fields);
  std::vector<std::string> numbers;
  for (std::size_t i = 0; i < integrands.size(); ++i) {
    numbers.push_back(fmt::format("integral {}", i + 1));
  }
  for (const std::size_t variable : formula::variables_of(value)) {
    const std::string& name = graph->variable_name(variable);
    is_field_ = is_field_ || (name != "t" && !name.starts_with("integral "));
  }
  if (quantity.at || !is_field_) {
    std::vector<double> point;
    for (int a = 0; a < grid.dimensions(); ++a) {
      point.push_back(quantity.at ? (*quantity.at)[static_cast<std::size_t>(a)] : grid.axis(a).from);
    }
    point_.emplace(grid, std::move(point));
    is_field_ = false;
  }
  if (!integrands.empty()) {
    integrands_.emplace(graph, std::move(integrands), pde.fields, grid);
  }
  value_.emplace(graph, std::vector{value}, pde.fields, grid, std::move(numbers));
  if (auto frame = make_frame(problem)) {
    laboratory_.emplace(std::move(*frame), grid);
  }
}

std::vector<double> LatticeQuantity::at(const LatticeLevel& of_frame, double t) {
  const LatticeLevel& level = laboratory_ ? (*laboratory_)(of_frame, t) : of_frame;
  const std::vector<double> numbers = integrands_ ? integrands_->integrals(level, t) : std::vector<double>();
  return point_ ? value_->at_point(level, t, *point_, numbers) : std::move((*value_)(level, t, numbers).front());
}

}  // namespace rubato
