#include <rubato/pde/euler_box_map.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/grids/box_operators.hpp>
#include <rubato/grids/parallel.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/slab.hpp>
#include <rubato/pde/mirror_signs.hpp>
#include <rubato/pde/static_condensation.hpp>
#include <rubato/pde/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::euler_box;

[[noreturn]] void refuse(const std::string& reason) {
  throw std::invalid_argument(
      fmt::format(R"(euler-box is not explicit for this system: {}; use lagrangian = "box" or "fourier")", reason));
}

grids::BoxOperator difference_along(int axis) {
  grids::BoxOperator difference{grids::Along::identity, grids::Along::identity, grids::Along::identity};
  difference[static_cast<std::size_t>(axis)] = grids::Along::difference;
  return difference;
}

/// out += factor in.
void add(double factor, std::span<const double> in, std::span<double> out) {
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] += factor * in[i];
  }
}

/// out_i += factor a_i b_i.
void add_product(double factor, std::span<const double> a, std::span<const double> b, std::span<double> out) {
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] += factor * a[i] * b[i];
  }
}

}  // namespace

EulerBoxMap::EulerBoxMap(const MultisymplecticSystem& system, const grids::Grid& grid, bool derives)
    : system_(system),
      grid_(grid),
      outputs_(static_cast<int>(system.hessian_code().output_count()), grid.size()),
      row_(1, grid.size()),
      derivative_(1, grid.size()),
      scratch_(1, grid.size()),
      places_(system, grid, Within::node),
      evaluate_(system.hessian_code()) {
  if (system.directions() != grid.dimensions()) {
    throw std::invalid_argument(
        fmt::format("the system has {} space direction(s), the grid {}", system.directions(), grid.dimensions()));
  }
  plan();
  formulas_.emplace(system, grid, derives ? find_derived() : std::vector<int>());
  for (int f = 0; f < system.field_count(); ++f) {
    if (std::ranges::find(derived(), f) == derived().end()) {
      found_.push_back(f);
    }
  }
  compile();
  if (grid.has_ghosts()) {
    std::ranges::copy_if(
        FieldMirrors(system, grid, Collocation::corners).held(grid), std::back_inserter(held_), [&](const auto& held) {
          return std::ranges::any_of(
              solves_, [&](const LocalSolve& solve) { return !solve.is_affine && solve.field == held.first; });
        });
    ghosts_ = grids::ranges_where(grid, [&](std::size_t node) { return grid.weight(node) == 0.0; });
  }
}

/// What is read beyond walls is wrong in the outer ghosts.
void EulerBoxMap::clear_ghosts(std::span<double> values) const {
  for (const auto [begin, end] : ghosts_) {
    std::ranges::fill(values.subspan(begin, end - begin), 0.0);
  }
}

Status EulerBoxMap::start(grids::FieldSet& fields) {
  for (std::size_t i = 0; i < start_solves_.size(); ++i) {
    const LocalSolve& solve = start_solves_[i];
    if (start_.size() == i) {
      start_.push_back(solve.is_affine ? formulas_->constraint(solve.row, solve.field) : NodeCode());
    }
    if (solve.is_affine) {
      NodeCode& code = start_[i];
      formulas_->read(code, 1.0, fields, fields);
      double* const out[] = {fields.field(solve.field).data()};
      code(out);
      if (!std::isfinite(grids::max_abs(std::as_const(fields).field(solve.field)))) {
        return Status::undefined;
      }
    } else if (const Status status = run(solve, 1.0, fields, fields); status != Status::success) {
      return status;
    }
  }
  return Status::success;
}

