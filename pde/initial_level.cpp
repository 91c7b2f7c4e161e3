#include <rubato/pde/initial_level.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>
#include <stdexcept>
#include <string>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/formula/batch.hpp>
#include <rubato/grids/fourier.hpp>
#include <rubato/grids/lines.hpp>
#include <rubato/grids/reductions.hpp>
#include <rubato/grids/whole.hpp>
#include <rubato/pde/cell_solver.hpp>
#include <rubato/pde/euler_box_map.hpp>
#include <rubato/pde/initial_agreement.hpp>
#include <rubato/pde/initial_sawtooths.hpp>
#include <rubato/pde/kernel_conditions.hpp>
#include <rubato/pde/lattice_scheme.hpp>
#include <rubato/pde/mean_conditions.hpp>
#include <rubato/pde/periodicity.hpp>
#include <rubato/pde/placed_coordinates.hpp>
#include <rubato/pde/row_rounding.hpp>
#include <rubato/pde/shared_slopes.hpp>
#include <rubato/pde/tuning.hpp>
#include <rubato/pde/wall_conditions.hpp>
#include <rubato/solve/small_matrices.hpp>

namespace rubato {

namespace {

using namespace tuning::initial_level;

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;

/// Which fields are computed, by which combinations of rows.
struct Plan {
  std::vector<int> unknowns;
  MatrixXd rows;  ///< d × unknowns
};

void check(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& given) {
  if (given.size() != system.fields().size()) {
    throw std::invalid_argument(
        fmt::format("initial data for {} fields; the system has {}", given.size(), system.fields().size()));
  }
  for (std::size_t f = 0; f < given.size(); ++f) {
    if (!given[f]) {
      continue;
    }
    if (given[f]->size() != grid.size()) {
      throw std::invalid_argument(fmt::format("the initial {} has {} values; the grid has {} nodes", system.fields()[f],
                                              given[f]->size(), grid.size()));
    }
    const auto bad = std::ranges::find_if(*given[f], [](double value) { return !std::isfinite(value); });
    if (bad != given[f]->end()) {
      throw std::invalid_argument(fmt::format("the initial {} is {} at node {}: it has to be finite everywhere",
                                              system.fields()[f], *bad, bad - given[f]->begin()));
    }
  }
}

/// The symbol Σ iκ_a K_a - S'' on a generic wave.
MatrixXcd generic_symbol(const MultisymplecticSystem& system) {
  std::mt19937_64 random(40);
  std::uniform_real_distribution<double> wave(0.5, 1.5);
  MatrixXcd symbol = -generic_hessian(system, random).cast<std::complex<double>>();
  for (int a = 0; a < system.directions(); ++a) {
    symbol += std::complex<double>(0.0, wave(random)) * system.K(a).cast<std::complex<double>>();
  }
  return symbol;
}

Plan make_plan(const MultisymplecticSystem& system, const InitialFields& given) {
  const FieldStructure& structure = system.structure();
  const int d = system.field_count();
  // In the order in which they are rather computed than used: what is not given, algebraic fields before those with an
  // equation of motion, then what is given and has to agree.
  std::vector<int> order;
  for (int turn = 0; turn < 5; ++turn) {
    for (int f = 0; f < d; ++f) {
      const auto i = static_cast<std::size_t>(f);
      const int rank = given[i] ? structure.algebraic[i]   ? 2
                                  : structure.potential[i] ? 3
                                                           : 4
                                : (structure.algebraic[i] ? 0 : 1);
      if (rank == turn && !structure.multiplier[i]) {
        order.push_back(f);
      }
    }
  }
  const MatrixXcd constraints = structure.level_constraints.cast<std::complex<double>>().transpose();
  const MatrixXcd on_wave = solve::product(constraints, generic_symbol(system));
  Plan plan;
  plan.unknowns = independent_rows(on_wave.transpose(), order);
  MatrixXcd square(on_wave.rows(), static_cast<Index>(plan.unknowns.size()));
  for (std::size_t u = 0; u < plan.unknowns.size(); ++u) {
    square.col(static_cast<Index>(u)) = on_wave.col(plan.unknowns[u]);
  }
  std::vector<int> all_rows(static_cast<std::size_t>(square.rows()));
  for (std::size_t r = 0; r < all_rows.size(); ++r) {
    all_rows[r] = static_cast<int>(r);
  }
  const auto rows = independent_rows(square, all_rows);
  plan.rows = MatrixXd(d, static_cast<Index>(rows.size()));
  for (std::size_t r = 0; r < rows.size(); ++r) {
    plan.rows.col(static_cast<Index>(r)) = structure.level_constraints.col(rows[r]);
  }
  std::vector<std::string> missing;
  for (int f = 0; f < d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    if (!given[i] && !structure.multiplier[i] && std::ranges::find(plan.unknowns, f) == plan.unknowns.end()) {
      missing.push_back(system.fields()[i]);
    }
  }
  if (!missing.empty()) {
    throw std::invalid_argument(fmt::format("no initial data for {}, and no constraint determines {} from the others",
                                            fmt::join(missing, ", "), missing.size() == 1 ? "it" : "them"));
  }
  return plan;
}

/// Newton on the discrete constraints.
class ConstraintSolve {
public:
  ConstraintSolve(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
                  const Plan& plan)
      : system_(system),
        grid_(grid),
        plan_(plan),
        sweep_(system, grid, collocation),
        row_rounding_(system, grid),
        size_(static_cast<int>(plan.unknowns.size())),
        lines_(grid.size() / grid.cells(0)),
        residual_(system.field_count(), grid.size()),
        hessian_(static_cast<int>(system.varying_hessian().size()), grid.size()),
        rhs_(size_, grid.size()),
        correction_(size_, grid.size()) {
    const Index d = system.field_count();
    MatrixXd columns = MatrixXd::Zero(d, size_);
    for (int u = 0; u < size_; ++u) {
      columns(plan.unknowns[static_cast<std::size_t>(u)], u) = 1.0;
    }
    const MatrixXd kernel = common_null_space(system, 0.0, plan.rows, columns);
    std::vector<int> order;
    for (int u = 0; u < size_; ++u) {
      order.push_back(u);
    }
    const auto pinned = independent_rows(kernel.cast<std::complex<double>>(), order);
    conditions_.kernel = kernel;
    conditions_.left = common_null_space(system, 0.0, columns, plan.rows);
    conditions_.pins = MatrixXd::Zero(static_cast<Index>(pinned.size()), size_);
    conditions_.columns = MatrixXd(size_, static_cast<Index>(pinned.size()));
    for (std::size_t b = 0; b < pinned.size(); ++b) {
      const int field = plan.unknowns[static_cast<std::size_t>(pinned[b])];
      conditions_.pins(static_cast<Index>(b), pinned[b]) = 1.0;
      conditions_.columns.col(static_cast<Index>(b)) = solve::product(plan.rows.transpose(), system.K(0).col(field));
      pinned_.push_back(field);
    }
    const auto restricted = [&](const MatrixXd& matrix) {
      return solve::product(solve::product(plan.rows.transpose(), matrix), columns);
    };
    matrix_.mean = restricted(-system.constant_hessian());
    for (int a = 0; a < system.directions(); ++a) {
      matrix_.difference.push_back(restricted(system.K(a)));
    }
    for (std::size_t e = 0; e < system.varying_hessian().size(); ++e) {
      const auto [row, column] = system.varying_hessian()[e];
      add_entries(row, column, hessian_.field(static_cast<int>(e)).data());
      if (row != column) {
        add_entries(column, row, hessian_.field(static_cast<int>(e)).data());
      }
    }
    if (grid.has_walls()) {
      close();
    }
    solver_ = make_cell_solver(grid, collocation, size_, conditions_.count(), newton_tolerance);
    mean_slopes_.resize(static_cast<std::size_t>(conditions_.count()) * lines_);
  }

