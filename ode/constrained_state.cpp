#include <rubato/ode/constrained_state.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

#include <rubato/ode/tuning.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

ConstrainedState::ConstrainedState(const Hamiltonian& hamiltonian, Index unknowns, std::span<const double> z_0)
    : OneStepState(hamiltonian, z_0),
      constraints_(hamiltonian.constraints()),
      n_(static_cast<Index>(z_0.size()) / 2),
      c_(static_cast<Index>(constraints_.count())),
      at_(constraints_),
      point_(n_, static_cast<Index>(constraints_.places().size()), c_),
      history_(unknowns),
      q_names_(hamiltonian.q_names()),
      projection_(hamiltonian.expression(), hamiltonian.variables(), constraints_, ConstrainedKick::Then::projection),
      energy_size_(hamiltonian.size_code()),
      multiplier_solver_(static_cast<int>(c_)) {
  unknowns_.setZero(unknowns);
  at_end_.setZero(2 * n_);
  errors_.setZero(2 * n_);
  rates_.setZero(c_);
  nu_.setZero(c_);
  multiplier_units_.setOnes(c_);
  matrix_.setZero(c_, c_);
}

Status ConstrainedState::advance(double h, double) {
  forget_trial();
  dependent_.clear();
  const bool continued = continue_from_before(h);
  if (!continued) {
    start_on_tangent(h);
  }
  trial_h_ = h;
  Status status = step(h);
  if (status != Status::success && continued) {
    start_on_tangent(h);
    status = step(h);
  }
  if (status == Status::success) {
    status = project();
  }
  if (status == Status::success && !(std::isfinite(energy_) && delta_.allFinite())) {
    status = Status::undefined;
  }
  if (status != Status::success) {
    trial_h_ = 0.0;
  }
  forget_trial();
  return status;
}

/// Unknowns of a trial at this level, or of the last steps. \return false if there are none that are near
bool ConstrainedState::continue_from_before(double h) {
  const auto is_near = [h](double length) {
    const double ratio = length == 0.0 ? 0.0 : h / length;
    return ratio > 1.0 / tuning::longest_continuation && ratio < tuning::longest_continuation;
  };
  if (is_near(trial_h_)) {
    unknowns_ *= h / trial_h_;
    return true;
  }
  if (is_near(last_h_)) {
    history_.predict(h, unknowns_);
    return true;
  }
  return false;
}

formula::SumSize ConstrainedState::energy_size() {
  z_.displaced(0.5, delta_, at_end_);
  errors_ = 2.5 * (at_end_.cwiseAbs() + delta_.cwiseAbs());
  formula::SumSize size = energy_size_(as_span(std::as_const(at_end_)), as_span(std::as_const(errors_)));
  size.rounding *= rounding_magnitude_;
  return size;
}

void ConstrainedState::accept() {
  history_.record(trial_h_, unknowns_);
  last_h_ = trial_h_;
  take();
  start_level();
}

void ConstrainedState::restart(std::span<const double> z) {
  stand_at(Eigen::Map<const VectorXd>(z.data(), 2 * n_));
  history_ = VelocityHistory<VectorXd>(unknowns_.size());
  last_h_ = 0.0;
  forget_level();
  start_level();
}

void ConstrainedState::save(StateWriter& state) const {
  z_.save(state);
  state.write(last_h_);
  history_.save(state);
}

void ConstrainedState::restore(StateReader& state) {
  restore_state(state);
  state.read(last_h_);
  history_.restore(state);
  forget_level();
  start_level();
}

void ConstrainedState::start_level() {
  trial_h_ = 0.0;
  iterations_ = 0;
}

NodeEnergy ConstrainedState::node_at(const VectorXd& z) {
  return {evaluator_.value(z.data()), std::numeric_limits<double>::quiet_NaN()};
}

void ConstrainedState::check_start(std::span<const std::string> p_names) {
  at_.evaluate(z_.value().data());
  point_.stand_at(z_.value(), z_.low());
  point_.entries() = at_.entries();
  const Status found = project();
  const VectorXd projection = projection_.there().tail(n_);
  point_.mu().setZero();
  projection_.evaluate(point_);
  if (!projection_.is_rounding(roundings_of_start)) {
    refuse_start_off_hidden(constraints_, projection_.values(),
                            found == Status::success ? listed(p_names, projection) : std::string());
  }
}

