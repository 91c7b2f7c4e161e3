#include <rubato/pde/periodic_lattice.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include <fmt/format.h>

#include <rubato/grids/fourier.hpp>

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

PeriodicLattice::PeriodicLattice(const MultisymplecticSystem& system, const grids::Grid& grid, Collocation collocation,
                                 Targets targets, const PeriodOfLattice& guess)
    : system_(system),
      grid_(grid),
      targets_(targets),
      slopes_(guess.slopes),
      sweep_(system, grid, collocation),
      point_(system.field_count(), grid.size()),
      delta_(point_),
      residual_(point_),
      hessian_(static_cast<int>(system.varying_hessian().size()), grid.size()),
      scales_(VectorXd::Zero(system.field_count())),
      row_scales_(VectorXd::Ones(system.field_count())),
      period_scale_(guess.period),
      energies_(guess.steps(), 0.0),
      steps_(guess.steps()) {
  if (grid.dimensions() != 1 || grid.has_walls() || collocation == Collocation::corners || collocation.has_elements()) {
    throw std::invalid_argument(
        "periodic orbits are of one periodic dimension, by the box scheme or fourier with one stage");
  }
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
  find_places();
  make_operators(collocation);
  find_scales(guess);
}

void PeriodicLattice::find_places() {
  const std::vector<bool>& algebraic = system_.structure().algebraic;
  const auto count = static_cast<Index>(std::ranges::count(algebraic, true));
  if (system_.structure().kernel.cols() != count) {
    throw std::invalid_argument(
        "a combination of fields has no equation of motion: take other fields, of which it is one");
  }
  evolving_ = fields() - count;
  Index moving = 0, still = evolving_;
  for (const bool is_still : algebraic) {
    places_.push_back(is_still ? still++ : moving++);
  }
}

void PeriodicLattice::make_operators(Collocation collocation) {
  const Index n = nodes();
  mean_.resize(grid_.size());
  difference_.resize(grid_.size());
  if (collocation == Collocation::cells) {
    const double inverse = 1.0 / grid_.spacing(0);
    for (Index i = 0; i < n; ++i) {
      mean_[static_cast<std::size_t>(i)] = {{i, 0.5}, {(i + 1) % n, 0.5}};
      difference_[static_cast<std::size_t>(i)] = {{i, -inverse}, {(i + 1) % n, inverse}};
    }
    return;
  }
  std::vector<double> unit(grid_.size(), 0.0), column(grid_.size());
  unit[0] = 1.0;
  const grids::SpectralDerivative derivative(grid_);
  derivative(0, unit.data(), column.data());
  for (Index i = 0; i < n; ++i) {
    mean_[static_cast<std::size_t>(i)] = {{i, 1.0}};
    for (Index j = 0; j < n; ++j) {
      difference_[static_cast<std::size_t>(i)].push_back({j, column[static_cast<std::size_t>((i - j + n) % n)]});
    }
  }
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
  VectorXd sizes = VectorXd::Zero(fields());
  for (const Step& step : steps_) {
    const VectorXd sums = step.before.cwiseAbs() * VectorXd::Ones(step.before.cols()) +
                          step.after.cwiseAbs() * VectorXd::Ones(step.after.cols());
    for (int r = 0; r < system_.field_count(); ++r) {
      for (Index i = 0; i < nodes(); ++i) {
        sizes[r] = std::max(sizes[r], sums[place(r, i)]);
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
        u[static_cast<Index>(k) * level_size() + place(f, i)] = field[static_cast<std::size_t>(i)] / scales_[f];
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
        field[static_cast<std::size_t>(i)] = u[static_cast<Index>(k) * level_size() + place(f, i)] * scales_[f];
      }
    }
  }
  return orbit;
}