  /// Of the constraints, as combinations of the equation's rows.
  [[nodiscard]] MatrixXd left_kernel() const { return solve::product(plan_.rows, conditions_.left); }

  [[nodiscard]] Status run(LatticeLevel& level) {
    for (const auto& [field, node] : held_) {
      level.fields.field(field)[node] = 0.0;
    }
    const Status status = iterate(level);
    for (const auto& [field, node] : held_) {
      level.fields.field(field)[node] = 0.0;
    }
    for (const int field : open_) {
      smooth_sawtooth(level.fields.field(field));
    }
    return status;
  }

private:
  /// Between walls, the last rows: a wall holds a field at 0 or, where none does, it is smooth (smooth_sawtooth()).
  /// What holds at both ends by one of them is the other's where the data meet the walls.
  void close() {
    const WallConditions walls(system_, grid_);
    matrix_.last_left = matrix_.last_right = MatrixXd::Zero(size_, size_);
    for (int u = 0; u < size_; ++u) {
      const int field = plan_.unknowns[static_cast<std::size_t>(u)];
      const auto holds = [field](const WallConditions::Held& held) { return held.first == field; };
      const auto first = std::ranges::find_if(walls.held(), holds);
      if (first == walls.held().end()) {
        open_.push_back(field);
      }
      const bool at_right = first != walls.held().end() && first->second != 0;
      (at_right ? matrix_.last_left : matrix_.last_right)(u, u) = 1.0;
      std::ranges::copy_if(walls.held(), std::back_inserter(held_), holds);
    }
    if (!matrix_.difference.front().isZero(0.0) || conditions_.count() > 0) {
      throw SchemeRefusal(
          "a constraint of this equation differentiates a field without an equation of motion, and box cannot close it "
          "at walls: write lagrangian = \"fourier\" or \"splitting\", or leave left and right out");
    }
  }