/// p -= Gᵀν with G H_p = 0 at the end of the step.
Status ConstrainedState::project() {
  nu_.setZero();
  double last = std::numeric_limits<double>::infinity();
  for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
    point_.mu() = nu_;
    projection_.evaluate(point_);
    const bool is_rounding = projection_.is_rounding(roundings_of_step);
    const double relative = is_rounding ? 0.0 : projection_.relative();
    if (is_rounding || (relative >= 0.5 * last && relative <= stagnant_constraint)) {
      delta_ = projection_.delta_there();
      return Status::success;
    }
    if (!std::isfinite(relative)) {
      return Status::undefined;
    }
    if (iteration == 0 || relative > slowest_multipliers * last) {
      if (const Status status = factor(projection_); status != Status::success) {
        return status;
      }
    }
    last = relative;
    rates_ = projection_.values();
    solve_multipliers();
    nu_ += rates_;
  }
  return Status::not_converged;
}

Status ConstrainedState::factor(const ConstrainedKick& kick) {
  kick.matrix(matrix_, multiplier_units_);
  if (multiplier_solver_.factor(matrix_.data()) == Status::success &&
      multiplier_solver_.rcond_estimate() > least_multiplier_pivot) {
    return Status::success;
  }
  at_end_ = kick.there();
  at_.evaluate(at_end_.data());
  dependent_ = at_.dependent();
  return Status::undefined;
}

void ConstrainedState::solve_multipliers() {
  rates_ = rates_.cwiseProduct(multiplier_units_);
  multiplier_solver_.solve(rates_.data());
  rates_ = rates_.cwiseProduct(multiplier_units_);
}

ConstrainedState::Second& ConstrainedState::second() {
  if (!second_) {
    second_.emplace(Second{.curvature = ConstraintCurvature(constraints_),
                           .gradient = VectorXd(2 * n_),
                           .hessian = MatrixXd(2 * n_, 2 * n_),
                           .block = MatrixXd(n_, n_)});
  }
  return *second_;
}

void ConstrainedState::vary_gradients(const double* q, const Eigen::Ref<const VectorXd>& mu, Columns columns) {
  MatrixXd& block = second().block;
  block.setZero();
  second().curvature.add_to(q, mu, block);
  columns.bottomRows(n_) -= block.lazyProduct(columns.topRows(n_));
}

Status ConstrainedState::vary(std::span<double> columns, std::span<double> energies) {
  Columns all(columns.data(), 2 * n_, static_cast<Index>(columns.size()) / (2 * n_));
  if (const Status status = vary_step(all, trial_h_, energies); status != Status::success) {
    return status;
  }
  return vary_projection(nu_, all);
}

/// Factors G H_pp Gᵀ at at_end_.
Status ConstrainedState::factor_there() {
  point_.z() = at_end_;
  point_.low().setZero();
  point_.delta().setZero();
  point_.entries() = at_.entries();
  point_.mu().setZero();
  projection_.evaluate(point_);
  return factor(projection_);
}

Status ConstrainedState::vary_projection(const VectorXd& nu, Columns columns) {
  vary_gradients(at_end_.data(), nu, columns);
  at_.kick(at_.entries(), nu, at_end_.data() + n_);
  if (const Status status = factor_there(); status != Status::success) {
    return status;
  }
  Second& at = second();
  static_cast<void>(evaluator_.hessian(at_end_.data(), at.gradient.data(), at.hessian.data()));
  const MatrixXd& by_q = at.curvature.of_rates(at_end_.data(), at.gradient.data() + n_);
  for (auto column : columns.colwise()) {
    errors_.head(n_).noalias() = at.hessian.bottomRows(n_).lazyProduct(column);  // of H_p
    rates_.noalias() = at_.G().lazyProduct(errors_.head(n_));
    rates_ += by_q.lazyProduct(column.head(n_));
    solve_multipliers();
    at_.kick(at_.entries(), rates_, column.data() + n_);
  }
  return columns.allFinite() ? Status::success : Status::undefined;
}

Status ConstrainedState::project_variations(std::span<double> columns) {
  at_end_ = z_.value();
  at_.evaluate(at_end_.data());
  if (const Status status = factor_there(); status != Status::success) {
    return status;
  }
  Second& at = second();
  static_cast<void>(evaluator_.hessian(at_end_.data(), at.gradient.data(), at.hessian.data()));
  Columns all(columns.data(), 2 * n_, static_cast<Index>(columns.size()) / (2 * n_));
  for (auto column : all.colwise()) {
    rates_.noalias() = at_.G().lazyProduct(column.head(n_));
    solve_multipliers();
    errors_.tail(n_).noalias() = at_.G().transpose().lazyProduct(rates_);
    column.head(n_) -= at.hessian.bottomRightCorner(n_, n_).lazyProduct(errors_.tail(n_));
  }
  nu_.setZero();
  return vary_projection(nu_, all);
}

}  // namespace rubato