/// Fields that their own row gives from neighbours, where steps read and write no array of theirs.
std::vector<int> EulerBoxMap::find_derived() const {
  std::vector<int> derived;
  for (const LocalSolve& solve : solves_) {
    if (varying_entry(solve.row, solve.field) >= 0) {
      return {};  // iterations read all arrays
    }
    const auto differentiates = [&](int f) { return across(solve.row, f); };
    if (solve.rate == 0.0 && solve.row == solve.field && linear_row(system_, solve.field) &&
        std::ranges::none_of(derived, differentiates)) {
      derived.push_back(solve.field);
    }
  }
  return derived;
}

double EulerBoxMap::energy(const grids::FieldSet& fields) {
  if (energy_.size() == 0) {
    energy_ = NodePass(grid_);
    energy_.add(formulas_->energy(), {});
  }
  formulas_->read(energy_.code(0), 0.0, fields, fields);
  energy_(0);
  return grid_.cell_volume() * energy_.sums().front();
}

void EulerBoxMap::write_derived(grids::FieldSet& fields) {
  for (std::size_t i = 0; i < derived().size(); ++i) {
    const int f = derived()[i];
    if (derive_.size() == i) {
      derive_.push_back(formulas_->constraint(f, f));
    }
    formulas_->read(derive_[i], 0.0, fields, fields);
    double* const out[] = {fields.field(f).data()};
    derive_[i](out);
  }
}

void EulerBoxMap::add_to(Turn& turn, NodeCode code, int field) const {
  turn.pass.add(std::move(code), {system_.field_count() + field}, is_renewed(field) ? halo_.planes : 0);
}

void EulerBoxMap::make_turns() {
  turns_.push_back({.pass = NodePass(grid_), .kicks = {}, .affine = {}});
  for (const Kick& kick : kicks_) {
    add_to(turns_.back(), formulas_->kick(kick.row, kick.column), kick.column);
    turns_.back().kicks.push_back(&kick);
  }
  for (const LocalSolve& solve : solves_) {
    if (!solve.is_affine) {
      turns_.back().iterated = &solve;
      turns_.push_back({.pass = NodePass(grid_), .kicks = {}, .affine = {}});
    } else if (std::ranges::find(derived(), solve.field) == derived().end()) {
      add_to(turns_.back(), formulas_->solve(solve.row, solve.field), solve.field);
      turns_.back().affine.push_back(&solve);
    }
  }
  turns_.back().pass.add(formulas_->energy(), {});
}

Status EulerBoxMap::advance(double h, const grids::FieldSet& before, grids::FieldSet& after, double& energy) {
  if (turns_.empty()) {
    make_turns();
  }
  for (Turn& turn : turns_) {
    std::size_t stage = 0;
    const auto let = [&](double factor, const int& field) {
      formulas_->read(turn.pass.code(stage), factor, before, after);
      turn.pass.write(stage++, after, std::span(&field, 1));
      ++evaluations_;
    };
    for (const Kick* const kick : turn.kicks) {
      let(h / kick->value, kick->column);
    }
    for (const LocalSolve* const solve : turn.affine) {
      let(1.0 / (system_.constant_hessian()(solve->row, solve->field) + solve->rate / h), solve->field);
    }
    if (stage < turn.pass.size()) {
      formulas_->read(turn.pass.code(stage), 0.0, before, after);
    }
    if (turn.pass.size() > 0) {
      turn.pass(0);
    }
    if (const LocalSolve* const solve = turn.iterated) {
      std::ranges::copy(before.field(solve->field), after.field(solve->field).begin());
      if (const Status status = run(*solve, h, before, after); status != Status::success) {
        return status;
      }
      for (const auto& [field, node] : held_) {
        if (field == solve->field) {
          after.field(field)[node] = before.field(field)[node];
        }
      }
      renew(solve->field, after);
    }
  }
  const std::span<const double> sums = turns_.back().pass.sums();
  energy = grid_.cell_volume() * sums[0];
  return std::isfinite(sums[0]) && std::isfinite(sums[1]) ? Status::success : Status::undefined;
}

