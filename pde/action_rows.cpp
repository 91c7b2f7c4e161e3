#include <rubato/pde/action_rows.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>
#include <stdexcept>
#include <tuple>

#include <fmt/format.h>

#include <rubato/formula/bytecode.hpp>
#include <rubato/pde/matrix_terms.hpp>
#include <rubato/variation/random_values.hpp>

namespace rubato {

namespace {

using formula::Expression;
using Level = NodeVariation::Level;

/// What rounding leaves of some tens of terms, relative to the largest, with a margin of a thousand.
constexpr double rounding_of_terms = 1e-11;
constexpr int trials = 4;
/// Of steps at which formulas are compared: in other units of time terms with h and without it are of other sizes, and
/// the larger ones hide what the others show.
constexpr std::array step_scales = {1.0, 1e-6, 1e6, 1e-12, 1e12, 1e-18, 1e18, 1e-24, 1e24};

}  // namespace

ActionRows::ActionRows(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated,
                       bool two_step)
    : system_(system), grid_(grid), variation_(stated.action, grid), symmetric_(stated.is_symmetric) {
  for (int f = 0; f < system_.field_count(); ++f) {
    if (!stated.names(f)) {
      continue;
    }
    Row row{.field = f,
            .row = {},
            .lower = is_in_slab(f) ? variation_.graph().constant(0.0) : variation_.values(Level::before, f),
            .upper = variation_.values(Level::after, f),
            .momentum = {},
            .in_slab = is_in_slab(f)};
    rows_.push_back(row);
  }
  find_probes(stated);
  for (Row& row : rows_) {
    if (row.in_slab) {
      row.momentum = variation_.graph().constant(0.0);
      row.row = row.upper;
    } else {
      find_momentum(stated, two_step, row);
    }
  }
  for (Row& row : rows_) {
    if (!row.row.valid()) {
      row.row = row.lower + (row.kept >= 0 ? kept_momentum(row.kept) : row.momentum);
    }
  }
  factor(stated.cell_equations);
  find_derived(stated);
}

void ActionRows::find_probes(const StatedAction& stated) {
  const auto d = system_.fields().size();
  constexpr double middle = 0.7, wide = 0.5, narrow = 0.02;
  std::vector<Probe> tried = {{std::vector<double>(d, middle), wide}, {std::vector<double>(d, middle), narrow}};
  if (!stated.typical.empty()) {
    tried.push_back({stated.typical, narrow});
  }
  std::vector<Expression> formulas;
  for (const Row& row : rows_) {
    formulas.insert(formulas.end(), {row.lower, row.upper});
  }
  std::size_t undefined = 0;
  for (const Probe& one : tried) {
    std::mt19937_64 random(45);
    bool is_defined = true;
    for (int trial = 0; trial < trials && is_defined; ++trial) {
      const std::vector<double> found = values(formulas, [&](const NodeInput& input) {
        const bool is_field = input.kind == NodeInput::Kind::node && input.number < 2 * static_cast<int>(d);
        return one.draw(random, is_field ? input.number % static_cast<int>(d) : -1);
      });
      const auto first = std::ranges::find_if(found, [](double value) { return !std::isfinite(value); });
      is_defined = first == found.end();
      undefined = is_defined ? undefined : static_cast<std::size_t>(first - found.begin()) / 2;
    }
    if (is_defined) {
      probes_.push_back(one);
    }
  }
  if (!probes_.empty()) {
    return;
  }
  std::string near;
  for (std::size_t f = 0; f < stated.typical.size(); ++f) {
    near += stated.names(static_cast<int>(f)) ? fmt::format("{}{} = {:.3g}", near.empty() ? ", nor near " : ", ",
                                                            system_.fields()[f], stated.typical[f])
                                              : "";
  }
  throw std::invalid_argument(fmt::format(
      "the variation of L by {} is not defined at fields between 0.2 and 1.2{}: state an L that has derivatives there",
      system_.fields()[static_cast<std::size_t>(rows_[undefined].field)], near));
}

void ActionRows::factor(std::span<const Expression> equations) {
  for (int a = 0; a < grid_.dimensions(); ++a) {
    if (grid_.cells(a) % 2 == 0) {
      return;
    }
  }
  if (!std::ranges::all_of(rows_, [](const Row& row) { return row.in_slab || row.is_one_step; })) {
    return;
  }
  if (equations.empty()) {
    return;
  }
  std::vector<Expression> cells;
  const int corners = 1 << grid_.dimensions();
  for (const Row& row : rows_) {
    const Expression equation = equations[static_cast<std::size_t>(row.field)];
    Expression mean;
    for (int c = 0; c < corners; ++c) {
      std::array<int, 3> cell{};
      for (std::size_t a = 0; a < cell.size(); ++a) {
        cell[a] = (c >> a & 1) != 0 ? -1 : 0;
      }
      const Expression one = variation_.in_cell(equation, cell);
      mean = mean.valid() ? mean + one : one;
    }
    const double factor = (row.in_slab ? 1.0 : 0.5) / corners;
    const std::array formulas{row.row - factor * (variation_.step() * mean), row.lower, row.upper};
    std::mt19937_64 random(45);
    const int d = system_.field_count();
    for (const double scale : step_scales) {
      const std::vector<double> found = values(formulas, [&](const NodeInput& input) {
        const double value = probes_.front().draw(
            random, input.kind == NodeInput::Kind::node && input.number < 2 * d ? input.number % d : -1);
        return input.kind != NodeInput::Kind::uniform       ? value
               : input.number == NodeVariation::number_of_h ? scale * value
                                                            : value / scale;
      });
      if (!(std::abs(found[0]) <= rounding_of_terms * (std::abs(found[1]) + std::abs(found[2])))) {
        return;
      }
    }
    cells.push_back(variation_.step() * variation_.in_cell(equation));
  }
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    rows_[i].row = cells[i];
  }
}

