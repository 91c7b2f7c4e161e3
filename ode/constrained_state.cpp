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

KineticDerivatives::KineticDerivatives(formula::Expression T, std::span<const formula::Expression> variables,
                                       const Constraints& constraints)
    : places_(constraints.places()), count_(constraints.count()) {
  const std::span<const formula::Expression> momenta = variables.last(variables.size() / 2);
  std::vector<formula::Expression> outputs = {T}, second;
  std::ranges::copy(formula::gradient(T, momenta), std::back_inserter(outputs));
  for (const formula::HessianEntry& entry : formula::hessian_entries(T, momenta)) {
    const auto add = [&](std::size_t from, std::size_t to) {
      for (std::size_t k = 0; k < places_.size(); ++k) {
        if (places_[k].column == from) {
          terms_.push_back({second.size(), k, places_[k].row + count_ * to});
        }
      }
    };
    add(entry.row, entry.column);
    if (entry.row != entry.column) {
      add(entry.column, entry.row);
    }
    second.push_back(entry.value);
  }
  first_ = formula::ScalarEvaluator(formula::Bytecode(outputs, variables));
  second_ = formula::ScalarEvaluator(formula::Bytecode(second, variables));
  product_.assign(count_ * momenta.size(), 0.0);
}

void KineticDerivatives::multiplier_matrix(const double* z, double length, const VectorXd& entries_1,
                                           const VectorXd& entries_0, Eigen::MatrixXd& matrix) {
  const double* const second = second_.at(z);
  std::ranges::fill(product_, 0.0);
  for (const Term& term : terms_) {
    product_[term.target] += second[term.second] * entries_0[static_cast<Index>(term.entry)];
  }
  matrix.setZero();
  const double* entry = entries_1.data();
  for (const auto [row, column] : places_) {
    const double factor = length * *entry++;
    for (std::size_t j = 0; j < count_; ++j) {
      matrix(static_cast<Index>(row), static_cast<Index>(j)) += factor * product_[j + count_ * column];
    }
  }
}

ConstrainedState::ConstrainedState(const Hamiltonian& hamiltonian, formula::Expression T, Index unknowns,
                                   std::span<const double> z_0)
    : OneStepState(hamiltonian, z_0),
      constraints_(hamiltonian.constraints()),
      n_(static_cast<Index>(z_0.size()) / 2),
      c_(static_cast<Index>(constraints_.count())),
      at_(constraints_),
      kinetic_(T, hamiltonian.variables(), constraints_),
      multiplier_solver_(static_cast<int>(c_)),
      history_(unknowns),
      q_names_(hamiltonian.q_names()),
      energy_size_(hamiltonian.size_code()) {
  unknowns_.setZero(unknowns);
  at_end_.setZero(2 * n_);
  errors_.setZero(2 * n_);
  rates_.setZero(c_);
  nu_.setZero(c_);
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
  delta_.setZero();
  displace(0, 2 * n_);
  at_.evaluate(at_end_.data());
  kinetic_.evaluate(at_end_.data());
  at_.rates(kinetic_.velocity(), rates_);
  if (at_.left(rates_, kinetic_.velocity()).in_roundings <= roundings_of_start) {
    return;
  }
  const VectorXd rates = rates_;
  const bool found = project() == Status::success;
  refuse_start_off_hidden(constraints_, rates, found ? listed(p_names, at_end_.tail(n_)) : std::string());
}

/// p -= Gᵀν with G H_p = 0 at the end of the step.
Status ConstrainedState::project() {
  nu_.setZero();
  double last = std::numeric_limits<double>::infinity();
  displace(0, n_);
  for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
    displace(n_, 2 * n_);
    kinetic_.evaluate(at_end_.data());
    at_.rates(kinetic_.velocity(), rates_);
    const ConstraintEvaluator::Left left = at_.left(rates_, kinetic_.velocity());
    if (!std::isfinite(left.relative)) {
      return Status::undefined;
    }
    if (left.in_roundings <= roundings_of_step ||
        (left.relative >= 0.5 * last && left.relative <= stagnant_constraint)) {
      return Status::success;
    }
    if (iteration == 0 || left.relative > slowest_multipliers * last) {
      if (const Status status = factor(1.0, at_.entries()); status != Status::success) {
        return status;
      }
    }
    last = left.relative;
    multiplier_solver_.solve(rates_.data());
    nu_ += rates_;
    at_.kick(at_.entries(), rates_, delta_.data() + n_);
  }
  return Status::not_converged;
}

Status ConstrainedState::factor(double length, const VectorXd& entries_0) {
  kinetic_.multiplier_matrix(at_end_.data(), length, at_.entries(), entries_0, matrix_);
  if (multiplier_solver_.factor(matrix_.data()) == Status::success &&
      multiplier_solver_.rcond_estimate() > least_multiplier_pivot) {
    return Status::success;
  }
  dependent_ = at_.dependent();
  return Status::undefined;
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

Status ConstrainedState::vary_projection(const VectorXd& nu, Columns columns) {
  vary_gradients(at_end_.data(), nu, columns);
  at_.kick(at_.entries(), nu, at_end_.data() + n_);
  if (const Status status = factor(1.0, at_.entries()); status != Status::success) {
    return status;
  }
  Second& at = second();
  static_cast<void>(evaluator_.hessian(at_end_.data(), at.gradient.data(), at.hessian.data()));
  const MatrixXd& by_q = at.curvature.of_rates(at_end_.data(), at.gradient.data() + n_);
  for (auto column : columns.colwise()) {
    errors_.head(n_).noalias() = at.hessian.bottomRows(n_).lazyProduct(column);  // of H_p
    rates_.noalias() = at_.G().lazyProduct(errors_.head(n_));
    rates_ += by_q.lazyProduct(column.head(n_));
    multiplier_solver_.solve(rates_.data());
    at_.kick(at_.entries(), rates_, column.data() + n_);
  }
  return columns.allFinite() ? Status::success : Status::undefined;
}

Status ConstrainedState::project_variations(std::span<double> columns) {
  at_end_ = z_.value();
  at_.evaluate(at_end_.data());
  if (const Status status = factor(1.0, at_.entries()); status != Status::success) {
    return status;
  }
  Second& at = second();
  static_cast<void>(evaluator_.hessian(at_end_.data(), at.gradient.data(), at.hessian.data()));
  Columns all(columns.data(), 2 * n_, static_cast<Index>(columns.size()) / (2 * n_));
  for (auto column : all.colwise()) {
    rates_.noalias() = at_.G().lazyProduct(column.head(n_));
    multiplier_solver_.solve(rates_.data());
    errors_.tail(n_).noalias() = at_.G().transpose().lazyProduct(rates_);
    column.head(n_) -= at.hessian.bottomRightCorner(n_, n_).lazyProduct(errors_.tail(n_));
  }
  nu_.setZero();
  return vary_projection(nu_, all);
}

}  // namespace rubato
