#include <rubato/variation/lattice_action.hpp>

#include <stdexcept>
#include <utility>

#include <fmt/format.h>

namespace rubato {

formula::Expression LatticeAction::lagrangian() const {
  formula::Expression sum = density;
  for (const OneForm& form : forms) {
    sum += form.along[static_cast<std::size_t>(form.mu)];
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
  action_.operators.push_back(op);
  return static_cast<int>(action_.operators.size()) - 1;
}

int LatticeActionBuilder::add_derivative(const StencilOperator& op) {
  action_.derivatives.push_back(add(op));
  return action_.derivatives.back();
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

LatticeAction LatticeActionBuilder::finish(formula::Expression density) {
  if (action_.derivatives.size() != static_cast<std::size_t>(action_.dimensions) + 1) {
    throw std::invalid_argument(fmt::format("an action in {} dimensions needs {} derivatives; got {}",
                                            action_.dimensions, action_.dimensions + 1, action_.derivatives.size()));
  }
  // Where places are varied every field's derivatives are read, whether the density has them or not.
  for (int field = 0; field < action_.fields; ++field) {
    for (int rho = 0; rho <= action_.dimensions; ++rho) {
      static_cast<void>(derivative(field, rho));
    }
  }
  action_.density = density;
  return std::move(action_);
}

}  // namespace rubato