/// z̄, and δ, which is 0 of fields in ker M.
void PeriodicLattice::set_middle(const PeriodOfLattice& orbit, std::size_t step) {
  const grids::FieldSet &before = orbit.levels[step], &after = orbit.levels[(step + 1) % steps_.size()];
  for (int f = 0; f < system_.field_count(); ++f) {
    const std::span<const double> z_0 = before.field(f), z_1 = after.field(f);
    const std::span<double> middle = point_.field(f), delta = delta_.field(f);
    for (std::size_t i = 0; i < middle.size(); ++i) {
      middle[i] = in_kernel(f) ? z_0[i] : 0.5 * (z_0[i] + z_1[i]);
      delta[i] = in_kernel(f) ? 0.0 : z_1[i] - z_0[i];
    }
  }
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
    set_middle(orbit, k);
    const SweepResult result =
        sweep_(std::as_const(point_).pointers(), slopes_, std::as_const(delta_).pointers(), 1.0 / h,
               residual_.pointers(), with_derivatives ? hessian_.pointers() : std::span<double* const>());
    if (!result.finite) {
      failed_ = k;
      return Status::undefined;
    }
    energies_[k] = result.energy;
    for (int r = 0; r < system_.field_count(); ++r) {
      const std::span<const double> minus = std::as_const(residual_).field(r);
      for (Index i = 0; i < nodes(); ++i) {
        residual[static_cast<Index>(k) * level_size() + place(r, i)] =
            -minus[static_cast<std::size_t>(i)] / row_scales_[r];
      }
    }
    if (with_derivatives) {
      keep_derivatives(h, steps_[k]);
      keep_energy(h, steps_[k]);
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

double PeriodicLattice::hessian(int row, int field, std::size_t point) const {
  const auto& varying = system_.varying_hessian();
  for (std::size_t e = 0; e < varying.size(); ++e) {
    if ((varying[e].row == row && varying[e].column == field) ||
        (varying[e].row == field && varying[e].column == row)) {
      return hessian_.field(static_cast<int>(e))[point];
    }
  }
  return system_.constant_hessian()(row, field);
}

/// Of the step in point_ and delta_.
void PeriodicLattice::keep_derivatives(double h, Step& step) const {
  SparseEntries before, after;
  step.by_period = VectorXd::Zero(level_size());
  for (int r = 0; r < system_.field_count(); ++r) {
    for (int f = 0; f < system_.field_count(); ++f) {
      const double M = system_.M()(r, f) / h, K = system_.K(0)(r, f), scale = scales_[f] / row_scales_[r];
      const auto add = [&](Index row, const Entry& entry, double middle, double rate) {
        const double share = in_kernel(f) ? 1.0 : 0.5;
        if (const double value = share * middle + rate; value != 0.0) {
          after.emplace_back(row, place(f, entry.node), entry.value * scale * value);
        }
        if (const double value = share * middle - rate; value != 0.0 && !in_kernel(f)) {
          before.emplace_back(row, place(f, entry.node), entry.value * scale * value);
        }
      };
      for (Index i = 0; i < nodes(); ++i) {
        const auto point = static_cast<std::size_t>(i);
        const Index row = place(r, i);
        double rate = 0.0;  // M A δ/h
        for (const Entry& entry : mean_[point]) {
          add(row, entry, -hessian(r, f, point), M);
          rate += M * entry.value * delta_.field(f)[static_cast<std::size_t>(entry.node)];
        }
        for (const Entry& entry : difference_[point]) {
          add(row, entry, K, 0.0);
        }
        // ∂h/∂T = 1/N, and h N = T
        step.by_period[row] -= rate / (h * static_cast<double>(steps_.size())) * period_scale_ / row_scales_[r];
      }
    }
  }
  step.before.resize(level_size(), moving());
  step.before.setFromTriplets(before.begin(), before.end());
  step.after.resize(level_size(), level_size());
  step.after.setFromTriplets(after.begin(), after.end());
}

/// ∇S - K D z̄ = M A δ/h - R is the first variation of E_k by the middle of the step.
void PeriodicLattice::keep_energy(double h, Step& step) const {
  step.energy_before = VectorXd::Zero(moving());
  step.energy_after = VectorXd::Zero(level_size());
  const double weight = grid_.cell_volume() / (energy_scale_ * static_cast<double>(steps_.size()));
  for (int f = 0; f < system_.field_count(); ++f) {
    for (Index i = 0; i < nodes(); ++i) {
      const auto point = static_cast<std::size_t>(i);
      double force = residual_.field(f)[point];  // -R
      for (int g = 0; g < system_.field_count(); ++g) {
        for (const Entry& entry : mean_[point]) {
          force += system_.M()(f, g) * entry.value * delta_.field(g)[static_cast<std::size_t>(entry.node)] / h;
        }
      }
      for (const Entry& entry : mean_[point]) {
        const double value = weight * force * entry.value * scales_[f];
        step.energy_after[place(f, entry.node)] += in_kernel(f) ? value : 0.5 * value;
        if (!in_kernel(f)) {
          step.energy_before[place(f, entry.node)] += 0.5 * value;
        }
      }
    }
  }
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
    right.col(m) += step.by_period;
    const MatrixXd next = -step.factors.solve(right);
    energy += step.energy_before.transpose() * levels + step.energy_after.transpose() * next;
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
    const VectorXd right = r.segment(first, level_size()) + step.before * last + x[period_place()] * step.by_period;
    const VectorXd next = -step.factors.solve(right);
    x.segment(first, moving()) = last;
    x.segment(first + moving(), level_size() - moving()) = next.tail(level_size() - moving());
    energy += step.energy_before.dot(last) + step.energy_after.dot(next);
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
      entries.emplace_back(first + row, period_place(), step.by_period[row]);
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
      if (place(f, i) == rest) {
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
                                               Collocation collocation, const PeriodOfLattice& guess,
                                               const PeriodicLatticeOptions& options) {
  PeriodicLattice equations(system, grid, collocation, {.period = options.period, .energy = options.energy}, guess);
  PeriodicLatticeSolution solution;
  VectorXd u = equations.pack(guess);
  solution.search = solve::find_zero(equations, options.tolerance, options.most_iterations, 0, u, solution.history);
  solution.orbit = equations.unpack(u);
  solution.mean_energy = mean_of(equations.energies());
  return solution;
}

}  // namespace rubato