Status EulerBoxMap::tangent(double h, const grids::FieldSet& before, const grids::FieldSet& after,
                            const grids::FieldSet& u_before, grids::FieldSet& u_after) {
  u_after.copy_from(u_before);
  evaluate(before);
  for (const Kick& entry : kicks_) {
    row_of_hessian(entry.row, u_before);
    add_differences(entry.row, u_before);
    kick_and_renew(entry, h, u_after);
  }
  evaluate(after);
  for (const LocalSolve& solve : solves_) {
    row_of_hessian(solve.row, u_after);
    add_differences(solve.row, u_after);
    const int entry = varying_entry(solve.row, solve.field);
    correct(solve, entry < 0 ? nullptr : std::as_const(outputs_).field(1 + system_.field_count() + entry).data(), h,
            u_before, u_after);
    if (!std::isfinite(grids::max_abs(row_.field(0)))) {
      return Status::undefined;
    }
    renew(solve.field, u_after);
  }
  return Status::success;
}

void EulerBoxMap::residual(double h, const grids::FieldSet& before, const grids::FieldSet& after,
                           grids::FieldSet& rows) {
  rows.fill(0.0);
  const auto set = [&](int row, double sign, int field, double rate) {
    const auto out = rows.field(row);
    add(sign, std::as_const(row_).field(0), out);
    add(rate / h, after.field(field), out);
    add(-rate / h, before.field(field), out);
  };
  for (const Kick& entry : kicks_) {
    evaluate_row(entry.code, before);
    add_differences(entry.row, before);
    set(entry.row, -1.0, entry.column, entry.value);
  }
  for (const LocalSolve& solve : solves_) {
    evaluate_row(solve.code, after);
    add_differences(solve.row, after);
    set(solve.row, 1.0, solve.field, solve.rate);
  }
}

/// Finds an order in which each equation of a level has one unknown, which it holds at the node itself.
void EulerBoxMap::plan() {
  const auto& M_plus = system_.structure().M_plus;
  const int d = system_.field_count();
  std::vector<bool> known(static_cast<std::size_t>(d), false);
  std::vector<bool> used(static_cast<std::size_t>(d), false);
  for (int r = 0; r < d; ++r) {
    for (int c = 0; c < d; ++c) {
      if (M_plus(r, c) == 0.0) {
        continue;
      }
      if ((M_plus.row(r).array() != 0.0).count() > 1 || (M_plus.col(c).array() != 0.0).count() > 1 ||
          !M_plus.col(r).isZero(0.0)) {
        refuse(fmt::format("its part M+ of M couples {} to more than one field",
                           system_.fields()[static_cast<std::size_t>(r)]));
      }
      kicks_.push_back({.row = r, .column = c, .value = M_plus(r, c)});
      known[static_cast<std::size_t>(c)] = true;
      used[static_cast<std::size_t>(r)] = true;
    }
  }
  order_solves(known, used, solves_);
  // At the start every field with an equation of motion is known, and the constraints give the rest.
  for (int f = 0; f < d; ++f) {
    const bool algebraic = system_.structure().algebraic[static_cast<std::size_t>(f)];
    known[static_cast<std::size_t>(f)] = used[static_cast<std::size_t>(f)] = !algebraic;
  }
  order_solves(known, used, start_solves_);
  halo_ = find_halo(true);
  const Halo other = find_halo(false);
  halo_.planes = std::max(halo_.planes, other.planes);
  halo_.lost = std::max(halo_.lost, other.lost);
}

