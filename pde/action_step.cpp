#include <rubato/pde/action_step.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <rubato/base/limits.hpp>
#include <rubato/formula/sum.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::FieldSet;
using Level = NodeVariation::Level;

/// Into these fields, in their order.
void evaluate(NodeCode& code, const std::vector<int>& fields, FieldSet& out) {
  std::vector<double*> outputs;
  for (const int f : fields) {
    outputs.push_back(out.field(f).data());
  }
  code(outputs);
}

bool depends_on(Expression formula, Expression variable) {
  const auto numbers = formula::variables_of(formula);
  return std::ranges::binary_search(numbers, formula::variables_of(variable).front());
}

Expression magnitude_sum(std::span<const Expression> terms) {
  Expression sum;
  for (const Expression& term : terms) {
    if (!is_zero(term)) {
      sum = sum.valid() ? sum + abs(term) : abs(term);
    }
  }
  return sum.valid() ? sum : constant_like(terms.front(), 0.0);
}

bool is_finite(const FieldSet& fields, std::span<const int> which) {
  return std::ranges::all_of(which, [&](int f) { return std::isfinite(grids::max_abs(fields.field(f))); });
}

}  // namespace

ActionStep::ActionStep(const MultisymplecticSystem& system, const grids::Grid& grid, const CornerDensity& density,
                       double h, bool two_step)
    : rows_(system, grid, density, two_step),
      density_(1, grid.size()),
      lower_(system.field_count(), grid.size()),
      upper_(lower_),
      row_values_(static_cast<int>(rows_.rows().size()), grid.size()),
      volume_(grid.cell_volume()) {
  std::vector<int> fields;
  std::vector<Expression> rows;
  for (const ActionRows::Row& row : rows_.rows()) {
    fields.push_back(row.field);
    rows.push_back(row.row);
  }
  equations_ = action_equations(rows_, std::move(fields), std::move(rows));
  find_stages();
  if (stages_.empty()) {
    kernel_ = find_kernel(rows_, equations_, h);
    newton_.emplace(rows_, equations_, kernel_);
  }
  compile();
}

std::vector<std::string> ActionStep::held() const {
  std::vector<std::string> names;
  for (const KernelMode& mode : kernel_.modes) {
    names.push_back(describe(mode, rows_, equations_));
  }
  return names;
}

void ActionStep::constrain(double h, LatticeLevel& level) {
  std::vector<int> fields;
  std::vector<Expression> at_rest;
  for (const ActionRows::Row& row : rows_.rows()) {
    if (!row.in_slab && rows_.system().M().row(row.field).isZero(0.0)) {
      fields.push_back(row.field);
      at_rest.push_back(rows_.raised(row.lower + row.upper));
    }
  }
  if (!fields.empty()) {
    const ActionEquations constraints = action_equations(rows_, fields, at_rest);
    NodeCode code = rows_.variation().code(at_rest);
    FieldSet values(static_cast<int>(fields.size()), level.fields.size()), found(level.fields);
    bool solved = false;
    try {
      ActionNewton newton(rows_, constraints, find_kernel(rows_, constraints, h));
      solved = newton.solve(
                   h, 0.0, level.fields, found, [&](NodeCode& some) { read(some, h, level, found, no_momenta_); }, code,
                   values) == Status::success;
    } catch (const std::invalid_argument&) {
      // Several discrete constraints leave a field free: what is given stays.
    }
    if (solved) {
      level.fields.copy_from(found);
    }
  }
  for (const ActionRows::Derived& derived : rows_.derived()) {
    if (rows_.system().M().row(derived.field).isZero(0.0)) {
      NodeCode code = rows_.variation().code(std::array{derived.value});
      double* const out[] = {level.fields.field(derived.field).data()};
      read(code, h, level, level.fields, no_momenta_);
      code(out);
    }
  }
}

