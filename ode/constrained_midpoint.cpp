#include <rubato/ode/constrained_midpoint.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <rubato/base/limits.hpp>
#include <rubato/ode/constraints.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

class ConstrainedMidpoint final : public OneStepState<VectorXd> {
public:
  ConstrainedMidpoint(const Hamiltonian& hamiltonian, std::span<const double> z_0)
      : OneStepState(hamiltonian, z_0),
        constraints_(hamiltonian.constraints()),
        q_names_(hamiltonian.q_names()),
        n_(static_cast<Index>(z_0.size()) / 2),
        c_(static_cast<Index>(constraints_.count())),
        at_(constraints_),
        energy_size_(hamiltonian.size_code()),
        solver_(static_cast<int>(2 * n_ + c_)),
        projection_(static_cast<int>(c_)) {
    for (VectorXd* vector : {&increment_, &last_increment_, &middle_, &gradient_, &end_, &errors_}) {
      vector->setZero(2 * n_);
    }
    for (VectorXd* vector : {&mu_, &last_mu_, &rates_}) {
      vector->setZero(c_);
    }
    first_entries_.setZero(static_cast<Index>(constraints_.places().size()));
    first_G_.setZero(c_, n_);
    hessian_.setZero(2 * n_, 2 * n_);
    unknown_.setZero(2 * n_ + c_);
    matrix_.setZero(2 * n_ + c_, 2 * n_ + c_);
    small_.setZero(c_, c_);
  }

  [[nodiscard]] bool has_node_law() const override { return false; }
  [[nodiscard]] bool solves_fully() const override { return true; }

  [[nodiscard]] Status advance(double h, double) override {
    forget_trial();
    trial_h_ = h;
    dependent_.clear();
    end_ = z_.value();
    at_.evaluate(end_.data());
    first_entries_ = at_.entries();
    first_G_ = at_.G();
    const bool continued = start(h);
    Status status = iterate(h);
    if (status != Status::success && continued) {
      start_on_tangent(h);
      status = iterate(h);
    }
    if (status == Status::success) {
      delta_ = increment_;
      at_.kick(first_entries_, mu_, delta_.data() + n_);
      status = project();
    }
    forget_trial();
    return status;
  }

  [[nodiscard]] Status tangent(std::span<double>) override { return Status::undefined; }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_by_nodes(energy_, trial_h_); }
  [[nodiscard]] bool slope_costs_more() const override { return true; }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    z_.displaced(0.5, delta_, end_);
    errors_ = 2.5 * (end_.cwiseAbs() + delta_.cwiseAbs());
    return energy_size_(as_span(std::as_const(end_)), as_span(std::as_const(errors_)));
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  void accept() override {
    last_increment_ = increment_;
    last_mu_ = mu_;
    last_h_ = trial_h_;
    take();
    start_level();
  }
  void restart(std::span<const double> z) override {
    stand_at(Eigen::Map<const VectorXd>(z.data(), 2 * n_));
    last_h_ = 0.0;
    start_level();
  }
  void save(StateWriter& state) const override {
    z_.save(state);
    state.write(last_h_);
    state.write(as_span(last_increment_));
    state.write(as_span(last_mu_));
  }
  void restore(StateReader& state) override {
    restore_state(state);
    state.read(last_h_);
    state.read(as_span(last_increment_));
    state.read(as_span(last_mu_));
    start_level();
  }

  [[nodiscard]] std::string failure_reason() const override {
    return dependence_near(dependent_, q_names_, end_.head(n_));
  }

  /// Requires G H_p = 0 to rounding at the start. \throws std::invalid_argument, with the momenta that satisfy it
  void check_start(std::span<const std::string> p_names) {
    end_ = z_.value();
    at_.evaluate(end_.data());
    evaluator_.gradient(end_.data(), gradient_.data());
    at_.rates(gradient_.data() + n_, rates_);
    if (at_.left(rates_, gradient_.data() + n_).in_roundings <= roundings_of_start) {
      return;
    }
    const VectorXd rates = rates_;
    const bool found = project() == Status::success;
    refuse_start_off_hidden(constraints_, rates, found ? listed(p_names, end_.tail(n_)) : std::string());
  }