  [[nodiscard]] Status iterate(LatticeLevel& level) {
    const std::span<double> y = mean_slopes_;
    RowRounding::Sizes last, first{};
    last.fill(std::numeric_limits<double>::infinity());
    bool stalled = false;
    for (int iteration = 0; iteration < most_level_iterations; ++iteration) {
      const grids::FieldSet& fields = level.fields;
      const SweepResult result =
          sweep_(fields.pointers(), level.slopes, {}, 0.0, residual_.pointers(), hessian_.pointers());
      if (!result.finite) {
        return Status::undefined;
      }
      for (int u = 0; u < size_; ++u) {
        combine_rows(u);
      }
      const grids::FieldSet& rhs = rhs_;
      bool is_nothing = true;
      for (int u = 0; u < size_; ++u) {
        const double size = grids::max_abs(rhs.field(u));
        double& at_first = first[static_cast<std::size_t>(u)];
        at_first = iteration == 0 ? size : at_first;
        is_nothing = is_nothing && size <= 1e-14 * at_first;
      }
      if (stalled && is_rounding(level)) {
        return Status::success;
      }
      const Status status = solver_->solve(matrix_, conditions_, rhs.pointers(), correction_.pointers(), y);
      if (status != Status::success) {
        // Where the solution is 0 and the start was not, what is left may be rounding that no solver makes smaller.
        return is_nothing || is_rounding(level) ? Status::success : status;
      }
      bool is_unchanged = true;
      stalled = true;
      if (!solver_->finds_ghosts()) {
        grids::refresh_ghosts(correction_);
      }
      for (int u = 0; u < size_; ++u) {
        const auto values = level.fields.field(plan_.unknowns[static_cast<std::size_t>(u)]);
        const auto correction = correction_.field(u);
        for (std::size_t i = 0; i < values.size(); ++i) {
          values[i] += correction[i];
        }
        const double change = grids::max_abs(correction);
        is_unchanged = is_unchanged && change <= rounding_correction * grids::max_abs(values);
        stalled = stalled && (change == 0.0 || change >= stall * last[static_cast<std::size_t>(u)]);
        last[static_cast<std::size_t>(u)] = change;
      }
      for (std::size_t b = 0; b < pinned_.size(); ++b) {
        auto& slope = level.slopes.of_field[static_cast<std::size_t>(pinned_[b])];
        slope.resize(lines_);
        for (std::size_t line = 0; line < lines_; ++line) {
          slope[line] += y[b * lines_ + line];
        }
      }
      if (is_unchanged) {
        return Status::success;
      }
    }
    return Status::not_converged;
  }

  /// True if rounding errors explain what is left of the constraints.
  [[nodiscard]] bool is_rounding(const LatticeLevel& level) {
    const RowRounding::Sizes bounds = row_rounding_.of_constraints(level, grid_, hessian_);
    for (int u = 0; u < size_; ++u) {
      double bound = 0.0;
      for (int row = 0; row < system_.field_count(); ++row) {
        bound += std::abs(plan_.rows(row, u)) * bounds[static_cast<std::size_t>(row)];
      }
      if (!(grids::max_abs(std::as_const(rhs_).field(u)) <= solved * bound)) {
        return false;
      }
    }
    return true;
  }

  void add_entries(int row, int column, const double* values) {
    const auto unknown = std::ranges::find(plan_.unknowns, column);
    if (unknown == plan_.unknowns.end()) {
      return;
    }
    for (int r = 0; r < size_; ++r) {
      if (plan_.rows(row, r) != 0.0) {
        matrix_.entries.push_back({r, static_cast<int>(unknown - plan_.unknowns.begin()), -plan_.rows(row, r), values});
      }
    }
  }