void ActionRows::find_momentum(const StatedAction& stated, bool two_step, Row& row) {
  const bool constrains = system_.M().row(row.field).isZero(0.0);
  if ((!two_step || constrains) && has_level_momentum(row)) {
    const Expression sum = 0.5 * (row.upper - row.lower);
    std::vector<Expression> from = {variation_.step()}, to = {variation_.graph().constant(1.0)};
    for (const NodeInput& input : upper_inputs(sum)) {
      if (is_in_slab(input.number - system_.field_count())) {
        from.push_back(input.variable);
        to.push_back(variation_.graph().constant(0.0));
      }
    }
    row.momentum = lowered(formula::substitute(sum, from, to));
    has_one_step_form_ = row.is_one_step = true;
    return;
  }
  if (!reads_upper(row.lower)) {
    row.momentum = -row.lower;
    row.row = row.upper + raised(row.lower);
    has_late_rows_ = true;
    return;
  }
  const auto numbers = formula::variables_of(row.upper);
  const std::size_t step = formula::variables_of(variation_.step()).front();
  if (!reads_lower(row.upper) && std::ranges::find(numbers, step) == numbers.end()) {
    row.momentum = lowered(row.upper);
    return;
  }
  if (const auto v = momentum_field(stated, row.field)) {
    row.momentum = system_.M()(*v, row.field) * variation_.node(Level::before, *v);
    row.momentum_field = *v;
    has_momentum_fields_ = true;
    return;
  }
  row.kept = kept_++;
}