/// Orders the rows: each gives one field that it is linear in, at its own node, from fields of the stages before.
void ActionStep::find_stages() {
  const int d = rows_.system().field_count();
  NodeVariation& variation = rows_.variation();
  std::vector<bool> solved(static_cast<std::size_t>(d), false), used(rows_.rows().size(), false);
  std::size_t left = rows_.rows().size();
  std::vector<Stage> stages;
  while (left > 0) {
    Stage stage;
    std::vector<Expression> values;
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i]) {
        continue;
      }
      const Expression row = rows_.rows()[i].row;
      int field = -1;
      bool fits = true;
      for (const NodeInput& input : rows_.upper_inputs(row)) {
        const int f = input.number - d;
        if (solved[static_cast<std::size_t>(f)] && std::ranges::find(stage.fields, f) == stage.fields.end()) {
          continue;
        }
        fits = fits && (field < 0 || field == f) && input.offset == std::array<int, 3>{};
        field = f;
      }
      if (!fits || field < 0 || solved[static_cast<std::size_t>(field)]) {
        continue;
      }
      const Expression unknown = variation.node(Level::after, field), base = variation.node(Level::before, field);
      const Expression slope = formula::derivative(row, unknown);
      if (is_zero(slope) || !is_zero(formula::derivative(slope, unknown))) {
        continue;
      }
      const std::vector<Expression> at_base =
          formula::substitute(std::array{row, slope}, variation.graph(), std::array{unknown}, std::array{base});
      values.push_back(base - at_base[0] / at_base[1]);
      stage.fields.push_back(field);
      solved[static_cast<std::size_t>(field)] = used[i] = true;
      --left;
    }
    if (stage.fields.empty()) {
      return;
    }
    std::vector<Expression> tangent, by_step;
    for (const Expression& value : values) {
      tangent.push_back(rows_.along_both(value));
      by_step.push_back(rows_.by_step(value) + rows_.along_upper(value));
    }
    stage.values = variation.code(values);
    stage.tangent = variation.code(tangent);
    stage.by_step = variation.code(by_step);
    stages.push_back(std::move(stage));
  }
  stages_ = std::move(stages);
}

void ActionStep::find_turns() {
  std::size_t count = 0;
  for (const ActionRows::Derived& one : rows_.derived()) {
    count = std::max(count, one.turn + 1);
  }
  turns_.resize(count);
  for (std::size_t turn = 0; turn < count; ++turn) {
    std::vector<Expression> values, tangent;
    for (const ActionRows::Derived& one : rows_.derived()) {
      if (one.turn == turn) {
        turns_[turn].fields.push_back(one.field);
        values.push_back(one.value);
        tangent.push_back(rows_.along_both(one.value));
      }
    }
    turns_[turn].values = rows_.variation().code(values);
    turns_[turn].tangent = rows_.variation().code(tangent);
  }
}

void ActionStep::follow(double h, const LatticeLevel& before, const FieldSet& after, FieldSet& out) {
  for (Turn& turn : turns_) {
    read(turn.values, h, before, after, no_momenta_);
    evaluate(turn.values, turn.fields, out);
  }
}

void ActionStep::compile() {
  NodeVariation& variation = rows_.variation();
  std::vector<Expression> row, kept, implied, along_upper, along_lower, by_step, forms;
  find_turns();
  const Expression energy = variation.energy();
  energy_code_ = variation.code(std::array{energy});
  has_tangents_ = rows_.kept() == 0;
  for (const ActionRows::Row& one : rows_.rows()) {
    row.push_back(one.row);
    along_upper.push_back(rows_.along_upper(one.row));
    along_lower.push_back(rows_.along_lower(one.row));
    by_step.push_back(rows_.by_step(one.row));
    if (one.kept >= 0) {
      kept.push_back(one.upper);
      implied.push_back(-one.lower);
    }
  }
  row_code_ = variation.code(row);
  if (!kept.empty()) {
    keep_ = variation.code(kept);
    imply_ = variation.code(implied);
  }
  row_along_upper_ = variation.code(along_upper);
  row_along_lower_ = variation.code(along_lower);
  row_by_step_ = variation.code(by_step);
  slope_code_ = variation.code(std::array{rows_.by_step(energy) + rows_.along_upper(energy)});
  if (has_tangents_) {
    using Take = Expression (*)(const ActionRows::Row&, ActionRows&);
    constexpr std::array<Take, 4> takes = {
        [](const ActionRows::Row& one, ActionRows& rows) { return rows.along_both(one.lower); },
        [](const ActionRows::Row& one, ActionRows& rows) { return rows.along_both(one.upper); },
        [](const ActionRows::Row& one, ActionRows& rows) { return rows.along_lower(one.momentum); },
        [](const ActionRows::Row& one, ActionRows& rows) { return rows.along_upper(rows.raised(one.momentum)); }};
    for (const Take take : takes) {
      for (const ActionRows::Row& one : rows_.rows()) {
        forms.push_back(take(one, rows_));
      }
    }
    forms_code_ = variation.code(forms);
  }
  // |∂e/∂z z| is what the rounding of a value makes of e.
  std::vector<Expression> variables, products;
  for (const NodeInput& input : variation.inputs()) {
    if (input.kind == NodeInput::Kind::node && depends_on(energy, input.variable)) {
      variables.push_back(input.variable);
    }
  }
  const std::vector<Expression> first = formula::gradient(energy, variables);
  for (std::size_t j = 0; j < first.size(); ++j) {
    products.push_back(first[j] * variables[j]);
  }
  const std::vector<Expression> terms = formula::terms_of(energy);
  size_code_ =
      variation.code(std::array{energy, magnitude_sum(terms), products.empty() ? energy : magnitude_sum(products)});
}

