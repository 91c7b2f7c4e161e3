#include <rubato/run/lattice_quantity.hpp>

#include <algorithm>
#include <iterator>
#include <utility>

#include <fmt/format.h>

#include <rubato/grids/slab.hpp>
#include <rubato/problem/lattice_problem.hpp>
#include <rubato/problem/reader.hpp>

namespace rubato {

namespace {

/// The fields that a formula names, in derivatives as well.
std::vector<int> fields_of(const formula::Graph& graph, formula::Expression formula,
                           const MultisymplecticSystem& system) {
  std::vector<int> fields;
  for (const std::size_t variable : formula::variables_of(formula)) {
    std::string name = graph.variable_name(variable);
    while (name.ends_with(")")) {  // dx(f)
      name = name.substr(3, name.size() - 4);
    }
    if (std::ranges::find(system.fields(), name) != system.fields().end()) {
      fields.push_back(system.field(name));
    }
  }
  return fields;
}

void refuse_midpoints(const std::vector<int>& fields, const OutputQuantity& quantity,
                      const MultisymplecticSystem& system) {
  for (const int f : fields) {
    if (system.structure().at_midpoints(f)) {
      throw ProblemError(quantity.formula.location,
                         fmt::format("{} exists in the middle of steps only, and a quantity needs its value at a level",
                                     system.fields()[static_cast<std::size_t>(f)]));
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
  std::vector<int> named = fields_of(*graph, value, system);
  for (const auto& formula : integrands) {
    std::ranges::copy(fields_of(*graph, formula, system), std::back_inserter(named));
  }
  refuse_midpoints(named, quantity, system);
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
  NodalView nodal(system, grid, make_method(problem)->in_mirror().value_or(Collocation::cells));
  if (nodal.moves(named)) {
    nodal_.emplace(std::move(nodal));
  }
}

std::vector<double> LatticeQuantity::at(const LatticeLevel& of_frame, double t) {
  const LatticeLevel& of_laboratory = laboratory_ ? (*laboratory_)(of_frame, t) : of_frame;
  const LatticeLevel& level = nodal_ ? (*nodal_)(of_laboratory) : of_laboratory;
  const std::vector<double> numbers = integrands_ ? integrands_->integrals(level, t) : std::vector<double>();
  return point_ ? value_->at_point(level, t, *point_, numbers) : std::move((*value_)(level, t, numbers).front());
}

}  // namespace rubato