/// Whether ∂𝕊/∂z_1 - ∂𝕊/∂z_0 is a sum G(z_0) + G(z_1) without h, at random values.
bool ActionRows::has_level_momentum(const Row& row) const {
  const Expression sum = row.upper - row.lower;
  const std::array formulas{sum, row.upper, row.lower};
  std::mt19937_64 random(45);
  const int d = system_.field_count();
  for (const double scale : step_scales) {
    std::map<std::tuple<int, int, std::array<int, 3>>, double> known;
    const auto of_level = [&](int level, const NodeInput& input) {
      const bool is_field = input.kind == NodeInput::Kind::node && input.number < d;
      return known
          .try_emplace({level, input.number, input.offset}, probes_.front().draw(random, is_field ? input.number : -1))
          .first->second;
    };
    const auto between = [&](int lower, int upper) {
      const double h = scale * probes_.front().draw(random);
      constexpr int steady = -1;
      return values(formulas, [&](const NodeInput& input) {
        if (input.kind == NodeInput::Kind::uniform) {
          return input.number == NodeVariation::number_of_h ? h : 1.0 / h;
        }
        if (input.kind == NodeInput::Kind::slope || input.number >= 2 * d) {
          return of_level(steady - static_cast<int>(input.kind), input);
        }
        const int field = input.number % d;
        if (is_in_slab(field)) {
          return probes_.front().draw(random, field);
        }
        NodeInput place = input;
        place.number = field;
        return of_level(input.number < d ? lower : upper, place);
      });
    };
    const std::vector<double> both = between(0, 1), first = between(0, 0), second = between(1, 1);
    double largest = 0.0;
    for (const std::vector<double>& found : {both, first, second}) {
      largest = std::max({largest, std::abs(found[1]), std::abs(found[2])});
    }
    if (!(std::abs(both[0] - 0.5 * (first[0] + second[0])) <= rounding_of_terms * largest)) {
      return false;
    }
  }
  return true;
}

/// v with m f_t = ∂S/∂v as its row, and the only one that M couples with f.
std::optional<int> ActionRows::momentum_field(const StatedAction& stated, int field) const {
  const MatrixTerms partners = terms_of(system_.M().row(field));
  if (partners.size() != 1 || stated.names(partners.front().column)) {
    return std::nullopt;
  }
  const int v = partners.front().column;
  return terms_of(system_.M().row(v)).size() == 1 && !is_in_slab(v) ? std::optional(v) : std::nullopt;
}

void ActionRows::find_derived(const StatedAction& stated) {
  const int d = system_.field_count();
  std::vector<bool> known(static_cast<std::size_t>(d), false);
  for (const Row& row : rows_) {
    known[static_cast<std::size_t>(row.field)] = true;
    if (const auto v = momentum_field(stated, row.field); v && !row.in_slab) {
      derived_.push_back({.field = *v, .value = row.upper / system_.M()(*v, row.field), .turn = 0});
      known[static_cast<std::size_t>(*v)] = true;
    }
  }
  for (bool again = true; again;) {
    again = false;
    for (int row = 0; row < d; ++row) {
      if (const auto field = difference_field(known, row)) {
        derived_.push_back(*field);
        known[static_cast<std::size_t>(field->field)] = true;
        again = true;
      }
    }
  }
  for (int f = 0; f < d; ++f) {
    if (!known[static_cast<std::size_t>(f)] && !system_.structure().at_midpoints(f)) {
      throw std::invalid_argument(
          fmt::format("L does not name {0}, and the row of {0} in the equation does not give it from the fields that L "
                      "names: write {0} into L",
                      system_.fields()[static_cast<std::size_t>(f)]));
    }
  }
}

/// A field that a row of M z_t = 0 gives by one-sided differences of known ones: ∂S/∂z_row = a field + b.
std::optional<ActionRows::Derived> ActionRows::difference_field(const std::vector<bool>& known, int row) {
  const Eigen::MatrixXd& hessian = system_.constant_hessian();
  const auto varies = [&](const HessianEntry& entry) { return entry.row == row || entry.column == row; };
  if (!system_.M().row(row).isZero(0.0) || system_.varies_in_space(row) ||
      (hessian.row(row).array() != 0.0).count() != 1 || std::ranges::any_of(system_.varying_hessian(), varies)) {
    return std::nullopt;
  }
  Derived found;
  for (int f = 0; f < system_.field_count(); ++f) {
    found.field = hessian(row, f) != 0.0 ? f : found.field;
  }
  if (known[static_cast<std::size_t>(found.field)] || is_in_slab(found.field)) {
    return std::nullopt;
  }
  const std::vector<double> ones(system_.variables().size(), 1.0);
  std::vector<double> gradient(system_.fields().size() + 1);
  formula::ScalarEvaluator(system_.gradient_code())(ones, gradient);
  const double a = hessian(row, found.field), b = gradient[1 + static_cast<std::size_t>(row)] - a;
  Expression sum = variation_.graph().constant(-b / a);
  for (int axis = 0; axis < system_.directions(); ++axis) {
    for (const MatrixTerm& term : terms_of(system_.K(axis).row(row))) {
      if (!known[static_cast<std::size_t>(term.column)]) {
        return std::nullopt;
      }
      for (const Derived& derived : derived_) {
        found.turn = derived.field == term.column ? std::max(found.turn, derived.turn + 1) : found.turn;
      }
      const bool forward = system_.structure().K_plus[static_cast<std::size_t>(axis)](row, term.column) != 0.0;
      sum += (term.value / a) * variation_.difference(Level::after, term.column, axis, forward);
    }
  }
  found.value = sum;
  return found;
}

