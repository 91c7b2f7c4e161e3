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
#include <rubato/grids/slab.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/variation/weighted_terms.hpp>

namespace rubato {

namespace {

using formula::Expression;
using grids::FieldSet;
using Level = NodeVariation::Level;

/// Into these fields, in their order.
void evaluate_into(NodeCode& code, const std::vector<int>& fields, FieldSet& out) {
  std::array<double*, MultisymplecticSystem::most_fields> outputs{};
  const auto end = std::ranges::transform(fields, outputs.begin(), [&](int f) { return out.field(f).data(); }).out;
  code(std::span(outputs.begin(), end));
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

Expression sum_of(Expression a, Expression b) {
  return is_zero(a) ? b : is_zero(b) ? a : a + b;
}

}  // namespace

ActionStep::ActionStep(const MultisymplecticSystem& system, const grids::Grid& grid, const StatedAction& stated,
                       double h, bool two_step)
    : rows_(system, grid, stated, two_step),
      lower_(system.field_count(), 0),
      upper_(system.field_count(), 0),
      nodes_(grid.size()),
      volume_(grid.cell_volume()) {
  if (stated.drives != nullptr) {
    driven_nodes_.emplace(stated.drives, system, grid);
    driven_ = FieldSet(static_cast<int>(driven_nodes_->fields().size()), grid.size());
  }
  find_held();
  find_stages();
  find_turns();
  if (stages_.empty()) {
    std::vector<int> fields;
    std::vector<Expression> rows;
    for (const ActionRows::Row& row : rows_.rows()) {
      fields.push_back(row.field);
      rows.push_back(row.row);
    }
    row_values_ = FieldSet(static_cast<int>(rows.size()), grid.size());
    implicit_.emplace();
    implicit_->equations = action_equations(rows_, std::move(fields), std::move(rows));
    implicit_->kernel = find_kernel(rows_, implicit_->equations, h);
    implicit_->newton.emplace(rows_, implicit_->equations, implicit_->kernel);
  }
}

std::vector<std::string> ActionStep::held() const {
  std::vector<std::string> names;
  if (implicit_) {
    for (const KernelMode& mode : implicit_->kernel.modes) {
      names.push_back(describe(mode, rows_, implicit_->equations));
    }
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
  write(level);
}

void ActionStep::write(LatticeLevel& level) {
  for (Turn& turn : turns_) {
    if (!turn.is_momenta) {
      NodeCode& code = made(turn.value, [&] { return turn.values; });
      read(code, 1.0, level, level.fields, no_momenta_);
      evaluate_into(code, turn.fields, level.fields);
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
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i]) {
        continue;
      }
      const ActionRows::Row& one = rows_.rows()[i];
      const Expression row = one.row;
      int field = -1;
      bool fits = true, reads_it_alone = true;
      for (const NodeInput& input : rows_.upper_inputs(row)) {
        const int f = input.number - d;
        if (solved[static_cast<std::size_t>(f)] && std::ranges::find(stage.fields, f) == stage.fields.end()) {
          reads_it_alone = false;
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
      const bool rests =
          reads_it_alone && field == one.field && one.momentum.valid() && row == one.lower + one.momentum;
      const Expression of_row = rests ? rows_.at_rest(one) : at_base[0];
      const WeightedTerms slopes(at_base[1]);
      const bool is_rate = slopes.terms().size() == 1 && slopes.terms().front().first == variation.rate();
      const Expression change =
          is_rate ? variation.step() / slopes.terms().front().second * of_row : of_row / slopes.sum();
      stage.values.push_back(where_loose(field, base - change));
      stage.fields.push_back(field);
      solved[static_cast<std::size_t>(field)] = used[i] = true;
      --left;
    }
    if (stage.fields.empty()) {
      return;
    }
    stage.reach = reach(stage.values);
    stages.push_back(std::move(stage));
  }
  stages_ = std::move(stages);
}

/// The planes that formulas read on either side.
std::size_t ActionStep::reach(std::span<const Expression> formulas) const {
  const auto last = static_cast<std::size_t>(rows_.grid().dimensions() - 1);
  int far = 0;
  for (const Expression& formula : formulas) {
    for (const NodeInput& input : rows_.variation().inputs_of(formula)) {
      far = std::max(far, std::abs(input.offset[last]));
    }
  }
  return static_cast<std::size_t>(far);
}

void ActionStep::find_turns() {
  const auto moves = [&](const ActionRows::Derived& one) { return !rows_.system().M().row(one.field).isZero(0.0); };
  const auto add = [&](bool momenta, std::size_t turn) {
    Turn found{.fields = {}, .values = {}, .is_momenta = momenta, .value = {}, .tangent = {}};
    for (const ActionRows::Derived& one : rows_.derived()) {
      if (moves(one) == momenta && one.turn == turn) {
        found.fields.push_back(one.field);
        found.values.push_back(momenta ? where_loose(one.field, one.value) : one.value);
      }
    }
    if (!found.fields.empty()) {
      turns_.push_back(std::move(found));
    }
  };
  add(true, 0);
  for (std::size_t turn = 0; turn < rows_.derived().size(); ++turn) {
    add(false, turn);
  }
  if (!turns_.empty() && turns_.front().is_momenta) {
    momenta_ = turns_.front().fields;
  }
  for (const Turn& turn : turns_) {
    if (!turn.is_momenta) {
      written_.insert(written_.end(), turn.fields.begin(), turn.fields.end());
    }
  }
  for (int f = 0; f < rows_.system().field_count(); ++f) {
    if (std::ranges::find(written_, f) == written_.end()) {
      found_.push_back(f);
    }
  }
}

/// 𝓔 by the momenta as fields; invalid where steps have none that is theirs.
formula::Expression ActionStep::energy_of_level() {
  if (!is_explicit() || !rows_.is_symmetric() || rows_.kept() > 0) {
    return {};
  }
  const int d = rows_.system().field_count();
  std::vector<Expression> momenta(static_cast<std::size_t>(d));
  for (const ActionRows::Row& row : rows_.rows()) {
    if (const int v = row.momentum_field; v >= 0) {
      momenta[static_cast<std::size_t>(row.field)] =
          rows_.system().M()(v, row.field) * rows_.variation().node(Level::after, v);
    }
  }
  const Expression energy = rows_.variation().energy_of_level(momenta, rows_.upper_direction(0));
  if (!energy.valid()) {
    return {};
  }
  const auto terms = rows_.variation().in_sum(energy);
  return sum_of(terms.of_slab, terms.of_upper);
}

void ActionStep::prepare_pass() {
  NodeVariation& variation = rows_.variation();
  const grids::Grid& grid = rows_.grid();
  const int d = rows_.system().field_count();
  const int others = rows_.kept() + 2 * d + driven_.fields();
  const auto energy = variation.in_sum(variation.energy());
  const Expression of_level = energy_of_level();
  finds_energy_of_levels_ = of_level.valid();

  std::vector<Expression> outputs;
  std::vector<int> written;
  std::size_t lost = 0;
  for (const Turn& turn : turns_) {
    if (turn.is_momenta) {
      outputs = turn.values;
      lost = reach(outputs);
    }
  }
  for (const int f : momenta_) {
    written.push_back(d + f);
  }
  const std::size_t momenta = outputs.size();

  pass_ = NodePass(grid);
  for (const Stage& stage : stages_) {
    std::vector<Expression> values = stage.values;
    if (&stage == &stages_.front()) {
      levels_ = variation.keep_of_lower(others, values);
    }
    std::vector<int> fields;
    for (const int f : stage.fields) {
      fields.push_back(d + f);
    }
    pass_.add(variation.code(values), fields, std::max(lost, stage.reach));
  }
  const auto kept = levels_.kept();
  for (std::size_t k = 0; k < kept.size(); ++k) {
    outputs.push_back(kept[k]);
    written.push_back(variation.first_other() + others + static_cast<int>(kept.size() + k));
  }
  // Of the sums the first two are E but for the lower level's part.
  std::vector<Expression> sums = {energy.of_slab, energy.of_upper};
  place_of_lower_ = energy.of_lower == energy.of_upper ? 1 : sums.size();
  if (place_of_lower_ > 1) {
    sums.push_back(energy.of_lower);
  }
  if (of_level.valid()) {
    // The momenta are being written.
    std::vector<Expression> from, to;
    for (const NodeInput& input : variation.inputs_of(of_level)) {
      const auto momentum = std::ranges::find(momenta_, input.number - d);
      if (input.kind == NodeInput::Kind::node && momentum != momenta_.end()) {
        from.push_back(input.variable);
        to.push_back(variation.at_node(outputs[static_cast<std::size_t>(momentum - momenta_.begin())], input.offset));
      }
    }
    sums.push_back(formula::substitute(of_level, from, to));
  } else if (is_explicit()) {
    Expression none = variation.graph().constant(0.0);  // becomes NaN with the first value that is not finite
    for (const Stage& stage : stages_) {
      for (const int f : stage.fields) {
        none = none + 0.0 * variation.node(Level::after, f);
      }
    }
    for (std::size_t k = 0; k < momenta; ++k) {
      none = none + 0.0 * outputs[k];
    }
    sums.push_back(none);
  }
  outputs.insert(outputs.end(), sums.begin(), sums.end());
  pass_.add(variation.code(outputs), written);
  begin_ = NodePass(grid);
  std::vector<Expression> of_begin = {energy.of_lower};
  if (of_level.valid()) {
    of_begin.push_back(of_level);
  }
  begin_.add(variation.code(of_begin), {});
}

void ActionStep::read(NodeCode& code, double h, const LatticeLevel& before, const FieldSet& after,
                      const FieldSet& kept) const {
  rows_.read(code, before.fields, after, h, before.slopes,
             {&kept, &lower_, &upper_, &driven_, &levels_.lower(), &levels_.upper()});
}

void ActionStep::begin(const LatticeLevel& level) {
  if (pass_.size() == 0) {
    prepare_pass();
  }
  const auto read_level = [&](NodeCode& code, const FieldSet& fields) { read(code, 1.0, level, fields, no_momenta_); };
  for (int i = 0; i < driven_.fields(); ++i) {
    std::ranges::copy(level.fields.field(driven_nodes_->fields()[static_cast<std::size_t>(i)]),
                      driven_.field(i).begin());
  }
  levels_.take(level.fields, level.fields, false, read_level);
  read(begin_.code(0), 1.0, level, level.fields, no_momenta_);
  begin_(0);
  below_.of_energy = begin_.sums().front();
  below_.energy = begin_.sums().back();
  if (implicit_) {
    implicit_->newton->leave_level();
  }
}

void ActionStep::renew(const LatticeLevel& level, std::span<const grids::NodeRange> ranges) {
  levels_.renew(level.fields, ranges,
                [&](NodeCode& code, const FieldSet& fields) { read(code, 1.0, level, fields, no_momenta_); });
}

void ActionStep::move() {
  levels_.go_on();
  below_ = above_;
  if (implicit_) {
    implicit_->newton->leave_level();
  }
}

bool ActionStep::evaluate(std::size_t first_stage, double h, const LatticeLevel& before, const FieldSet& kept,
                          const FieldSet& after, FieldSet& out) {
  for (std::size_t s = first_stage; s < pass_.size(); ++s) {
    read(pass_.code(s), h, before, after, kept);
    if (s < stages_.size()) {
      pass_.write(s, out, stages_[s].fields);
    } else {
      pass_.write(s, out, momenta_, levels_.upper().pointers());
    }
  }
  pass_(first_stage);
  const std::span<const double> sums = pass_.sums();
  of_slab_ = sums[0] + sums[1];
  above_ = {.of_energy = sums[place_of_lower_], .energy = sums.back()};
  return std::ranges::all_of(sums, [](double sum) { return std::isfinite(sum); });
}

Status ActionStep::advance(double h, const LatticeLevel& before, const FieldSet& kept, double accuracy,
                           FieldSet& after) {
  if (implicit_) {
    const Status status = implicit_->newton->solve(
        h, accuracy, before.fields, after, [&](NodeCode& code) { read(code, h, before, after, kept); },
        made_of_rows(codes_.row, [](const ActionRows::Row& row) { return row.row; }), row_values_);
    if (status != Status::success) {
      return status;
    }
  }
  return evaluate(0, h, before, kept, after, after) ? Status::success : Status::undefined;
}

void ActionStep::derive(double h, const LatticeLevel& before, const FieldSet& after, FieldSet& momenta) {
  static_cast<void>(evaluate(pass_.size() - 1, h, before, no_momenta_, after, momenta));
}

double ActionStep::energy_at_rest(double h, const LatticeLevel& level) {
  if (rest_.size() == 0) {
    NodeVariation& variation = rows_.variation();
    rest_ = NodePass(rows_.grid());
    rest_.add(rows_.variation().code(std::array{variation.between_walls(variation.energy())}), {});
  }
  read(rest_.code(0), h, level, level.fields, no_momenta_);
  rest_(0);
  return volume_ * rest_.sums().front();
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
  NodeVariation& variation = rows_.variation();
  if (size_.size() == 0) {
    const Expression energy = variation.between_walls(WeightedTerms(variation.energy()).sum());
    // |∂e/∂z z| is what the rounding of a value makes of e.
    std::vector<Expression> variables, products;
    for (const NodeInput& input : variation.inputs_of(energy)) {
      if (input.kind == NodeInput::Kind::node) {
        variables.push_back(input.variable);
      }
    }
    const std::vector<Expression> first = formula::gradient(energy, variables);
    for (std::size_t j = 0; j < first.size(); ++j) {
      products.push_back(first[j] * variables[j]);
    }
    const Expression terms = magnitude_sum(formula::terms_of(energy));
    const Expression roundings = products.empty() ? energy : magnitude_sum(products);
    size_ = NodePass(rows_.grid());
    size_.add(variation.code(std::array{energy, terms, roundings * roundings + terms * terms}), {});
  }
  read(size_.code(0), h, before, after, no_momenta_);
  size_(0);
  const double sum = volume_ * std::abs(size_.sums()[0]), magnitudes = volume_ * size_.sums()[1];
  // Rounding errors of nodes are independent of each other.
  const double spread = volume_ * std::sqrt(size_.sums()[2]);
  return {.terms = std::max(sum, formula::part_that_counts * magnitudes),
          .cancelled = formula::part_that_counts * std::max(magnitudes - sum, 0.0),
          .rounding = tuning::action_step::roundings * 0.5 * epsilon * (spread + sum),
          .magnitudes = magnitudes};
}

bool ActionStep::solve_linear(NodeCode& right, double h, const LatticeLevel& before, const FieldSet& kept,
                              const FieldSet& after) {
  NodeCode& along =
      made_of_rows(codes_.along_upper, [&](const ActionRows::Row& row) { return rows_.along_upper(row.row); });
  return implicit_->newton->solve_linear(
      h, upper_, [&](NodeCode& code) { read(code, h, before, after, kept); }, right, along, row_values_);
}

/// Makes the directions before they are read: few runs have any, and memory that is reserved counts in limits.
void ActionStep::make_directions() {
  if (upper_.size() != nodes_) {
    lower_ = FieldSet(lower_.fields(), nodes_);
    upper_ = FieldSet(upper_.fields(), nodes_);
  }
}

void ActionStep::move_direction(NodeCode& code, const Stage& stage) {
  FieldSet found(static_cast<int>(stage.fields.size()), nodes_);
  code(found.pointers());
  for (std::size_t i = 0; i < stage.fields.size(); ++i) {
    std::ranges::copy(std::as_const(found).field(static_cast<int>(i)), upper_.field(stage.fields[i]).begin());
  }
  grids::refresh_ghosts(upper_, stage.fields, stage.reach);
}

double ActionStep::energy_slope(double h, const LatticeLevel& before, const FieldSet& kept, const FieldSet& after) {
  make_directions();
  upper_.fill(0.0);
  if (implicit_) {
    NodeCode& by_step =
        made_of_rows(codes_.by_step, [&](const ActionRows::Row& row) { return rows_.by_step(row.row); });
    if (!solve_linear(by_step, h, before, kept, after)) {
      return std::numeric_limits<double>::quiet_NaN();
    }
  } else {
    for (Stage& stage : stages_) {
      NodeCode& code = made(stage.by_step, [&] {
        std::vector<Expression> by_step;
        for (const Expression& value : stage.values) {
          by_step.push_back(rows_.by_step(value) + rows_.along_upper(value));
        }
        return by_step;
      });
      read(code, h, before, after, kept);
      move_direction(code, stage);
    }
  }
  if (slope_.size() == 0) {
    NodeVariation& variation = rows_.variation();
    const Expression energy = variation.between_walls(variation.energy());
    slope_ = NodePass(rows_.grid());
    slope_.add(variation.code(std::array{rows_.by_step(energy) + rows_.along_upper(energy)}), {});
  }
  read(slope_.code(0), h, before, after, kept);
  slope_(0);
  return volume_ * slope_.sums().front();
}

template <class Of>
void ActionStep::keep_by(LateCode& code, const Of& of, double h, const LatticeLevel& before, const FieldSet& after,
                         FieldSet& kept) {
  if (rows_.kept() > 0) {
    NodeCode& momenta = made(code, [&] {
      std::vector<Expression> formulas;
      for (const ActionRows::Row& row : rows_.rows()) {
        if (row.kept >= 0) {
          formulas.push_back(of(row));
        }
      }
      return formulas;
    });
    read(momenta, h, before, after, no_momenta_);
    momenta(kept.pointers());
  }
}

void ActionStep::keep(double h, const LatticeLevel& before, const FieldSet& after, FieldSet& kept) {
  keep_by(
      codes_.keep, [](const ActionRows::Row& row) { return row.upper; }, h, before, after, kept);
}

void ActionStep::imply(double h, const LatticeLevel& before, const FieldSet& after, FieldSet& kept) {
  keep_by(
      codes_.imply, [](const ActionRows::Row& row) { return -row.lower; }, h, before, after, kept);
}

void ActionStep::measure(double h, const LatticeLevel& before, const LatticeLevel& after, const FieldSet& kept,
                         FieldSet& out) {
  NodeCode& row = made_of_rows(codes_.row, [](const ActionRows::Row& one) { return one.row; });
  read(row, h, before, after.fields, kept);
  out.fill(0.0);
  std::vector<double*> rows;
  for (const ActionRows::Row& one : rows_.rows()) {
    rows.push_back(out.field(one.field).data());
  }
  row(rows);
  for (const ActionRows::Row& one : rows_.rows()) {
    for (double& value : out.field(one.field)) {
      value /= h;
    }
  }
  begin(before);
  derive(h, before, after.fields, out);
  for (Turn& turn : turns_) {
    if (!turn.is_momenta) {
      NodeCode& code = made(turn.value, [&] { return turn.values; });
      read(code, h, before, after.fields, no_momenta_);
      evaluate_into(code, turn.fields, out);
    }
    for (const int f : turn.fields) {
      const auto found = after.fields.field(f);
      const auto to = out.field(f);
      std::ranges::transform(found, to, to.begin(), [h](double here, double there) { return (here - there) / h; });
    }
  }
}

Status ActionStep::tangent(double h, const LatticeLevel& before, const LatticeLevel& after, const FieldSet& u_before,
                           FieldSet& u_after, FieldSet& forms) {
  make_directions();
  lower_.copy_from(u_before);
  upper_.fill(0.0);
  if (implicit_) {
    implicit_->newton->leave_level();
    NodeCode& along =
        made_of_rows(codes_.along_lower, [&](const ActionRows::Row& row) { return rows_.along_lower(row.row); });
    if (!solve_linear(along, h, before, no_momenta_, after.fields)) {
      return Status::not_converged;
    }
  }
  const auto tangents = [&](std::span<const Expression> values) {
    std::vector<Expression> along;
    for (const Expression& value : values) {
      along.push_back(rows_.along_both(value));
    }
    return along;
  };
  for (Stage& stage : stages_) {
    NodeCode& code = made(stage.tangent, [&] { return tangents(stage.values); });
    read(code, h, before, after.fields, no_momenta_);
    move_direction(code, stage);
  }
  for (Turn& turn : turns_) {
    NodeCode& code = made(turn.tangent, [&] { return tangents(turn.values); });
    read(code, h, before, after.fields, no_momenta_);
    evaluate_into(code, turn.fields, u_after);
    for (const int f : turn.fields) {
      std::ranges::copy(std::as_const(u_after).field(f), upper_.field(f).begin());
    }
  }
  NodeCode& of_forms = made(codes_.forms, [&] { return forms_of_rows(); });
  read(of_forms, h, before, after.fields, no_momenta_);
  of_forms(forms.pointers());
  u_after.copy_from(upper_);
  for (int f = 0; f < u_after.fields(); ++f) {
    if (!std::isfinite(grids::max_abs(std::as_const(u_after).field(f)))) {
      return Status::undefined;
    }
  }
  return Status::success;
}

std::vector<formula::Expression> ActionStep::forms_of_rows() {
  std::vector<Expression> forms;
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
  return forms;
}

}  // namespace rubato
