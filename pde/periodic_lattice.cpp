#include <rubato/pde/periodic_lattice.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

namespace rubato {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

using SparseEntries = std::vector<Eigen::Triplet<double>>;

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace

PeriodicLattice::PeriodicLattice(const MultisymplecticSystem& system, const grids::Grid& grid,
                                 std::unique_ptr<PeriodicStep> step, Targets targets, const PeriodOfLattice& guess)
    : system_(system),
      grid_(grid),
      step_(std::move(step)),
      targets_(targets),
      slopes_(guess.slopes),
      place_(system, grid),
      rows_of_step_(system.field_count(), grid.size()),
      scales_(VectorXd::Zero(system.field_count())),
      row_scales_(VectorXd::Ones(system.field_count())),
      period_scale_(guess.period),
      energies_(guess.steps(), 0.0),
      steps_(guess.steps()) {
  if (guess.levels.empty()) {
    throw std::invalid_argument("a guess has at least one level");
  }
  for (int f = 0; f < system.field_count(); ++f) {
    if (system.structure().potential[static_cast<std::size_t>(f)]) {
      throw std::invalid_argument(fmt::format(
          "S does not name {}, and steps leave a constant of it free: state the equation by fields that S names",
          system.fields()[static_cast<std::size_t>(f)]));
    }
  }
  find_scales(guess);
}

void PeriodicLattice::find_scales(const PeriodOfLattice& guess) {
  const auto or_one = [](double scale) { return scale > 0.0 ? scale : 1.0; };
  for (const grids::FieldSet& level : guess.levels) {
    for (int f = 0; f < system_.field_count(); ++f) {
      for (const double value : level.field(f)) {
        scales_[f] = std::max(scales_[f], std::abs(value));
      }
    }
  }
  scales_ = scales_.unaryExpr(or_one);
  // The size of a row's terms: what the unknowns make of it, each by its scale.
  VectorXd residual;
  if (evaluate(pack(guess), residual, true) != Status::success) {
    return;
  }
  VectorXd sizes = VectorXd::Zero(system_.field_count());
  for (const Step& step : steps_) {
    const VectorXd sums = step.before.cwiseAbs() * VectorXd::Ones(step.before.cols()) +
                          step.after.cwiseAbs() * VectorXd::Ones(step.after.cols());
    for (int r = 0; r < system_.field_count(); ++r) {
      for (Index i = 0; i < nodes(); ++i) {
        sizes[r] = std::max(sizes[r], sums[place_(r, i)]);
      }
    }
  }
  row_scales_ = sizes.unaryExpr(or_one);
  const auto smaller = [](double a, double b) { return std::abs(a) < std::abs(b); };
  energy_scale_ = or_one(std::abs(*std::ranges::max_element(energies_, smaller)));
}

VectorXd PeriodicLattice::pack(const PeriodOfLattice& orbit) const {
  VectorXd u(period_place() + 1);
  for (std::size_t k = 0; k < steps_.size(); ++k) {
    for (int f = 0; f < system_.field_count(); ++f) {
      const std::span<const double> field = orbit.levels[k].field(f);
      for (Index i = 0; i < nodes(); ++i) {
        u[static_cast<Index>(k) * level_size() + place_(f, i)] = field[static_cast<std::size_t>(i)] / scales_[f];
      }
    }
  }
  u[period_place()] = orbit.period / period_scale_;
  return u;
}

PeriodOfLattice PeriodicLattice::unpack(const VectorXd& u) const {
  PeriodOfLattice orbit{.levels = std::vector(steps_.size(), grids::FieldSet(system_.field_count(), grid_.size())),
                        .slopes = slopes_,
                        .period = u[period_place()] * period_scale_};
  for (std::size_t k = 0; k < steps_.size(); ++k) {
    for (int f = 0; f < system_.field_count(); ++f) {
      const std::span<double> field = orbit.levels[k].field(f);
      for (Index i = 0; i < nodes(); ++i) {
        field[static_cast<std::size_t>(i)] = u[static_cast<Index>(k) * level_size() + place_(f, i)] * scales_[f];
      }
    }
  }
  return orbit;
}

Status PeriodicLattice::evaluate(const VectorXd& u, VectorXd& residual, bool with_derivatives) {
  const PeriodOfLattice orbit = unpack(u);
  const double h = orbit.step();
  failed_ = 0;
  if (!(h * period_scale_ > 0.0)) {
    return Status::singular;
  }
  residual.setZero(rows());
  for (std::size_t k = 0; k < steps_.size(); ++k) {
    if (!step_->evaluate(orbit.levels[k], orbit.levels[(k + 1) % steps_.size()], h, slopes_, rows_of_step_,
                         energies_[k])) {
      failed_ = k;
      return Status::undefined;
    }
    for (int r = 0; r < system_.field_count(); ++r) {
      const std::span<const double> rows = std::as_const(rows_of_step_).field(r);
      for (Index i = 0; i < nodes(); ++i) {
        residual[static_cast<Index>(k) * level_size() + place_(r, i)] =
            rows[static_cast<std::size_t>(i)] / row_scales_[r];
      }
    }
    if (with_derivatives) {
      step_->linearise(scales_, steps_[k]);
      scale(steps_[k]);
      closing_.resize(0, 0);
    }
  }
  Index row = period_place();
  if (targets_.period) {
    residual[row++] = (orbit.period - *targets_.period) / period_scale_;
  }
  if (targets_.energy) {
    residual[row] = (mean_of(energies_) - *targets_.energy) / energy_scale_;
  }
  return residual.allFinite() ? Status::success : Status::undefined;
}

/// Derivatives of scaled rows by scaled unknowns; by_h becomes that by T, ∂h/∂T = 1/N.
void PeriodicLattice::scale(Step& step) const {
  VectorXd of_unknowns(level_size()), of_rows(level_size());
  for (int f = 0; f < system_.field_count(); ++f) {
    for (Index i = 0; i < nodes(); ++i) {
      of_unknowns[place_(f, i)] = scales_[f];
      of_rows[place_(f, i)] = 1.0 / row_scales_[f];
    }
  }
  const double count = static_cast<double>(steps_.size()), by_period = period_scale_ / count,
               of_energy = 1.0 / (energy_scale_ * count);
  step.before = of_rows.asDiagonal() * step.before * of_unknowns.head(moving()).asDiagonal();
  step.after = of_rows.asDiagonal() * step.after * of_unknowns.asDiagonal();
  step.by_h = by_period * of_rows.cwiseProduct(step.by_h);
  step.energy_before = of_energy * of_unknowns.head(moving()).cwiseProduct(step.energy_before);
  step.energy_after = of_energy * of_unknowns.cwiseProduct(step.energy_after);
  step.energy_by_h *= of_energy * by_period;
}

/// The steps' maps, one after the other. \return Status::ill_conditioned where a step is singular
Status PeriodicLattice::compose() {
  const Index m = moving(), targets = rows() - period_place();
  MatrixXd levels = MatrixXd::Identity(m, m + 1);  // x_k by x_0 and T
  Eigen::RowVectorXd energy = Eigen::RowVectorXd::Zero(m + 1);
  for (Step& step : steps_) {
    if (step.factors.factor(step.after) != Status::success) {
      return Status::ill_conditioned;
    }
    MatrixXd right = step.before * levels;
    right.col(m) += step.by_h;
    const MatrixXd next = -step.factors.solve(right);
    energy += step.energy_before.transpose() * levels + step.energy_after.transpose() * next;
    energy[m] += step.energy_by_h;
    levels = next.topRows(m);
  }
  if (!levels.allFinite()) {
    return Status::ill_conditioned;
  }
  levels.leftCols(m) -= MatrixXd::Identity(m, m);
  closing_.setZero(m + targets, m + 1);
  closing_.topRows(m) = levels;
  if (targets_.period) {
    closing_(m, m) = 1.0;
  }
  if (targets_.energy) {
    closing_.row(closing_.rows() - 1) = energy;
  }
  return Status::success;
}

Status PeriodicLattice::factor(double damping) {
  if (closing_.size() == 0) {
    if (const Status status = compose(); status != Status::success) {
      return status;
    }
  }
  return closing_factors_.factor(closing_.sparseView(), damping);
}

void PeriodicLattice::follow(const VectorXd& r, VectorXd& x, VectorXd& last, double& energy) const {
  last = x.head(moving());
  energy = 0.0;
  for (std::size_t k = 0; k < steps_.size(); ++k) {
    const Step& step = steps_[k];
    const Index first = static_cast<Index>(k) * level_size();
    const VectorXd right = r.segment(first, level_size()) + step.before * last + x[period_place()] * step.by_h;
    const VectorXd next = -step.factors.solve(right);
    x.segment(first, moving()) = last;
    x.segment(first + moving(), level_size() - moving()) = next.tail(level_size() - moving());
    energy += step.energy_before.dot(last) + step.energy_after.dot(next) + x[period_place()] * step.energy_by_h;
    last = next.head(moving());
  }
}

Status PeriodicLattice::solve(const VectorXd& r, VectorXd& x) {
  const Index m = moving(), targets = rows() - period_place();
  x.setZero(period_place() + 1);
  VectorXd last;
  double energy = 0.0;
  follow(r, x, last, energy);
  VectorXd right(m + targets), start;
  right << last, r.tail(targets);
  if (targets_.energy) {
    right[right.size() - 1] += energy;
  }
  if (const Status status = closing_factors_.solve(right, start); status != Status::success) {
    return status;
  }
  x.head(m) = start.head(m);
  x[period_place()] = start[m];
  follow(r, x, last, energy);
  return x.allFinite() ? Status::success : Status::ill_conditioned;
}

Eigen::SparseMatrix<double> PeriodicLattice::jacobian() const {
  SparseEntries entries;
  const Index energy_row = rows() - 1;
  for (std::size_t k = 0; k < steps_.size(); ++k) {
    const Step& step = steps_[k];
    const Index first = static_cast<Index>(k) * level_size();
    const Index next = static_cast<Index>((k + 1) % steps_.size()) * level_size();
    const auto column_after = [&](Index column) { return column < moving() ? next + column : first + column; };
    const auto add = [&](const Sparse& block, const auto& column_of) {
      for (Index column = 0; column < block.cols(); ++column) {
        for (Sparse::InnerIterator entry(block, column); entry; ++entry) {
          entries.emplace_back(first + entry.row(), column_of(column), entry.value());
        }
      }
    };
    add(step.before, [&](Index column) { return first + column; });
    add(step.after, column_after);
    for (Index row = 0; row < level_size(); ++row) {
      entries.emplace_back(first + row, period_place(), step.by_h[row]);
    }
    if (targets_.energy) {
      entries.emplace_back(energy_row, period_place(), step.energy_by_h);
    }
    for (Index column = 0; targets_.energy && column < level_size(); ++column) {
      entries.emplace_back(energy_row, column_after(column), step.energy_after[column]);
      if (column < moving()) {
        entries.emplace_back(energy_row, first + column, step.energy_before[column]);
      }
    }
  }
  if (targets_.period) {
    entries.emplace_back(period_place(), period_place(), 1.0);
  }
  Sparse matrix(rows(), period_place() + 1);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

std::string PeriodicLattice::describe(Index row) const {
  if (row >= period_place()) {
    return row == period_place() && targets_.period ? "the period" : "the energy";
  }
  const Index step = row / level_size(), rest = row % level_size();
  for (int f = 0; f < system_.field_count(); ++f) {
    for (Index i = 0; i < nodes(); ++i) {
      if (place_(f, i) == rest) {
        return fmt::format("the row of {} at {} = {:.6g}, in the step from level {}",
                           system_.fields()[static_cast<std::size_t>(f)], grid_.axis(0).name,
                           grid_.axis(0).node(static_cast<std::size_t>(i)), step);
      }
    }
  }
  return "";
}

std::string PeriodicLattice::describe_failure() const {
  return fmt::format("the step from level {}", failed_);
}

PeriodOfLattice period_by_integrating(LatticeIntegrator& lattice, std::size_t steps) {
  const std::vector<bool>& algebraic = lattice.system().structure().algebraic;
  const double start = lattice.t();
  PeriodOfLattice guess{.levels = {}, .slopes = lattice.level().slopes};
  while (guess.levels.size() < steps) {
    grids::FieldSet level = lattice.level().fields;
    if (lattice.step().status != Status::success) {
      break;
    }
    for (int f = 0; f < level.fields(); ++f) {
      if (!algebraic[static_cast<std::size_t>(f)]) {
        continue;
      }
      const bool at_midpoints = lattice.system().structure().at_midpoints(f);
      const std::span<const double> after = lattice.field(f);
      const std::span<double> middle = level.field(f);
      for (std::size_t i = 0; i < middle.size(); ++i) {
        middle[i] = at_midpoints ? after[i] : 0.5 * (middle[i] + after[i]);
      }
    }
    guess.levels.push_back(std::move(level));
  }
  guess.period = lattice.t() - start;
  return guess;
}

PeriodicLatticeSolution solve_periodic_lattice(const MultisymplecticSystem& system, const grids::Grid& grid,
                                               std::unique_ptr<PeriodicStep> step, const PeriodOfLattice& guess,
                                               const PeriodicLatticeOptions& options) {
  PeriodicLattice equations(system, grid, std::move(step), {.period = options.period, .energy = options.energy}, guess);
  PeriodicLatticeSolution solution;
  VectorXd u = equations.pack(guess);
  solution.search = solve::find_zero(equations, options.tolerance, options.most_iterations, 0, u, solution.history);
  solution.orbit = equations.unpack(u);
  solution.mean_energy = mean_of(equations.energies());
  return solution;
}

}  // namespace rubato