private:
  [[nodiscard]] NodeEnergy node_at(const VectorXd& z) override {
    return {evaluator_.value(z.data()), std::numeric_limits<double>::quiet_NaN()};
  }
  void start_level() {
    trial_h_ = 0.0;
    iterations_ = 0;
  }

  /// The increment and multipliers to begin with: the last step's, or the tangent. \return whether the first
  bool start(double h) {
    const double ratio = last_h_ == 0.0 ? 0.0 : h / last_h_;
    if (!(ratio > 1.0 / tuning::longest_continuation && ratio < tuning::longest_continuation)) {
      start_on_tangent(h);
      return false;
    }
    increment_ = ratio * last_increment_;
    mu_ = ratio * last_mu_;
    return true;
  }
  void start_on_tangent(double h) {
    evaluator_.gradient(z_.value().data(), gradient_.data());
    increment_.head(n_) = h * gradient_.tail(n_);
    increment_.tail(n_) = -h * gradient_.head(n_);
    mu_.setZero();
  }

  /// Newton's method for the increment from (q_k, p⁺) to (q_{k+1}, p⁻) and the multipliers; its matrix is kept as long
  /// as corrections shrink fast.
  [[nodiscard]] Status iterate(double h) {
    double last = 1.0;
    bool settled = false, factored = false;
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      ++iterations_;
      middle_ = z_.low() + 0.5 * increment_;
      at_.kick(first_entries_, mu_, middle_.data() + n_);
      middle_ += z_.value();
      energy_ = evaluator_.gradient(middle_.data(), gradient_.data());
      if (!std::isfinite(energy_) || !gradient_.allFinite()) {
        return Status::undefined;
      }
      end_.head(n_) = z_.value().head(n_) + (z_.low().head(n_) + increment_.head(n_));
      at_.evaluate(end_.data());
      if (settled) {
        return Status::success;
      }
      if (!factored) {
        assemble_matrix(h);
        if (solver_.factor(matrix_.data()) != Status::success) {
          dependent_ = at_.dependent();
          return Status::undefined;
        }
      }
      unknown_.head(n_) = increment_.head(n_) - h * gradient_.tail(n_);
      unknown_.segment(n_, n_) = increment_.tail(n_) + h * gradient_.head(n_);
      unknown_.tail(c_) = at_.g();
      solver_.solve(unknown_.data());
      increment_ -= unknown_.head(2 * n_);
      mu_ -= unknown_.tail(c_);
      const double correction = unknown_.head(2 * n_).lpNorm<Eigen::Infinity>();
      const double size = correction == 0.0 ? 0.0 : correction / increment_.lpNorm<Eigen::Infinity>();
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      factored = size <= slowest_multipliers * last;
      settled = size / last * size <= tuning::least_leftover || size <= epsilon ||
                (size >= 0.5 * last && size <= stagnant_constraint);
      last = size;
    }
    return Status::not_converged;
  }

  /// The derivatives of what is left of the equations.
  void assemble_matrix(double h) {
    evaluator_.hessian(middle_.data(), gradient_.data(), hessian_.data());
    matrix_.setIdentity();
    matrix_.bottomRightCorner(c_, c_).setZero();
    matrix_.topLeftCorner(n_, 2 * n_) -= 0.5 * h * hessian_.bottomRows(n_);
    matrix_.block(n_, 0, n_, 2 * n_) += 0.5 * h * hessian_.topRows(n_);
    matrix_.block(0, 2 * n_, n_, c_) = h * hessian_.bottomRightCorner(n_, n_).lazyProduct(first_G_.transpose());
    matrix_.block(n_, 2 * n_, n_, c_) = -h * hessian_.topRightCorner(n_, n_).lazyProduct(first_G_.transpose());
    matrix_.block(2 * n_, 0, c_, n_) = at_.G();
  }

  /// p -= Gᵀν with G H_p = 0 at the end of the step.
  [[nodiscard]] Status project() {
    double last = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      z_.displaced(1.0, delta_, end_);
      evaluator_.hessian(end_.data(), gradient_.data(), hessian_.data());
      at_.rates(gradient_.data() + n_, rates_);
      const ConstraintEvaluator::Left left = at_.left(rates_, gradient_.data() + n_);
      if (!std::isfinite(left.relative)) {
        return Status::undefined;
      }
      if (left.in_roundings <= roundings_of_step ||
          (left.relative >= 0.5 * last && left.relative <= stagnant_constraint)) {
        return Status::success;
      }
      last = left.relative;
      small_ = at_.G().lazyProduct(hessian_.bottomRightCorner(n_, n_)).eval().lazyProduct(at_.G().transpose());
      if (projection_.factor(small_.data()) != Status::success ||
          projection_.rcond_estimate() < least_multiplier_pivot) {
        dependent_ = at_.dependent();
        return Status::undefined;
      }
      projection_.solve(rates_.data());
      at_.kick(at_.entries(), rates_, delta_.data() + n_);
    }
    return Status::not_converged;
  }

  Constraints constraints_;
  std::vector<std::string> q_names_;
  Index n_, c_;
  ConstraintEvaluator at_;
  formula::SumSizeEvaluator energy_size_;
  solve::DenseSolver solver_, projection_;
  VectorXd increment_, last_increment_;  ///< from (q_k, p⁺) to (q_{k+1}, p⁻); of the last step
  VectorXd mu_, last_mu_;
  VectorXd first_entries_, middle_, gradient_, end_, errors_, rates_, unknown_;
  MatrixXd first_G_, hessian_, matrix_, small_;
  double trial_h_ = 0.0, last_h_ = 0.0, energy_ = 0.0;
  int iterations_ = 0;
  std::string dependent_;
};

}  // namespace

std::unique_ptr<OneStepScheme> make_constrained_midpoint(const Hamiltonian& hamiltonian, std::span<const double> z_0) {
  check_initial_state(hamiltonian, z_0);
  check_constraints(hamiltonian.constraints(), hamiltonian.q_names(), z_0.first(z_0.size() / 2));
  auto scheme = std::make_unique<ConstrainedMidpoint>(hamiltonian, z_0);
  scheme->check_start(hamiltonian.p_names());
  return scheme;
}

}  // namespace rubato