Expression ActionRows::at_rest(const Row& row) {
  const auto [momentum, force] = variation_.at_rest(row.field);
  return lowered(is_zero(momentum) ? variation_.step() * force : momentum + variation_.step() * force) + row.momentum;
}

std::vector<NodeInput> ActionRows::upper_inputs(Expression formula) const {
  std::vector<NodeInput> found = variation_.inputs_of(formula);
  const int d = system_.field_count();
  std::erase_if(found, [d](const NodeInput& input) {
    return input.kind != NodeInput::Kind::node || input.number < d || input.number >= 2 * d;
  });
  return found;
}

bool ActionRows::reads_lower(Expression formula) const {
  const int d = system_.field_count();
  return std::ranges::any_of(variation_.inputs_of(formula), [d](const NodeInput& input) {
    return input.kind == NodeInput::Kind::node && input.number < d;
  });
}

Expression ActionRows::raised(Expression formula) {
  const int d = system_.field_count();
  std::vector<Expression> from, to;
  for (const NodeInput& input : variation_.inputs_of(formula)) {
    if (input.kind == NodeInput::Kind::node && input.number < d) {
      from.push_back(input.variable);
      to.push_back(variation_.node(Level::after, input.number, input.offset));
    }
  }
  return formula::substitute(formula, from, to);
}

Expression ActionRows::lowered(Expression formula) {
  const int d = system_.field_count();
  std::vector<Expression> from, to;
  for (const NodeInput& input : upper_inputs(formula)) {
    from.push_back(input.variable);
    to.push_back(variation_.node(Level::before, input.number - d, input.offset));
  }
  return formula::substitute(formula, from, to);
}

Expression ActionRows::along(Expression formula, bool lower, bool upper) {
  const int d = system_.field_count();
  std::vector<Expression> variables, directions;
  for (const NodeInput& input : variation_.inputs_of(formula)) {
    if (input.kind != NodeInput::Kind::node || input.number >= 2 * d) {
      continue;
    }
    const bool is_upper = input.number >= d;
    if (is_upper ? upper : lower) {
      variables.push_back(input.variable);
      const int array = is_upper ? upper_direction(input.number - d) : lower_direction(input.number);
      directions.push_back(variation_.other(array, input.offset));
    }
  }
  Expression sum;
  const std::vector<Expression> first = formula::gradient(formula, variables);
  for (std::size_t j = 0; j < first.size(); ++j) {
    if (!is_zero(first[j])) {
      const Expression term = first[j] * directions[j];
      sum = sum.valid() ? sum + term : term;
    }
  }
  return sum.valid() ? sum : variation_.graph().constant(0.0);
}

std::vector<double> ActionRows::values(std::span<const Expression> formulas,
                                       const std::function<double(const NodeInput&)>& of) const {
  std::map<std::size_t, const NodeInput*> inputs;
  for (const NodeInput& input : variation_.inputs()) {
    inputs.emplace(formula::variables_of(input.variable).front(), &input);
  }
  return values_at(formulas, [&](std::size_t variable) { return of(*inputs.at(variable)); });
}

}  // namespace rubato