void ActionStep::read(NodeCode& code, double h, const LatticeLevel& before, const FieldSet& after,
                      const FieldSet& kept) const {
  rows_.read(code, before.fields, after, h, before.slopes, {&kept, &lower_, &upper_});
}

void ActionStep::leave_level() {
  if (newton_) {
    newton_->leave_level();
  }
}

Status ActionStep::solve(double h, const LatticeLevel& before, const FieldSet& kept, double accuracy, FieldSet& after) {
  return newton_ ? newton_->solve(
                       h, accuracy, before.fields, after, [&](NodeCode& code) { read(code, h, before, after, kept); },
                       row_code_, row_values_)
                 : solve_by_stages(h, before, kept, after);
}

Status ActionStep::solve_by_stages(double h, const LatticeLevel& before, const FieldSet& kept, FieldSet& after) {
  for (Stage& stage : stages_) {
    read(stage.values, h, before, after, kept);
    evaluate(stage.values, stage.fields, after);
  }
  for (const Stage& stage : stages_) {
    if (!is_finite(after, stage.fields)) {
      return Status::undefined;
    }
  }
  return Status::success;
}

void ActionStep::derive(double h, const LatticeLevel& before, FieldSet& after) {
  follow(h, before, after, after);
  find_energy(h, before, after);
}

void ActionStep::find_energy(double h, const LatticeLevel& before, const FieldSet& after) {
  double* const out[] = {density_.field(0).data()};
  read(energy_code_, h, before, after, no_momenta_);
  energy_code_(out);
}

double ActionStep::energy() const {
  return volume_ * grids::sum(density_.field(0));
}

double ActionStep::energy_at_rest(double h, const LatticeLevel& level) {
  double* const out[] = {row_values_.field(0).data()};
  read(energy_code_, h, level, level.fields, no_momenta_);
  energy_code_(out);
  return volume_ * grids::sum(std::as_const(row_values_).field(0));
}

double ActionStep::relative_miss(double h, const LatticeLevel& before, const LatticeLevel& after,
                                 const FieldSet& kept) {
  std::vector<Expression> all;
  for (const ActionRows::Row& row : rows_.rows()) {
    all.insert(all.end(), {row.row, row.lower, row.upper});
  }
  NodeCode code = rows_.variation().code(all);
  FieldSet found(static_cast<int>(all.size()), after.fields.size());
  read(code, h, before, after.fields, kept);
  code(found.pointers());
  double largest = 0.0;
  for (int i = 0; i < found.fields(); i += 3) {
    const double size =
        std::max(grids::max_abs(std::as_const(found).field(i + 1)), grids::max_abs(std::as_const(found).field(i + 2)));
    const double miss = grids::max_abs(std::as_const(found).field(i));
    largest = std::max(largest, size > 0.0 ? miss / size : miss);
  }
  return largest;
}

formula::SumSize ActionStep::energy_size(double h, const LatticeLevel& before, const FieldSet& after) {
  FieldSet out(3, after.size());
  read(size_code_, h, before, after, no_momenta_);
  size_code_(out.pointers());
  const FieldSet& found = out;
  const double sum = volume_ * std::abs(grids::sum(found.field(0)));
  const double magnitudes = volume_ * grids::sum(found.field(1));
  // Rounding errors of nodes are independent of each other.
  const double spread =
      volume_ * std::sqrt(grids::dot(found.field(2), found.field(2)) + grids::dot(found.field(1), found.field(1)));
  return {.terms = std::max(sum, formula::part_that_counts * magnitudes),
          .cancelled = formula::part_that_counts * std::max(magnitudes - sum, 0.0),
          .rounding = tuning::action_step::roundings * 0.5 * epsilon * (spread + sum)};
}

