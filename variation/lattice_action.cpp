#include <rubato/variation/lattice_action.hpp>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

namespace rubato {

formula::Expression LatticeAction::lagrangian() const {
  formula::Expression sum;
  for (const Part& part : parts) {
    sum = sum.valid() ? sum + part.density : part.density;
    for (const OneForm& form : part.forms) {
      sum += form.along[static_cast<std::size_t>(form.mu)];
    }
  }
  return sum;
}

std::vector<formula::Expression> LatticeAction::currents(const Part& part) const {
  if (!part.currents.empty()) {
    return part.currents;
  }
  std::vector<formula::Expression> variables, all;
  for (const Value& value : values) {
    variables.push_back(value.variable);
  }
  const std::vector<formula::Expression> first = formula::gradient(part.density, variables);
  for (int nu = 0; nu <= dimensions; ++nu) {
    for (int rho = 0; rho <= dimensions; ++rho) {
      all.push_back(current(part, first, nu, rho));
    }
  }
  return all;
}

/// \param first the gradient of the part's V
formula::Expression LatticeAction::current(const Part& part, std::span<const formula::Expression> first, int nu,
                                           int rho) const {
  const auto derivative = [&](int direction) { return part.derivatives[static_cast<std::size_t>(direction)]; };
  formula::Expression sum = nu == rho ? -part.density : graph->constant(0.0);
  for (int f = 0; f < fields; ++f) {
    const std::size_t j = index_of(f, derivative(rho));
    if (j < first.size() && (!first[j].is_constant() || first[j].constant_value() != 0.0)) {
      sum += first[j] * values[index_of(f, derivative(nu))].variable;
    }
  }
  for (const OneForm& form : part.forms) {
    if (nu != rho && form.mu == rho) {
      sum += form.along[static_cast<std::size_t>(nu)];
    } else if (nu == rho && form.mu != rho) {
      sum -= form.along[static_cast<std::size_t>(form.mu)];
    }
  }
  return sum;
}

formula::Expression LatticeAction::energy() const {
  formula::Expression sum;
  for (const Part& part : parts) {
    const formula::Expression own = currents(part).front();
    sum = sum.valid() ? sum + own : own;
  }
  return sum;
}

std::size_t LatticeAction::index_of(int field, int op) const {
  const auto found =
      std::ranges::find_if(values, [&](const Value& value) { return value.field == field && value.op == op; });
  return static_cast<std::size_t>(found - values.begin());
}

void LatticeAction::find_place(const Place& place, const grids::Grid& grid, std::span<double> out) const {
  const auto a = static_cast<std::size_t>(place.axis);
  const grids::Along along = operators[static_cast<std::size_t>(place.op)].space.box[a];
  for (std::size_t cell = 0; cell < out.size(); ++cell) {
    out[cell] = grids::coordinate(grid.axis(place.axis), grid.place(cell)[a], along);
  }
}

LatticeActionBuilder::LatticeActionBuilder(int fields, int dimensions) {
  if (fields < 1 || dimensions < 1 || dimensions > 3) {
    throw std::invalid_argument(
        fmt::format("an action on a lattice needs fields and 1 to 3 dimensions; got {} and {}", fields, dimensions));
  }
  action_.graph = std::make_shared<formula::Graph>();
  action_.fields = fields;
  action_.at_midpoints.assign(static_cast<std::size_t>(fields), false);
  action_.dimensions = dimensions;
}

int LatticeActionBuilder::add(const StencilOperator& op) {
  const auto found = std::ranges::find(action_.operators, op);
  const auto number = static_cast<int>(found - action_.operators.begin());
  if (found == action_.operators.end()) {
    action_.operators.push_back(op);
  }
  return number;
}

int LatticeActionBuilder::add_derivative(const StencilOperator& op) {
  part_.derivatives.push_back(add(op));
  return part_.derivatives.back();
}

formula::Expression LatticeActionBuilder::value(int field, int op) {
  for (const LatticeAction::Value& value : action_.values) {
    if (value.field == field && value.op == op) {
      return value.variable;
    }
  }
  action_.values.push_back({field, op, action_.graph->variable(fmt::format("operator {} of field {}", op, field))});
  return action_.values.back().variable;
}

formula::Expression LatticeActionBuilder::place(int axis, int op) {
  for (const LatticeAction::Place& place : action_.places) {
    if (place.axis == axis && place.op == op) {
      return place.variable;
    }
  }
  action_.places.push_back({axis, op, action_.graph->variable(fmt::format("operator {} of coordinate {}", op, axis))});
  return action_.places.back().variable;
}

void LatticeActionBuilder::add_part(formula::Expression density) {
  if (part_.derivatives.size() != static_cast<std::size_t>(action_.dimensions) + 1) {
    throw std::invalid_argument(fmt::format("an action in {} dimensions needs {} derivatives; got {}",
                                            action_.dimensions, action_.dimensions + 1, part_.derivatives.size()));
  }
  // Where places are varied all derivatives of a field are read if the density has one of them.
  for (int field = 0; field < action_.fields; ++field) {
    const auto has = [&](int op) {
      return std::ranges::any_of(
          action_.values, [&](const LatticeAction::Value& value) { return value.field == field && value.op == op; });
    };
    if (std::ranges::any_of(part_.derivatives, has)) {
      for (int rho = 0; rho <= action_.dimensions; ++rho) {
        static_cast<void>(derivative(field, rho));
      }
    }
  }
  part_.density = density;
  action_.parts.push_back(std::exchange(part_, {}));
}

}  // namespace rubato
