#include <rubato/pde/potential_rest.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <utility>

#include <rubato/formula/batch.hpp>
#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/reachable.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/placed_coordinates.hpp>

namespace rubato {

using formula::Expression;

PotentialRest rest_of_potential(const MultisymplecticSystem& system, const Eigen::MatrixXd& L,
                                std::span<const int> fields) {
  PotentialRest rest{std::make_shared<formula::Graph>(), {}, {}, {}};
  std::vector<Expression> to(system.variables().size(), rest.graph->constant(0.0));
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
/// \param code as MultisymplecticSystem::hessian_code()
template <typename ValueOf>
Eigen::MatrixXd constant_in_space(const MultisymplecticSystem& system, const grids::Grid& grid,
                                  const formula::Bytecode& code, const grids::FieldSet& fields,
                                  const ValueOf& value_of) {
  Eigen::MatrixXd hessian = system.constant_hessian();
  const auto& entries = system.varying_hessian();
  if (entries.empty()) {
    return hessian;
  }
  const int first = 1 + system.field_count();
  grids::FieldSet outputs(first + static_cast<int>(entries.size()), grid.size());
  const PlacedCoordinates places(system, grid, Within::node);
  formula::BatchEvaluator evaluate(code);
  evaluate(grid.size(), places.after(fields.pointers()), outputs.pointers());
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const double entry = value_of(std::as_const(outputs).field(first + static_cast<int>(e)));
    hessian(entries[e].row, entries[e].column) = hessian(entries[e].column, entries[e].row) =
        std::isfinite(entry) ? entry : 0.0;
  }
  return hessian;
}

double mean_over_nodes(std::span<const double> values) {
  return grids::sum(values) / static_cast<double>(grids::whole_count(values.size()));
}

/// S without sines and cosines of linear combinations of the fields.
Expression without_periodic_parts(const MultisymplecticSystem& system) {
  const std::span<const Expression> z(system.variables().data(), system.fields().size());
  const auto names_field = [&](Expression e) {
    return std::ranges::any_of(formula::variables_of(e), [&](std::size_t number) {
      return std::ranges::find(system.fields(), system.graph()->variable_name(number)) != system.fields().end();
    });
  };
  std::vector<Expression> periodic;
  for (const formula::NodeIndex index : formula::reachable(std::array{system.expression()})) {
    const formula::Node& node = system.graph()->node(index);
    if (node.operation != formula::Operation::sin && node.operation != formula::Operation::cos) {
      continue;
    }
    const Expression angle(system.graph().get(), node.a);
    if (names_field(angle) && std::ranges::none_of(formula::gradient(angle, z), names_field)) {
      periodic.emplace_back(system.graph().get(), index);
    }
  }
  const std::vector<Expression> zeros(periodic.size(), system.graph()->constant(0.0));
  return formula::substitute(system.expression(), periodic, zeros);
}

}  // namespace

Eigen::MatrixXd hessian_of_waves(const MultisymplecticSystem& system, const grids::Grid& grid) {
  const std::span<const Expression> z(system.variables().data(), system.fields().size());
  const Expression S = without_periodic_parts(system);
  std::vector<Expression> outputs = {S};
  std::ranges::copy(formula::gradient(S, z), std::back_inserter(outputs));
  for (const HessianEntry& entry : system.varying_hessian()) {
    const std::array row{z[static_cast<std::size_t>(entry.row)]}, column{z[static_cast<std::size_t>(entry.column)]};
    outputs.push_back(formula::gradient(formula::gradient(S, row).front(), column).front());
  }
  return constant_in_space(system, grid, formula::Bytecode(outputs, system.variables()),
                           grids::FieldSet(system.field_count(), grid.size()), mean_over_nodes);
}

Eigen::MatrixXd middle_hessian(const MultisymplecticSystem& system, const grids::Grid& grid,
                               const grids::FieldSet& fields) {
  return constant_in_space(system, grid, system.hessian_code(), fields, [](std::span<const double> values) {
    const auto count = static_cast<double>(grids::whole_count(values.size()));
    const double mean = mean_over_nodes(values);
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
