#include <rubato/pde/potential_rest.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/placed_coordinates.hpp>

namespace rubato {

PotentialRest rest_of_potential(const MultisymplecticSystem& system, const Eigen::MatrixXd& L,
                                std::span<const int> fields) {
  PotentialRest rest{std::make_shared<formula::Graph>(), {}, {}, {}};
  std::vector<formula::Expression> to(system.variables().size(), rest.graph->constant(0.0));
  for (const int f : fields) {
    const auto number = static_cast<std::size_t>(f);
    rest.variables.push_back(to[number] = rest.graph->variable(system.fields()[number]));
  }
  rest.inputs = rest.variables;
  for (std::size_t c = system.fields().size(); c < to.size(); ++c) {
    const std::size_t name = system.graph()->node(system.variables()[c].index()).a;
    rest.inputs.push_back(to[c] = rest.graph->variable(system.graph()->variable_name(name)));
  }
  rest.value = formula::substitute(std::array{system.expression()}, *rest.graph, system.variables(), to).front();
  for (std::size_t i = 0; i < fields.size(); ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      if (const double entry = L(fields[i], fields[j]); entry != 0.0) {
        rest.value = rest.value - (i == j ? 0.5 * entry : entry) * (rest.variables[i] * rest.variables[j]);
      }
    }
  }
  return rest;
}

namespace {

/// S'' with one value of each varying entry for all nodes: what `value_of` makes of its values there.
template <typename ValueOf>
Eigen::MatrixXd constant_in_space(const MultisymplecticSystem& system, const grids::Grid& grid,
                                  const grids::FieldSet& fields, const ValueOf& value_of) {
  Eigen::MatrixXd hessian = system.constant_hessian();
  const auto& entries = system.varying_hessian();
  if (entries.empty()) {
    return hessian;
  }
  const int first = 1 + system.field_count();
  grids::FieldSet outputs(first + static_cast<int>(entries.size()), grid.size());
  const PlacedCoordinates places(system, grid, Within::node);
  formula::BatchEvaluator evaluate(system.hessian_code());
  evaluate(grid.size(), places.after(fields.pointers()), outputs.pointers());
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const double entry = value_of(std::as_const(outputs).field(first + static_cast<int>(e)));
    hessian(entries[e].row, entries[e].column) = hessian(entries[e].column, entries[e].row) =
        std::isfinite(entry) ? entry : 0.0;
  }
  return hessian;
}

}  // namespace

Eigen::MatrixXd mean_hessian(const MultisymplecticSystem& system, const grids::Grid& grid,
                             const grids::FieldSet& fields) {
  return constant_in_space(system, grid, fields, [](std::span<const double> values) {
    return grids::sum(values) / static_cast<double>(grids::whole_count(values.size()));
  });
}

Eigen::MatrixXd middle_hessian(const MultisymplecticSystem& system, const grids::Grid& grid,
                               const grids::FieldSet& fields) {
  return constant_in_space(system, grid, fields, [](std::span<const double> values) {
    const auto count = static_cast<double>(grids::whole_count(values.size()));
    const double mean = grids::sum(values) / count;
    const auto mean_of = [&](auto&& of) {
      return grids::sum_of(values.size(), [&](std::size_t i) { return of(values[i] - mean); }) / count;
    };
    const double square = mean_of([](double v) { return v * v; }), cube = mean_of([](double v) { return v * v * v; });
    // Σ (v - mean - δ)³ = 0: δ³ + 3 σ² δ = <(v - mean)³>, whose one real root is 2σ sinh(t), sinh 3t = <…>/(2σ³).
    const double sigma = std::sqrt(square);
    const double scale = square * sigma;
    return std::isnormal(scale) ? mean + 2.0 * sigma * std::sinh(std::asinh(0.5 * cube / scale) / 3.0) : mean;
  });
}

bool is_in_rest(const MultisymplecticSystem& system, int field) {
  return system.varies_in_space(field) ||
         std::ranges::any_of(system.varying_hessian(), [field](const HessianEntry& entry) {
           return entry.row == field || entry.column == field;
         });
}

std::vector<double> potential_slopes_at_zero(const MultisymplecticSystem& system) {
  formula::ScalarEvaluator gradient(system.gradient_code());
  const std::vector<double> zero(system.variables().size(), 0.0);
  std::vector<double> outputs(system.fields().size() + 1);
  gradient(zero, outputs);
  return {outputs.begin() + 1, outputs.end()};
}

}  // namespace rubato