  void combine_rows(int u) {
    const auto out = rhs_.field(u);
    std::ranges::fill(out, 0.0);
    for (int r = 0; r < system_.field_count(); ++r) {
      const double factor = plan_.rows(r, u);
      if (factor != 0.0) {
        const auto in = residual_.field(r);
        for (std::size_t i = 0; i < out.size(); ++i) {
          out[i] += factor * in[i];
        }
      }
    }
  }

  const MultisymplecticSystem& system_;
  const grids::Grid& grid_;
  const Plan& plan_;
  CellSweep sweep_;
  RowRounding row_rounding_;
  int size_;
  std::size_t lines_;
  grids::FieldSet residual_, hessian_, rhs_, correction_;
  KernelConditions conditions_;
  std::vector<int> pinned_;
  std::vector<double> mean_slopes_;  ///< the last change of them
  CellMatrix matrix_;
  std::vector<WallConditions::Held> held_;  ///< unknowns that walls hold at 0
  std::vector<int> open_;                   ///< those that none holds
  std::unique_ptr<CellSolver> solver_;
};

/// What of a given field was taken off as a sawtooth, if it was more than truncation error.
std::optional<std::string> sawtooth_caution(const grids::Grid& grid, const std::string& field,
                                            const std::vector<double>& given, std::span<const double> used) {
  const double taken = grids::max_abs_difference(given, used);
  if (taken == 0.0) {
    return std::nullopt;
  }
  const grids::Grid& whole = grids::whole_of(grid);
  double second = 0.0;
  for (int a = 0; a < grid.dimensions(); ++a) {
    std::vector<double> line(whole.cells(a));
    grids::for_each_line(grid, a, given, [&](const double* values, const grids::Line& at, std::size_t) {
      at.read(values, line);
      for (std::size_t i = 0, n = line.size(); i < n; ++i) {
        second = std::max(second, std::abs(line[(i + n - 1) % n] - 2.0 * line[i] + line[(i + 1) % n]));
      }
    });
  }
  if (const grids::Slab* const slab = grids::Slab::of(grid)) {
    second = slab->largest_over_ranks(second);
  }
  // Half of the roughest place would be the sawtooth, whose second difference is four times its amplitude.
  if (4.0 * taken <= 0.5 * second) {
    return std::nullopt;
  }
  std::vector<std::string> cells;
  for (const grids::Axis& axis : whole.axes()) {
    if (axis.cells % 2 == 0) {
      cells.push_back(fmt::format("{} = {}", axis.name, grids::good_odd_count(axis.cells)));
    }
  }
  return fmt::format(
      "the initial {} holds the sawtooth (-1)^i with an amplitude of {:.3g}, whose derivative on an even number of "
      "cells is 0, so that the potential behind {} cannot have it: it was taken out. Give smoother data, or an odd "
      "number of cells ({})",
      field, taken, field, fmt::join(cells, ", "));
}

/// A medium that does not repeat with the period, as far as the level meets it: seen in ∂S/∂z of the fields that vary
/// in space, at fields that are continued as they are.
void add_medium_cautions(const MultisymplecticSystem& system, const grids::Grid& grid, const LatticeLevel& level,
                         std::vector<std::string>& cautions) {
  const PlacedCoordinates places(system, grid, Within::node);
  // Data that are broken there have been named, at rank 0.
  if (places.count() == 0 || !grids::agreed(grid, cautions.empty())) {
    return;
  }
  grids::FieldSet gradient(1 + system.field_count(), grid.size());
  formula::BatchEvaluator(system.gradient_code())(grid.size(), places.after(level.fields.pointers()),
                                                  gradient.pointers());
  for (int f = 0; f < system.field_count(); ++f) {
    const auto row = std::as_const(gradient).field(1 + f);
    if (!system.varies_in_space(f) || !std::isfinite(grids::max_abs(row))) {
      continue;
    }
    const auto broken = find_seam_break(grid, row);  // reported to rank 0
    if (broken) {
      const std::string what = fmt::format("dS/d{}", system.fields()[static_cast<std::size_t>(f)]);
      cautions.push_back(
          fmt::format("the medium is not periodic: {}, and the solution meets an interface there",
                      describe_break(*broken, grids::whole_of(grid), broken->jump ? what : "the slope of " + what)));
    }
    if (grids::agreed(grid, broken.has_value())) {
      return;
    }
  }
}

/// What the user should know about the data. `computed`: the fields that the constraints gave. Of data that go on in
/// mirrors the seams are those of the walls, which meet_walls() looks at.
std::vector<std::string> find_cautions(const MultisymplecticSystem& system, const grids::Grid& grid,
                                       const InitialFields& given, const std::vector<int>& computed,
                                       const LatticeLevel& level) {
  std::vector<std::string> cautions;
  const bool has_mirrors = std::ranges::any_of(
      grids::whole_of(grid).axes(), [](const grids::Axis& axis) { return axis.mirrored > 0 || axis.ghosts > 0; });
  for (int f = 0; f < system.field_count(); ++f) {
    const auto i = static_cast<std::size_t>(f);
    const std::string& name = system.fields()[i];
    if (!given[i] || std::ranges::find(computed, f) != computed.end()) {
      continue;
    }
    if (system.structure().multiplier[i]) {
      cautions.push_back(fmt::format(
          "the initial {0} is not used: {0} exists in the middle of steps only, where the step determines it; leave it "
          "out",
          name));
      continue;
    }
    if (has_mirrors) {
      continue;
    }
    if (const auto broken = find_seam_break(grid, *given[i])) {
      cautions.push_back(describe(*broken, grids::whole_of(grid), name));
    }
    if (auto caution = sawtooth_caution(grid, name, *given[i], level.fields.field(f))) {
      cautions.push_back(std::move(*caution));
    }
  }
  if (!has_mirrors) {
    add_medium_cautions(system, grid, level, cautions);
  }
  return cautions;
}

InitialLevel level_of_constraints(const MultisymplecticSystem& system, const grids::Grid& grid,
                                  const InitialFields& given, Collocation collocation) {
  if (collocation == Collocation::corners) {
    LatticeLevel level = euler_box_level(system, grid, given);
    std::vector<int> computed;
    for (int f = 0; f < system.field_count(); ++f) {
      if (system.structure().algebraic[static_cast<std::size_t>(f)]) {
        computed.push_back(f);
        if (given[static_cast<std::size_t>(f)]) {
          check_agreement(system, grid, collocation, f, given, level, system.structure().level_constraints);
        }
      }
    }
    auto cautions = find_cautions(system, grid, given, computed, level);
    return {std::move(level), std::move(cautions)};
  }
  check(system, grid, given);
  const Plan plan = make_plan(system, given);
  const int d = system.field_count();
  LatticeLevel level{grids::FieldSet(d, grid.size()), {}};
  level.slopes.of_field.resize(static_cast<std::size_t>(d));
  for (int f = 0; f < d; ++f) {
    const auto i = static_cast<std::size_t>(f);
    const bool unknown = std::ranges::find(plan.unknowns, f) != plan.unknowns.end();
    if (given[i] && !system.structure().multiplier[i] && !(unknown && system.structure().potential[i])) {
      std::ranges::copy(*given[i], level.fields.field(f).begin());
    }
  }
  if (grid.has_walls()) {
    remove_wall_sawtooths(system, grid, level.fields);
  }
  if (plan.unknowns.empty()) {
    auto cautions = find_cautions(system, grid, given, {}, level);
    return {std::move(level), std::move(cautions)};
  }
  ConstraintSolve solve(system, grid, collocation, plan);
  remove_sawtooths(system, grid, collocation, plan.unknowns, solve.left_kernel(), level);
  if (const Status status = solve.run(level); status != Status::success) {
    std::vector<std::string> names;
    for (const int f : plan.unknowns) {
      names.push_back(system.fields()[static_cast<std::size_t>(f)]);
    }
    throw std::invalid_argument(fmt::format("the constraints of the initial level could not be solved for {}: {}",
                                            fmt::join(names, ", "), to_string(status)));
  }
  for (const int f : plan.unknowns) {
    if (given[static_cast<std::size_t>(f)]) {
      check_agreement(system, grid, collocation, f, given, level, plan.rows);
    }
  }
  auto cautions = find_cautions(system, grid, given, plan.unknowns, level);
  return {std::move(level), std::move(cautions)};
}

/// Those fields alone, without values.
InitialFields with_equation_of_motion(const MultisymplecticSystem& system) {
  InitialFields given(system.fields().size());
  for (std::size_t f = 0; f < given.size(); ++f) {
    if (!system.structure().algebraic[f]) {
      given[f].emplace();
    }
  }
  return given;
}

class SolvedConstraints final : public ConstrainedFields {
public:
  SolvedConstraints(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation, Plan plan)
      : system_(system),
        grid_(grid),
        collocation_(collocation),
        plan_(std::move(plan)),
        solve_(system_, grid_, collocation, plan_),
        left_(solve_.left_kernel()) {}