void EulerBoxMap::order_solves(std::vector<bool> known, std::vector<bool> used, std::vector<LocalSolve>& solves) const {
  const int d = system_.field_count();
  for (bool progress = true; progress;) {
    progress = false;
    for (int r = 0; r < d; ++r) {
      std::vector<int> unknown;
      for (int f = 0; f < d; ++f) {
        if (!known[static_cast<std::size_t>(f)] && (local(r, f) || across(r, f))) {
          unknown.push_back(f);
        }
      }
      if (!used[static_cast<std::size_t>(r)] && unknown.size() == 1 && !across(r, unknown[0])) {
        solves.push_back({.row = r, .field = unknown[0], .rate = rate_of(r, unknown[0])});
        known[static_cast<std::size_t>(unknown[0])] = used[static_cast<std::size_t>(r)] = progress = true;
      }
    }
  }
  std::vector<std::string> left;
  for (int f = 0; f < d; ++f) {
    if (!known[static_cast<std::size_t>(f)]) {
      left.push_back(system_.fields()[static_cast<std::size_t>(f)]);
    }
  }
  if (!left.empty()) {
    refuse(fmt::format("no equation gives {} at a level node by node", fmt::join(left, ", ")));
  }
}

EulerBoxMap EulerBoxMap::of_three_nodes(const MultisymplecticSystem& system) {
  std::vector<grids::Axis> axes;
  for (int a = 0; a < system.directions(); ++a) {
    axes.push_back({std::string(1, static_cast<char>('a' + a)), 0.0, 1.0, 3});
  }
  return {system, grids::Grid(std::move(axes))};
}

EulerBoxMap::Halo EulerBoxMap::halo(const MultisymplecticSystem& system) {
  return of_three_nodes(system).halo_;
}

std::size_t EulerBoxMap::lost_at_walls(const MultisymplecticSystem& system) {
  return of_three_nodes(system).find_lost();
}

/// On both sides of an axis, from a level whose ghosts are right but for those of fields that follow from neighbours.
std::size_t EulerBoxMap::find_lost() const {
  std::vector<std::size_t> lost;
  for (const bool algebraic : system_.structure().algebraic) {
    lost.push_back(algebraic ? 1 : 0);
  }
  const auto of_row = [&](int row, const std::vector<std::size_t>& of) {
    std::size_t most = 0;
    for (int f = 0; f < system_.field_count(); ++f) {
      const std::size_t own = of[static_cast<std::size_t>(f)];
      most = std::max({most, local(row, f) ? own : 0, across(row, f) ? own + 1 : 0});
    }
    return most;
  };
  const std::vector<std::size_t> before = lost;
  for (const Kick& kick : kicks_) {
    lost[static_cast<std::size_t>(kick.column)] = of_row(kick.row, before);
  }
  for (const LocalSolve& solve : solves_) {
    lost[static_cast<std::size_t>(solve.field)] = 0;
    lost[static_cast<std::size_t>(solve.field)] = of_row(solve.row, lost);
  }
  return *std::ranges::max_element(lost);
}

/// On one side of a part, the one after it or the one before, along every axis.
EulerBoxMap::Halo EulerBoxMap::find_halo(bool after) const {
  const auto fields = static_cast<std::size_t>(system_.field_count());
  Halo halo;
  std::vector<bool> renewed(fields, false);
  for (int f = 0; f < system_.field_count(); ++f) {
    bool read = false;
    for (int r = 0; r < system_.field_count(); ++r) {
      read = read || across(r, f);
    }
    if (read && !system_.structure().algebraic[static_cast<std::size_t>(f)]) {
      renewed[static_cast<std::size_t>(f)] = true;
      halo.renewed.push_back(f);
    }
  }
  // Planes that are wrong of each field, until a step changes nothing of them.
  std::vector<std::size_t> lost(fields, 0);
  const auto of_row = [&](int row, const std::vector<std::size_t>& of) {
    std::size_t most = 0;
    for (int f = 0; f < system_.field_count(); ++f) {
      const std::size_t own = of[static_cast<std::size_t>(f)];
      const bool outer = after ? follows(row, f) : precedes(row, f);
      most = std::max({most, local(row, f) || across(row, f) ? own : 0, outer ? own + 1 : 0});
    }
    return most;
  };
  for (std::vector<std::size_t> before(fields, 1); before != lost;) {
    before = lost;
    const auto lose = [&](int field, std::size_t planes) {
      const auto f = static_cast<std::size_t>(field);
      halo.planes = std::max(halo.planes, renewed[f] ? planes : 0);
      lost[f] = renewed[f] ? 0 : planes;
    };
    for (const Kick& kick : kicks_) {
      lose(kick.column, std::max(before[static_cast<std::size_t>(kick.column)], of_row(kick.row, before)));
    }
    for (const LocalSolve& solve : solves_) {
      const std::size_t own = solve.rate != 0.0 ? before[static_cast<std::size_t>(solve.field)] : 0;
      lost[static_cast<std::size_t>(solve.field)] = own;
      lose(solve.field, std::max(own, of_row(solve.row, lost)));
    }
    halo.lost = *std::ranges::max_element(lost);
  }
  return halo;
}

