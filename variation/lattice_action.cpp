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