  [[nodiscard]] Status find(LatticeLevel& level) override {
    if (left_.cols() > 0) {
      remove_sawtooths(system_, grid_, collocation_, plan_.unknowns, left_, level);
    }
    return solve_.run(level);
  }

private:
  MultisymplecticSystem system_;
  grids::Grid grid_;
  Collocation collocation_;
  Plan plan_;
  ConstraintSolve solve_;
  MatrixXd left_;
};

class CornerConstraints final : public ConstrainedFields {
public:
  CornerConstraints(const MultisymplecticSystem& system, const grids::Grid& grid) : map_(system, grid) {}
  [[nodiscard]] Status find(LatticeLevel& level) override { return map_.start(level.fields); }

private:
  EulerBoxMap map_;
};

class NoConstraints final : public ConstrainedFields {
public:
  [[nodiscard]] Status find(LatticeLevel&) override { return Status::success; }
};

}  // namespace

std::unique_ptr<ConstrainedFields> make_constrained_fields(const MultisymplecticSystem& system, const grids::Grid& grid,
                                                           Collocation collocation) {
  if (collocation == Collocation::corners) {
    return std::make_unique<CornerConstraints>(system, grid);
  }
  Plan plan = make_plan(system, with_equation_of_motion(system));
  for (const int f : plan.unknowns) {
    if (!system.structure().algebraic[static_cast<std::size_t>(f)]) {
      throw std::invalid_argument(fmt::format("{} has an equation of motion, and constraints give it, too",
                                              system.fields()[static_cast<std::size_t>(f)]));
    }
  }
  if (plan.unknowns.empty()) {
    return std::make_unique<NoConstraints>();
  }
  return std::make_unique<SolvedConstraints>(system, grid, collocation, std::move(plan));
}

InitialLevel prepare_initial_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                   const InitialFields& given, Collocation collocation) {
  InitialLevel level = level_of_constraints(system, grid, given, collocation);
  MeanConditions(system).check(grid, given, level.level);
  return level;
}