bool EulerBoxMap::is_renewed(int field) const {
  return std::ranges::find(halo_.renewed, field) != halo_.renewed.end();
}

void EulerBoxMap::renew(int field, grids::FieldSet& fields) const {
  if (is_renewed(field)) {
    grids::refresh_ghosts(fields, std::span(&field, 1), halo_.planes);
  }
}

bool EulerBoxMap::local(int row, int field) const {
  if (rate_of(row, field) != 0.0 || system_.constant_hessian()(row, field) != 0.0) {
    return true;
  }
  return varying_entry(row, field) >= 0;
}

bool EulerBoxMap::follows(int row, int field) const {
  return std::ranges::any_of(system_.structure().K_plus,
                             [&](const Eigen::MatrixXd& plus) { return plus(row, field) != 0.0; });
}

/// Where S''(row, field) is in varying_hessian(); -1 if it is constant.
int EulerBoxMap::varying_entry(int row, int field) const {
  const auto& varying = system_.varying_hessian();
  const auto found = std::ranges::find_if(varying, [&](const HessianEntry& e) {
    return (e.row == row && e.column == field) || (e.row == field && e.column == row);
  });
  return found == varying.end() ? -1 : static_cast<int>(found - varying.begin());
}

/// What a step needs of S, and no more: functions in it are most of the cost of an explicit step.
void EulerBoxMap::compile() {
  using formula::Expression;
  const std::vector<Expression> z(system_.variables().begin(), system_.variables().begin() + system_.field_count());
  const std::vector<Expression> gradient = formula::gradient(system_.expression(), z);
  const auto add = [&](int row, std::optional<int> given) {
    std::vector<Expression> outputs{gradient[static_cast<std::size_t>(row)]};
    if (given) {
      outputs.push_back(formula::gradient(outputs.front(), std::array{z[static_cast<std::size_t>(*given)]}).front());
    }
    codes_.push_back({formula::BatchEvaluator(formula::Bytecode(outputs, system_.variables())), outputs.size()});
    return codes_.size() - 1;
  };
  for (Kick& kick : kicks_) {
    kick.code = add(kick.row, std::nullopt);
  }
  for (auto* solves : {&start_solves_, &solves_}) {
    for (LocalSolve& solve : *solves) {
      solve.is_affine = varying_entry(solve.row, solve.field) < 0;
      solve.code = add(solve.row, solve.is_affine ? std::nullopt : std::optional(solve.field));
    }
  }
}

/// row_ = ∇S of one row, and S'' with the field that it gives into derivative_ if that varies.
void EulerBoxMap::evaluate_row(std::size_t code, const grids::FieldSet& fields) {
  double* const out[] = {row_.field(0).data(), derivative_.field(0).data()};
  codes_[code].evaluate(grid_.size(), places_.after(fields.pointers(), inputs_),
                        std::span(out).first(codes_[code].outputs));
  ++evaluations_;
}

void EulerBoxMap::evaluate(const grids::FieldSet& fields) {
  evaluate_(grid_.size(), places_.after(fields.pointers(), inputs_), outputs_.pointers());
  ++evaluations_;
}

