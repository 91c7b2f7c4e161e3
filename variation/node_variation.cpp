#include <rubato/variation/node_variation.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include <rubato/variation/terms_by_middle.hpp>
#include <rubato/variation/weighted_terms.hpp>

namespace rubato {

namespace {

using formula::Expression;

/// The uniform number of the code beside h.
constexpr int number_of_rate = 1;

}  // namespace

NodeVariation::NodeVariation(LatticeAction action, const grids::Grid& grid)
    : action_(std::move(action)), formulas_(grid), places_(static_cast<int>(action_.places.size()), grid.size()) {
  if (action_.dimensions != grid.dimensions()) {
    throw std::invalid_argument(fmt::format("an action in {} dimensions cannot be varied on a grid with {}",
                                            action_.dimensions, grid.dimensions()));
  }
  for (const StencilOperator& op : action_.operators) {
    static_cast<void>(formulas_.weights(op.space));  // which says what is wrong with it
  }
  h_ = formulas_.uniform(number_of_h);
  rate_ = formulas_.uniform(number_of_rate);
  std::vector<Expression> arguments;
  for (const LatticeAction::Value& value : action_.values) {
    arguments.push_back(value.variable);
  }
  derivatives_ = formula::gradient(action_.lagrangian(), arguments);
  for (std::size_t j = 0; j < action_.places.size(); ++j) {
    action_.find_place(action_.places[j], grid, places_.field(static_cast<int>(j)));
  }
}

int NodeVariation::array_of(Level level, int field) const {
  return field + (level == Level::after ? action_.fields : 0);
}

Expression NodeVariation::place(std::size_t number, Offset cell) {
  return formulas_.node(2 * action_.fields + static_cast<int>(number), cell);
}

Expression NodeVariation::difference(Level level, int field, int axis, bool forward) {
  using grids::SpaceOperator;
  return in_space(level, field,
                  forward ? SpaceOperator::forward_difference(axis) : SpaceOperator::backward_difference(axis), {},
                  true);
}

Expression NodeVariation::difference_of_other(int array, int axis) {
  return formulas_.in_cell(grids::SpaceOperator::forward_difference(axis), first_other() + array);
}

LevelValues NodeVariation::keep_of_lower(int others, std::vector<Expression>& formulas) {
  return {formulas_, {action_.fields, places_.fields(), first_other() + others}, formulas};
}

LevelValues NodeVariation::keep(int others, std::span<const Expression> always,
                                std::initializer_list<std::vector<Expression>*> formulas) {
  return {formulas_, {action_.fields, places_.fields(), first_other() + others}, always, formulas};
}

/// The operator of a field in a cell.
Expression NodeVariation::in_space(Level level, int field, const grids::SpaceOperator& op, Offset cell,
                                   bool with_slope) {
  const Expression periodic = formulas_.in_cell(op, array_of(level, field), cell);
  if (with_slope && op.box[0] == grids::Along::difference) {
    return periodic + formulas_.slope(field, cell);
  }
  const bool counts_from_here = !action_.potential.empty() && action_.potential[static_cast<std::size_t>(field)];
  if (with_slope && counts_from_here && op.box[0] == grids::Along::next) {
    Offset there = cell;
    for (std::size_t a = 1; a < there.size(); ++a) {
      there[a] += op.box[a] == grids::Along::next ? 1 : 0;
    }
    return periodic + formulas_.grid().spacing(0) * formulas_.slope(field, there);
  }
  return periodic;
}

/// L_o z in a cell.
Expression NodeVariation::value(const LatticeAction::Value& value, Offset cell, Motion motion) {
  const StencilOperator& op = action_.operators[static_cast<std::size_t>(value.op)];
  const bool in_slab = action_.at_midpoints[static_cast<std::size_t>(value.field)];
  const bool is_difference = op.time == InTime::difference;
  if (is_difference && (in_slab || motion == Motion::none)) {
    return formulas_.graph().constant(0.0);
  }
  if (is_difference && motion == Motion::at_rates) {
    return formulas_.in_cell(op.space, first_other() + first_rate_ + value.field, cell);
  }
  const auto at = [&](Level level) { return in_space(level, value.field, op.space, cell, !is_difference); };
  if (motion != Motion::between_levels || in_slab || op.time == InTime::after) {
    return at(Level::after);
  }
  if (op.time == InTime::before) {
    return at(Level::before);
  }
  return is_difference ? rate_ * (at(Level::after) - at(Level::before)) : 0.5 * (at(Level::before) + at(Level::after));
}

/// Formulas of the action's variables in a cell, in the values of nodes.
std::vector<Expression> NodeVariation::in_nodes(std::span<const Expression> formulas, Offset cell, Motion motion) {
  std::vector<Expression> from, to;
  for (const LatticeAction::Value& v : action_.values) {
    from.push_back(v.variable);
    to.push_back(value(v, cell, motion));
  }
  for (std::size_t j = 0; j < action_.places.size(); ++j) {
    from.push_back(action_.places[j].variable);
    to.push_back(place(j, cell));
  }
  for (std::size_t j = 0; j < action_.spacings.size(); ++j) {
    from.push_back(action_.spacings[j]);
    to.push_back(j == 0 ? h_ : formulas_.graph().constant(formulas_.grid().spacing(static_cast<int>(j) - 1)));
  }
  return formula::substitute(formulas, formulas_.graph(), from, to);
}

/// ∂L/∂(L_o z) in a cell.
std::span<const Expression> NodeVariation::derivatives_in(Offset cell, Motion motion) {
  const auto [found, is_new] = in_cells_.try_emplace({cell, motion});
  if (is_new) {
    found->second = in_nodes(derivatives_, cell, motion);
  }
  return found->second;
}

/// Σ_o (L_o)ᵀ ∂L/∂(L_o z_f), with the operators' weights in time at the level: of differences times h.
NodeVariation::AtRest NodeVariation::parts(Level level, int field, Motion motion) {
  Expression momentum, force;
  for (std::size_t j = 0; j < action_.values.size(); ++j) {
    const LatticeAction::Value& v = action_.values[j];
    if (v.field != field || is_zero(derivatives_[j])) {
      continue;
    }
    const StencilOperator& op = action_.operators[static_cast<std::size_t>(v.op)];
    const bool in_slab = action_.at_midpoints[static_cast<std::size_t>(field)];
    const bool upper = level == Level::after;
    if (op.time == InTime::difference
            ? in_slab
            : (upper ? op.time == InTime::before && !in_slab : op.time == InTime::after || in_slab)) {
      continue;
    }
    for (const auto& [offset, weight] : formulas_.weights(op.space)) {
      const Expression derivative = derivatives_in(shifted({}, offset, -1), motion)[j];
      if (op.time == InTime::difference) {
        add_weighted(momentum, upper ? weight : -weight, derivative);
      } else {
        add_weighted(force, (op.time == InTime::mean && !in_slab ? 0.5 : 1.0) * weight, derivative);
      }
    }
  }
  const auto collected = [&](const Expression& sum) {
    const Expression once = sum.valid() ? WeightedTerms(sum).sum() : sum;
    return once.valid() ? once : formulas_.graph().constant(0.0);
  };
  return {collected(momentum), collected(force)};
}

Expression NodeVariation::values(Level level, int field) {
  const auto [momentum, force] = parts(level, field, Motion::between_levels);
  return is_zero(force) ? momentum : momentum + h_ * force;
}

Expression NodeVariation::values_between_walls(Level level, int field) {
  const Expression density = between_walls(in_cell(action_.lagrangian()));
  Expression sum;
  for (const NodeInput& input : inputs_of(density)) {
    if (input.kind == NodeInput::Kind::node && input.number == array_of(level, field)) {
      add_weighted(sum, 1.0, at_node(formula::derivative(density, input.variable), shifted({}, input.offset, -1)));
    }
  }
  return sum.valid() ? h_ * sum : formulas_.graph().constant(0.0);
}

NodeVariation::AtRest NodeVariation::at_rest(int field) {
  return parts(Level::before, field, Motion::none);
}

Expression NodeVariation::energy() {
  return in_nodes(std::array{action_.energy()}, {}, Motion::between_levels).front();
}

Expression NodeVariation::energy_of_level(std::span<const Expression> momenta, int first_spare) {
  if (!action_.spacings.empty()) {
    return {};
  }
  first_rate_ = first_spare;
  std::vector<Expression> rates(momenta.size());
  Expression energy = in_nodes(std::array{action_.energy()}, {}, Motion::at_rates).front();
  const int first = first_other() + first_spare;
  std::vector<Expression> from, to;
  for (const NodeInput& input : inputs_of(energy)) {
    const int field = input.number - first;
    if (input.kind != NodeInput::Kind::node || field < 0) {
      continue;
    }
    Expression& rate = rates[static_cast<std::size_t>(field)];
    if (!rate.valid()) {
      const Expression unknown = formulas_.node(input.number), given = momenta[static_cast<std::size_t>(field)];
      const Expression momentum = parts(Level::after, field, Motion::at_rates).momentum;
      const Expression slope = formula::derivative(momentum, unknown);
      if (!given.valid() || !slope.is_constant() || is_zero(slope)) {
        return {};
      }
      const std::array zero{formulas_.graph().constant(0.0)};
      const Expression at_rest = formula::substitute(momentum, std::array{unknown}, zero);
      if (!at_rest.is_constant()) {
        return {};
      }
      rate = (given - at_rest) / slope;
    }
    from.push_back(input.variable);
    to.push_back(at_node(rate, input.offset));
  }
  return formula::substitute(energy, from, to);
}

Expression NodeVariation::at_node(Expression formula, const Offset& further) {
  std::vector<Expression> from, to;
  for (const NodeInput& input : inputs_of(formula)) {
    if (input.kind != NodeInput::Kind::uniform) {
      from.push_back(input.variable);
      to.push_back(formulas_.at(input, shifted(input.offset, further)));
    }
  }
  return from.empty() ? formula : formula::substitute(formula, from, to);
}

NodeVariation::Summed NodeVariation::in_sum(Expression formula) {
  const int d = action_.fields;
  const bool has_ghosts = formulas_.grid().has_ghosts();
  const WeightedTerms all(formula);
  TermsByMiddle of_slab, of_lower, of_upper;
  for (const auto& [term, weight] : all.terms()) {
    bool reads_lower = false, reads_upper = false, reads_slab = false;
    std::optional<Offset> first;
    for (const NodeInput& input : inputs_of(term)) {
      if (input.kind == NodeInput::Kind::node) {
        first = first ? std::min(*first, input.offset) : input.offset;
        const bool in_slab = input.number < 2 * d && action_.at_midpoints[static_cast<std::size_t>(input.number % d)];
        reads_slab = reads_slab || in_slab || input.number >= first_other();
        reads_lower = reads_lower || input.number < d;
        reads_upper = reads_upper || (input.number >= d && input.number < 2 * d);
      }
      reads_slab = reads_slab || input.kind == NodeInput::Kind::uniform;
    }
    // Between walls its middle becomes the node, or the middle between this one and the next.
    Offset middle{};
    if (has_ghosts && first) {
      const Offset twice = formulas_.middle_of(term, [](const NodeInput&) { return Offset{}; });
      for (std::size_t a = 0; a < middle.size(); ++a) {
        middle[a] = twice[a] & 1;
        (*first)[a] = (twice[a] - middle[a]) / 2;
      }
    }
    const Expression moved = first ? at_node(term, shifted({}, *first, -1)) : term;
    if (reads_slab || (reads_lower && reads_upper)) {
      of_slab.add(moved, weight, middle);
    } else if (reads_lower) {
      std::vector<Expression> from, to;
      for (const NodeInput& input : inputs_of(moved)) {
        if (input.kind == NodeInput::Kind::node && input.number < d) {
          from.push_back(input.variable);
          to.push_back(node(Level::after, input.number, input.offset));
        }
      }
      of_lower.add(formula::substitute(moved, from, to), weight, middle);
    } else {
      of_upper.add(moved, weight, middle);
    }
  }
  return {of_slab.sum(formulas_), of_lower.sum(formulas_), of_upper.sum(formulas_)};
}

std::vector<Expression> NodeVariation::currents(const LatticeAction::Part& part, Offset cell) {
  return in_nodes(action_.currents(part), cell, Motion::between_levels);
}

Expression NodeVariation::by_place(const LatticeAction::Place& place, Offset cell) {
  return in_nodes(formula::gradient(action_.lagrangian(), std::array{place.variable}), cell, Motion::between_levels)
      .front();
}

void NodeVariation::read(NodeCode& code, const grids::FieldSet& before, const grids::FieldSet& after, double h,
                         const PotentialSlopes& slopes, std::initializer_list<const grids::FieldSet*> others) const {
  std::array<const grids::FieldSet*, 10> all{&before, &after, &places_};
  const auto end = std::ranges::copy(others, all.begin() + 3).out;
  code.read(std::span(all.begin(), end), std::array{h, 1.0 / h}, slopes);
}

}  // namespace rubato