bool determines_no_given_field(const MultisymplecticSystem& system, const std::vector<bool>& given) {
  InitialFields fields(given.size());
  for (std::size_t f = 0; f < given.size(); ++f) {
    if (given[f]) {
      fields[f].emplace();
    }
  }
  try {
    const Plan plan = make_plan(system, fields);
    return !MeanConditions(system).any(given) &&
           std::ranges::none_of(plan.unknowns, [&](int f) { return given[static_cast<std::size_t>(f)]; });
  } catch (const std::invalid_argument&) {
    return false;  // fields are missing
  }
}

InitialLevel prepare_determined_level(const MultisymplecticSystem& system, const grids::Grid& grid,
                                      const InitialFields& given, const std::function<void(LatticeLevel&)>& determine) {
  check(system, grid, given);
  LatticeLevel level{grids::FieldSet(system.field_count(), grid.size()), {}};
  level.slopes.of_field.resize(given.size());
  std::vector<int> computed;
  for (int f = 0; f < system.field_count(); ++f) {
    const auto i = static_cast<std::size_t>(f);
    if (system.structure().algebraic[i]) {
      computed.push_back(f);
    } else if (given[i]) {
      std::ranges::copy(*given[i], level.fields.field(f).begin());
    } else {
      throw std::invalid_argument(fmt::format("no initial data for {}", system.fields()[i]));
    }
  }
  determine(level);
  auto cautions = find_cautions(system, grid, given, computed, level);
  return {std::move(level), std::move(cautions)};
}

bool follows_from_others(const MultisymplecticSystem& system, int field) {
  return system.structure().potential[static_cast<std::size_t>(field)] &&
         std::ranges::count(make_plan(system, with_equation_of_motion(system)).unknowns, field) > 0;
}

LatticeLevel initial_level(const MultisymplecticSystem& system, const grids::Grid& grid, const InitialFields& given,
                           Collocation collocation) {
  return prepare_initial_level(system, grid, given, collocation).level;
}

}  // namespace rubato