/// row_ = S''u of one row, S'' as last evaluated.
void EulerBoxMap::row_of_hessian(int row, const grids::FieldSet& u) {
  row_.fill(0.0);
  for (int f = 0; f < system_.field_count(); ++f) {
    if (const int entry = varying_entry(row, f); entry >= 0) {
      add_product(1.0, outputs_.field(1 + system_.field_count() + entry), u.field(f), row_.field(0));
    } else if (const double constant = system_.constant_hessian()(row, f); constant != 0.0) {
      add(constant, u.field(f), row_.field(0));
    }
  }
}

/// row_ += -K₊δ⁺z + K₊ᵀδ⁻z of one row.
void EulerBoxMap::add_differences(int row, const grids::FieldSet& fields) {
  const auto out = row_.field(0);
  const auto scratch = scratch_.field(0);
  for (int a = 0; a < grid_.dimensions(); ++a) {
    const auto& plus = system_.structure().K_plus[static_cast<std::size_t>(a)];
    for (int f = 0; f < system_.field_count(); ++f) {
      if (plus(row, f) != 0.0) {
        grids::apply(grid_, difference_along(a), fields.field(f).data(), scratch.data());
        add(-plus(row, f), scratch, out);
      }
      if (plus(f, row) != 0.0) {  // δ⁻ is minus the adjoint of δ⁺
        grids::apply_adjoint(grid_, difference_along(a), fields.field(f).data(), scratch.data());
        add(-plus(f, row), scratch, out);
      }
    }
  }
}

/// M₊[row, column] (z_{k+1} - z_k)_column = h row_.
void EulerBoxMap::kick(const Kick& kick, double h, grids::FieldSet& fields, std::size_t begin, std::size_t end) const {
  add(h / kick.value, row_.field(0).subspan(begin, end - begin), fields.field(kick.column).subspan(begin, end - begin));
}

/// The same at all nodes, ghosts renewed.
void EulerBoxMap::kick_and_renew(const Kick& entry, double h, grids::FieldSet& fields) const {
  if (is_renewed(entry.column)) {
    grids::compute_and_refresh(fields, std::span(&entry.column, 1), halo_.planes,
                               [&](std::size_t begin, std::size_t end) { kick(entry, h, fields, begin, end); });
  } else {
    kick(entry, h, fields, 0, grid_.size());
  }
}

/// One correction at every node to row_ + rate (z - z_before)/h = 0, in the one field, and into row_.
/// \param varying S'' of the row with the field; null where it is constant
void EulerBoxMap::correct(const LocalSolve& solve, const double* varying, double h, const grids::FieldSet& before,
                          grids::FieldSet& fields) {
  const double constant =
      (varying == nullptr ? system_.constant_hessian()(solve.row, solve.field) : 0.0) + solve.rate / h;
  const auto row = row_.field(0);
  const auto values = fields.field(solve.field);
  const auto old = before.field(solve.field);
  const double rate = solve.rate / h;
  if (varying == nullptr) {
    const double inverse = 1.0 / constant;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double correction = inverse * (row[i] + rate * (values[i] - old[i]));
      values[i] -= correction;
      row[i] = correction;
    }
    return;
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double correction = (row[i] + rate * (values[i] - old[i])) / (constant + varying[i]);
    values[i] -= correction;
    row[i] = correction;
  }
}