bool ActionStep::solve_linear(NodeCode& right, double h, const LatticeLevel& before, const FieldSet& kept,
                              const FieldSet& after) {
  return newton_->solve_linear(
      h, upper_, [&](NodeCode& code) { read(code, h, before, after, kept); }, right, row_along_upper_, row_values_);
}

double ActionStep::energy_slope(double h, const LatticeLevel& before, const FieldSet& kept, const FieldSet& after) {
  upper_.fill(0.0);
  if (newton_) {
    if (!solve_linear(row_by_step_, h, before, kept, after)) {
      return std::numeric_limits<double>::quiet_NaN();
    }
  } else {
    for (Stage& stage : stages_) {
      std::vector<double*> out;
      FieldSet found(static_cast<int>(stage.fields.size()), after.size());
      read(stage.by_step, h, before, after, kept);
      stage.by_step(found.pointers());
      for (std::size_t i = 0; i < stage.fields.size(); ++i) {
        std::ranges::copy(std::as_const(found).field(static_cast<int>(i)), upper_.field(stage.fields[i]).begin());
      }
    }
  }
  double* const out[] = {row_values_.field(0).data()};
  read(slope_code_, h, before, after, kept);
  slope_code_(out);
  return volume_ * grids::sum(std::as_const(row_values_).field(0));
}

void ActionStep::keep(double h, const LatticeLevel& before, const FieldSet& after, FieldSet& kept) {
  if (rows_.kept() > 0) {
    read(keep_, h, before, after, no_momenta_);
    keep_(kept.pointers());
  }
}

void ActionStep::imply(double h, const LatticeLevel& before, const FieldSet& after, FieldSet& kept) {
  if (rows_.kept() > 0) {
    read(imply_, h, before, after, no_momenta_);
    imply_(kept.pointers());
  }
}

void ActionStep::measure(double h, const LatticeLevel& before, const LatticeLevel& after, const FieldSet& kept,
                         FieldSet& out) {
  read(row_code_, h, before, after.fields, kept);
  row_code_(row_values_.pointers());
  out.fill(0.0);
  for (std::size_t i = 0; i < rows_.rows().size(); ++i) {
    const auto from = std::as_const(row_values_).field(static_cast<int>(i));
    const auto to = out.field(rows_.rows()[i].field);
    std::ranges::transform(from, to.begin(), [h](double value) { return value / h; });
  }
  follow(h, before, after.fields, out);
  find_energy(h, before, after.fields);
  for (const Turn& turn : turns_) {
    for (const int f : turn.fields) {
      const auto found = after.fields.field(f);
      const auto to = out.field(f);
      std::ranges::transform(found, to, to.begin(), [h](double here, double there) { return (here - there) / h; });
    }
  }
}

Status ActionStep::tangent(double h, const LatticeLevel& before, const LatticeLevel& after, const FieldSet& u_before,
                           FieldSet& u_after, FieldSet& forms) {
  lower_.copy_from(u_before);
  upper_.fill(0.0);
  if (newton_) {
    if (!solve_linear(row_along_lower_, h, before, no_momenta_, after.fields)) {
      return Status::not_converged;
    }
  } else {
    for (Stage& stage : stages_) {
      FieldSet found(static_cast<int>(stage.fields.size()), upper_.size());
      read(stage.tangent, h, before, after.fields, no_momenta_);
      stage.tangent(found.pointers());
      for (std::size_t i = 0; i < stage.fields.size(); ++i) {
        std::ranges::copy(std::as_const(found).field(static_cast<int>(i)), upper_.field(stage.fields[i]).begin());
      }
    }
  }
  for (Turn& turn : turns_) {
    read(turn.tangent, h, before, after.fields, no_momenta_);
    evaluate(turn.tangent, turn.fields, u_after);
    for (const int f : turn.fields) {
      std::ranges::copy(std::as_const(u_after).field(f), upper_.field(f).begin());
    }
  }
  read(forms_code_, h, before, after.fields, no_momenta_);
  forms_code_(forms.pointers());
  u_after.copy_from(upper_);
  for (int f = 0; f < u_after.fields(); ++f) {
    if (!std::isfinite(grids::max_abs(std::as_const(u_after).field(f)))) {
      return Status::undefined;
    }
  }
  return Status::success;
}

}  // namespace rubato