/// Newton's method at every node for the row of a level, in the one field. Where S is quadratic in that, the first
/// correction is the solution.
Status EulerBoxMap::run(const LocalSolve& solve, double h, const grids::FieldSet& before, grids::FieldSet& fields) {
  const double* const varying = solve.is_affine ? nullptr : std::as_const(derivative_).field(0).data();
  double last = std::numeric_limits<double>::infinity();
  for (int iteration = 0; iteration < most_map_iterations; ++iteration) {
    evaluate_row(solve.code, fields);
    add_differences(solve.row, fields);
    correct(solve, varying, h, before, fields);
    clear_ghosts(row_.field(0));
    const std::array<std::span<const double>, 2> both = {row_.field(0), fields.field(solve.field)};
    std::array<double, 2> sizes{};
    grids::max_abs(both, sizes);
    const auto [change, scale] = sizes;
    if (!std::isfinite(change)) {
      return Status::undefined;
    }
    // A correction of rounding is a residual of rounding, by the derivative that it was divided by.
    if (solve.is_affine || change <= 1e-15 * scale || (change >= 0.5 * last && is_rounding(solve, h, before, fields))) {
      return Status::success;
    }
    last = change;
  }
  return Status::not_converged;
}

/// Whether nothing but rounding is left of the row of a level: of its terms, and of the fields they are made from.
bool EulerBoxMap::is_rounding(const LocalSolve& solve, double h, const grids::FieldSet& before,
                              const grids::FieldSet& fields) {
  evaluate(fields);
  std::ranges::copy(outputs_.field(1 + solve.row), row_.field(0).begin());
  add_differences(solve.row, fields);
  const auto row = row_.field(0);
  const auto values = fields.field(solve.field), old = before.field(solve.field);
  add(solve.rate / h, values, row);
  add(-solve.rate / h, old, row);
  clear_ghosts(row);
  const double left = grids::max_abs(std::as_const(row_).field(0));

  double terms = grids::max_abs(std::as_const(outputs_).field(1 + solve.row)) +
                 std::abs(solve.rate / h) * (grids::max_abs(values) + grids::max_abs(old));
  for (int f = 0; f < system_.field_count(); ++f) {
    const int entry = varying_entry(solve.row, f);
    double factor = entry < 0 ? std::abs(system_.constant_hessian()(solve.row, f))
                              : grids::max_abs(std::as_const(outputs_).field(1 + system_.field_count() + entry));
    for (int a = 0; a < grid_.dimensions(); ++a) {
      const auto& plus = system_.structure().K_plus[static_cast<std::size_t>(a)];
      factor += (std::abs(plus(solve.row, f)) + std::abs(plus(f, solve.row))) * 2.0 / grid_.spacing(a);
    }
    terms += factor * grids::max_abs(fields.field(f));
  }
  // A dozen products and sums, half a unit in the last place each, of terms that may be larger than what they add up
  // to.
  constexpr double roundings = 64.0;
  return left <= roundings * std::numeric_limits<double>::epsilon() * terms;
}

LatticeLevel euler_box_level(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& given) {
  EulerBoxMap map(system, grid);
  LatticeLevel level{grids::FieldSet(system.field_count(), grid.size()), {}};
  if (given.size() != system.fields().size()) {
    throw std::invalid_argument(
        fmt::format("initial data for {} fields; the system has {}", given.size(), system.fields().size()));
  }
  for (int f = 0; f < system.field_count(); ++f) {
    const auto& values = given[static_cast<std::size_t>(f)];
    const auto& name = system.fields()[static_cast<std::size_t>(f)];
    if (!values && !system.structure().algebraic[static_cast<std::size_t>(f)]) {
      throw std::invalid_argument(fmt::format("no initial data for {}", name));
    }
    if (values && values->size() != grid.size()) {
      throw std::invalid_argument(
          fmt::format("the initial {} has {} values; the grid has {} nodes", name, values->size(), grid.size()));
    }
    if (values && !all_finite(*values)) {
      throw std::invalid_argument(fmt::format("the initial {} is not finite everywhere", name));
    }
    if (values) {
      std::ranges::copy(*values, level.fields.field(f).begin());
    }
  }
  if (const Status status = map.start(level.fields); status != Status::success) {
    throw std::invalid_argument(
        fmt::format("the constraints of the initial level could not be solved: {}", to_string(status)));
  }
  return level;
}

}  // namespace rubato
