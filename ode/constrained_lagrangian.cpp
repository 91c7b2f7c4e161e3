#include <rubato/ode/constrained_lagrangian.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <Eigen/QR>

#include <rubato/base/larger.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/ode/constraints.hpp>
#include <rubato/ode/legendre.hpp>
#include <rubato/ode/polynomial_action.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd phase_point(std::span<const double> q, std::span<const double> p) {
  VectorXd z(static_cast<Index>(q.size() + p.size()));
  std::ranges::copy(p, std::ranges::copy(q, z.data()).out);
  return z;
}

/// p and q̇ at q with ∂L/∂q̇ = p + Gᵀν and G q̇ = 0, by Newton's method for (q̇, ν).
class MomentumProjection {
public:
  MomentumProjection(const Lagrangian& lagrangian, Index constraints)
      : evaluator_(lagrangian),
        n_(static_cast<Index>(lagrangian.degrees_of_freedom())),
        solver_(static_cast<int>(n_ + constraints)) {
    point_.setZero(2 * n_);
    gradient_.setZero(2 * n_);
    hessian_.setZero(2 * n_, 2 * n_);
    nu_.setZero(constraints);
    unknown_.setZero(n_ + constraints);
    matrix_.setZero(n_ + constraints, n_ + constraints);
  }

  /// \param p in, its projection out \param velocity in: near q̇
  [[nodiscard]] Status operator()(const VectorXd& q, const ConstraintEvaluator& at, Eigen::Ref<VectorXd> p,
                                  VectorXd& velocity) {
    const MatrixXd& G = at.G();
    point_ << q, velocity;
    nu_.setZero();
    double last = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      evaluator_.hessian(point_.data(), gradient_.data(), hessian_.data());
      unknown_.head(n_) = p - gradient_.tail(n_);
      unknown_.head(n_).noalias() += G.transpose() * nu_;
      unknown_.tail(nu_.size()).noalias() = -G * point_.tail(n_);
      matrix_.topLeftCorner(n_, n_) = hessian_.bottomRightCorner(n_, n_);
      matrix_.topRightCorner(n_, nu_.size()) = -G.transpose();
      matrix_.bottomLeftCorner(nu_.size(), n_) = G;
      if (solver_.factor(matrix_.data()) != Status::success) {
        return Status::undefined;
      }
      solver_.solve(unknown_.data());
      point_.tail(n_) += unknown_.head(n_);
      nu_ += unknown_.tail(nu_.size());
      const double speed = point_.tail(n_).lpNorm<Eigen::Infinity>();
      const double size = unknown_.head(n_).lpNorm<Eigen::Infinity>() / std::max(speed, 1.0e-300);
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      if (speed == 0.0 || size <= epsilon || (size >= 0.5 * last && size <= stagnant_constraint)) {
        evaluator_.gradient(point_.data(), gradient_.data());
        velocity = point_.tail(n_);
        p = gradient_.tail(n_);
        return Status::success;
      }
      last = size;
    }
    return Status::not_converged;
  }

private:
  LagrangianEvaluator evaluator_;
  Index n_;
  solve::DenseSolver solver_;
  VectorXd point_, gradient_, nu_, unknown_;
  MatrixXd hessian_, matrix_;
};

class ConstrainedLagrangian final : public OneStepScheme {
public:
  ConstrainedLagrangian(const Lagrangian& lagrangian, const ActionQuadrature& quadrature, std::span<const double> q,
                        std::span<const double> q_dot)
      : q_names_(lagrangian.q_names()),
        constraints_(lagrangian.constraints()),
        action_(lagrangian, quadrature),
        at_(constraints_),
        second_(constraints_.second_code()),
        transform_(lagrangian),
        project_(lagrangian, static_cast<Index>(constraints_.count())),
        energy_size_(lagrangian.energy_size_code()),
        n_(static_cast<Index>(q.size())),
        c_(static_cast<Index>(constraints_.count())),
        d_(quadrature.degree),
        solver_(static_cast<int>((n_ + c_) * d_)),
        z_(phase_point(q, momenta(lagrangian, q, q_dot))),
        seed_(Eigen::Map<const VectorXd>(q_dot.data(), n_)) {
    for (MatrixXd* matrix : {&Y_, &last_Y_, &begun_, &shorter_, &residual_}) {
      matrix->setZero(n_, d_);
    }
    for (MatrixXd* matrix : {&mu_, &last_mu_}) {
      matrix->setZero(c_, d_);
    }
    first_G_.setZero(c_, n_);
    matrix_.setZero((n_ + c_) * d_, (n_ + c_) * d_);
    unknown_.setZero((n_ + c_) * d_);
    for (VectorXd* vector : {&delta_, &end_, &point_, &errors_}) {
      vector->setZero(2 * n_);
    }
    for (VectorXd* vector : {&velocity_, &trial_velocity_, &node_, &kick_, &usual_}) {
      vector->setZero(n_);
    }
    inputs_.setZero(n_ + c_);
    weights_.setZero(d_ + 1);
  }

  [[nodiscard]] std::size_t dimension() const override { return static_cast<std::size_t>(2 * n_); }
  [[nodiscard]] std::span<const double> state() const override { return as_span(z_.value()); }
  [[nodiscard]] std::span<const double> velocities() override {
    static_cast<void>(node());
    return as_span(std::as_const(velocity_));
  }
  [[nodiscard]] int order() const override { return action_.quadrature.order(); }
  [[nodiscard]] bool has_node_law() const override { return false; }
  [[nodiscard]] bool solves_fully() const override { return true; }

  [[nodiscard]] Status advance(double h, double) override {
    trial_h_ = h;
    dependent_.clear();
    if (!std::isfinite(node().energy)) {
      return Status::undefined;
    }
    node_ = z_.value().head(n_);
    at_.evaluate(node_.data());
    first_G_ = at_.G();
    const bool continued = start(h);
    Status status = iterate_nearby(h);
    if (status != Status::success && continued) {
      start_on_tangent(h);
      status = iterate_nearby(h);
    }
    if (status != Status::success) {
      status = approach(h);
    }
    return status == Status::success ? finish(h) : status;
  }

  [[nodiscard]] Status tangent(std::span<double>) override { return Status::undefined; }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// By the node laws at both ends (theory, section 8).
  [[nodiscard]] double discrete_energy_slope() const override {
    return order() * (energy_ - 0.5 * (here_->energy + there_.energy)) / trial_h_;
  }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    if (trial_h_ == 0.0) {
      static_cast<void>(node());
      point_ << z_.value().head(n_), velocity_;
    } else {
      point_ = action_.points.col(action_.values.size() / 2);
    }
    errors_.head(n_) = 2.0 * (point_.head(n_).cwiseAbs() + delta_.head(n_).cwiseAbs());
    errors_.tail(n_) = 4.0 * point_.tail(n_).cwiseAbs();
    return energy_size_(as_span(std::as_const(point_)), as_span(std::as_const(errors_)));
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  [[nodiscard]] NodeEnergy node() override {
    if (!here_) {
      here_ = read(z_.value(), seed_, velocity_);
    }
    return *here_;
  }

  void accept() override {
    usual_ = usual_.cwiseMax(delta_.head(n_).cwiseAbs());
    seed_ = trial_velocity_;
    z_.add(delta_);
    last_Y_ = Y_;
    last_mu_ = mu_ / trial_h_;
    last_h_ = trial_h_;
    start_level();
  }
  void restart(std::span<const double> z) override {
    if (here_ && std::isfinite(here_->energy)) {
      seed_ = velocity_;
    }
    z_ = CompensatedState<VectorXd>(Eigen::Map<const VectorXd>(z.data(), 2 * n_));
    last_h_ = 0.0;
    start_level();
  }
  /// The velocities near which those of the next level are sought, and the usual increments.
  void save_guesses(StateWriter& state) const override {
    state.write(as_span(here_ && std::isfinite(here_->energy) ? velocity_ : seed_));
    state.write(as_span(usual_));
  }
  void restore_guesses(StateReader& state) override {
    here_.reset();
    state.read(as_span(seed_));
    state.read(as_span(usual_));
  }
  void save(StateWriter& state) const override {
    z_.save(state);
    state.write(last_h_);
    state.write(as_span(seed_));
    state.write(as_span(usual_));
    for (const MatrixXd* matrix : {&last_Y_, &last_mu_}) {
      state.write({matrix->data(), static_cast<std::size_t>(matrix->size())});
    }
  }
  void restore(StateReader& state) override {
    z_.restore(state);
    state.read(last_h_);
    state.read(as_span(seed_));
    state.read(as_span(usual_));
    for (MatrixXd* matrix : {&last_Y_, &last_mu_}) {
      state.read(std::span<double>(matrix->data(), static_cast<std::size_t>(matrix->size())));
    }
    start_level();
  }

  [[nodiscard]] std::string failure_reason() const override { return dependence_near(dependent_, q_names_, node_); }

private:
  static constexpr double beside_others = 0.25;

  void start_level() {
    here_.reset();
    delta_.setZero();
    trial_h_ = 0.0;
    iterations_ = 0;
  }

  /// H at z, and the velocities there, found from `from`.
  [[nodiscard]] NodeEnergy read(const VectorXd& z, const VectorXd& from, VectorXd& velocity) {
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    velocity = from;
    const bool found = transform_.solve(z.data(), z.data() + n_, velocity.data()) == Status::success;
    return {found ? transform_.energy() : none, none};
  }

  /// The polynomial to begin with: the last step's continued, or the tangent. \return whether the first
  bool start(double h) {
    const double ratio = last_h_ == 0.0 ? 0.0 : h / last_h_;
    if (!(ratio > 1.0 / tuning::longest_continuation && ratio < tuning::longest_continuation)) {
      start_on_tangent(h);
      return false;
    }
    continue_from(last_Y_, 1.0, ratio);
    mu_ = h * last_mu_;
    return true;
  }
  /// The polynomial of Y from σ = origin (0 or 1) on, over θ steps.
  void continue_from(const MatrixXd& Y, double origin, double theta) {
    for (Index i = 0; i < d_; ++i) {
      action_.quadrature.interpolation(origin + theta * action_.quadrature.control[i + 1], weights_);
      Y_.col(i) = -origin * Y.col(d_ - 1);
      Y_.col(i).noalias() += Y.lazyProduct(weights_.tail(d_));
    }
  }
  void start_on_tangent(double h) {
    for (Index i = 0; i < d_; ++i) {
      Y_.col(i) = h * action_.quadrature.control[i + 1] * velocity_;
    }
    mu_.setZero();
  }

  /// iterate(), unless it ends far from where it began, at a polynomial that no motion has anything to do with.
  [[nodiscard]] Status iterate_nearby(double h) {
    begun_ = Y_;
    const Status status = iterate(h);
    // A coordinate that has hardly moved yet is judged beside the others: constraints make it move with them.
    const double others = beside_others * std::max(begun_.lpNorm<Eigen::Infinity>(), usual_.lpNorm<Eigen::Infinity>());
    for (Index r = 0; r < n_ && status == Status::success; ++r) {
      const double moved = (Y_.row(r) - begun_.row(r)).lpNorm<Eigen::Infinity>();
      const double usual = std::max({begun_.row(r).lpNorm<Eigen::Infinity>(), usual_[r], others});
      if (!usual_.isZero(0.0) && moved > tuning::of_lagrangian::lagrangian_farthest * usual) {
        return Status::not_converged;
      }
    }
    return status;
  }

  /// The step on the branch that begins with h = 0, from a shorter one in lengths that grow ever less.
  [[nodiscard]] Status approach(double h) {
    for (int parts = 2; parts <= tuning::of_lagrangian::lagrangian_finest_approach; parts *= 2) {
      double share = 1.0 / parts;
      const double growth = std::pow(share, -1.0 / parts);
      start_on_tangent(share * h);
      Status status = iterate_nearby(share * h);
      for (int part = 0; part < parts && status == Status::success; ++part) {
        const double next = part + 1 == parts ? 1.0 : share * growth;
        shorter_ = Y_;
        continue_from(shorter_, 0.0, next / share);
        mu_ *= next / share;
        share = next;
        status = iterate_nearby(share * h);
      }
      if (status == Status::success) {
        return status;
      }
    }
    return Status::not_converged;
  }

  /// Newton's method for the polynomial and the multipliers; at its end `action_` is of what was found.
  [[nodiscard]] Status iterate(double h) {
    double last = 1.0;
    bool settled = false;
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      ++iterations_;
      if (!action_.evaluate(z_, Y_, h)) {
        return Status::undefined;
      }
      if (settled) {
        return Status::success;
      }
      if (!assemble(h)) {
        return Status::undefined;
      }
      if (solver_.factor(matrix_.data()) != Status::success) {
        dependent_ = at_.dependent();
        return Status::undefined;
      }
      solver_.solve(unknown_.data());
      Y_ -= unknown_.head(n_ * d_).reshaped(n_, d_);
      mu_ -= unknown_.tail(c_ * d_).reshaped(c_, d_);
      const double size = relative_size();
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      // Newton's iteration converges faster than the last contraction says.
      settled = size / last * size <= tuning::least_leftover || size <= epsilon ||
                (size >= 0.5 * last && size <= stagnant_constraint);
      last = size;
    }
    return Status::not_converged;
  }

  /// What is left of the equations, into unknown_, and its derivatives. \return true if all are finite
  [[nodiscard]] bool assemble(double h) {
    matrix_.setZero();
    action_.differentiate(h, residual_, matrix_);
    residual_.col(0) += z_.value().tail(n_) + z_.low().tail(n_);
    residual_.col(0).noalias() += first_G_.transpose() * mu_.col(0);
    const Index equations = n_ * d_;
    matrix_.block(0, equations, n_, c_) = first_G_.transpose();
    for (Index i = 0; i < d_; ++i) {  // at the end of Y.col(i)
      node_ = z_.value().head(n_) + (z_.low().head(n_) + Y_.col(i));
      at_.evaluate(node_.data());
      const Index row = equations + i * c_;
      unknown_.segment(row, c_) = at_.g();
      matrix_.block(row, i * n_, c_, n_) = at_.G();
      if (i + 1 == d_) {
        break;
      }
      residual_.col(i + 1).noalias() += at_.G().transpose() * mu_.col(i + 1);
      matrix_.block((i + 1) * n_, row + c_, n_, c_) = at_.G().transpose();
      add_curvature(i);
    }
    unknown_.head(equations) = residual_.reshaped();
    return unknown_.allFinite() && matrix_.allFinite();
  }
  /// ∂²(μᵀg)/∂q∂q at the control point of Y.col(i).
  void add_curvature(Index i) {
    inputs_ << node_, mu_.col(i + 1);
    const double* entry = second_.at(inputs_.data());
    auto block = matrix_.block((i + 1) * n_, i * n_, n_, n_);
    for (const auto [row, column] : constraints_.second_places()) {
      const auto a = static_cast<Index>(row), b = static_cast<Index>(column);
      block(a, b) += *entry;
      if (a != b) {
        block(b, a) += *entry;
      }
      ++entry;
    }
  }

  /// Corrections of Y relative to the largest increment.
  [[nodiscard]] double relative_size() const {
    const double scale =
        std::max(Y_.lpNorm<Eigen::Infinity>(), epsilon * z_.value().head(n_).lpNorm<Eigen::Infinity>());
    const double size = unknown_.head(n_ * d_).lpNorm<Eigen::Infinity>();
    return size == 0.0 ? 0.0 : size / scale;
  }

  /// δ, with p_{k+1} - p_k = h Σ b_j ∂L/∂q + Σ_i G_iᵀμ_i and the projection; E; the node energy there.
  [[nodiscard]] Status finish(double h) {
    delta_.head(n_) = Y_.col(d_ - 1);
    kick_.setZero();
    double energy = 0.0;
    for (Index j = 0; j < action_.values.size(); ++j) {
      const double weight = action_.quadrature.weights[j];
      const auto gradient = action_.gradients.col(j);
      kick_ += weight * h * gradient.head(n_);
      energy += weight * (action_.points.col(j).tail(n_).dot(gradient.tail(n_)) - action_.values[j]);
    }
    energy_ = energy;
    kick_.noalias() += first_G_.transpose() * mu_.col(0);
    for (Index i = 0; i < d_; ++i) {
      node_ = z_.value().head(n_) + (z_.low().head(n_) + Y_.col(i));
      at_.evaluate(node_.data());
      if (i + 1 < d_) {
        kick_.noalias() += at_.G().transpose() * mu_.col(i + 1);
      }
    }
    delta_.tail(n_) = kick_;
    z_.displaced(1.0, delta_, end_);
    kick_ = end_.tail(n_);
    trial_velocity_ = velocity_;
    if (const Status status = project_(node_, at_, kick_, trial_velocity_); status != Status::success) {
      dependent_ = at_.dependent();
      return status;
    }
    delta_.tail(n_) += kick_ - end_.tail(n_);
    z_.displaced(1.0, delta_, end_);
    seed_at_end_ = trial_velocity_;
    there_ = read(end_, seed_at_end_, trial_velocity_);
    return std::isfinite(there_.energy) && std::isfinite(energy_) ? Status::success : Status::undefined;
  }

  std::vector<std::string> q_names_;
  Constraints constraints_;
  PolynomialAction action_;
  ConstraintEvaluator at_;
  formula::ScalarEvaluator second_;
  LegendreTransform transform_;
  MomentumProjection project_;
  formula::SumSizeEvaluator energy_size_;
  Index n_, c_, d_;
  solve::DenseSolver solver_;
  CompensatedState<VectorXd> z_;
  VectorXd seed_, seed_at_end_;         ///< velocities that those at a level are found from
  VectorXd velocity_, trial_velocity_;  ///< at both levels
  std::optional<NodeEnergy> here_;
  NodeEnergy there_;
  MatrixXd Y_, last_Y_;       ///< q at the control points but the first, less q_k; of the last step
  MatrixXd begun_, shorter_;  ///< where an iteration began; of a shorter step, to continue
  VectorXd usual_;            ///< the largest increments since construction
  MatrixXd mu_, last_mu_;     ///< multipliers at the control points but the last; of the last step, over h
  MatrixXd first_G_, residual_, matrix_;
  VectorXd unknown_, delta_, end_, point_, errors_, node_, kick_, inputs_, weights_;
  double trial_h_ = 0.0, last_h_ = 0.0, energy_ = 0.0;
  int iterations_ = 0;
  std::string dependent_;
};

/// \throws std::invalid_argument unless G q̇ = 0 to rounding, with the nearest velocities that satisfy it
void check_velocities(const Lagrangian& lagrangian, std::span<const double> q, std::span<const double> q_dot) {
  ConstraintEvaluator at(lagrangian.constraints());
  at.evaluate(q.data());
  VectorXd velocity = Eigen::Map<const VectorXd>(q_dot.data(), static_cast<Index>(q_dot.size()));
  const VectorXd rates = at.G() * velocity;
  if (at.left(rates, velocity.data()).in_roundings <= roundings_of_start) {
    return;
  }
  for (int pass = 0; pass < 2; ++pass) {
    velocity -= at.G().transpose() * (at.G() * at.G().transpose()).colPivHouseholderQr().solve(at.G() * velocity);
  }
  refuse_start_off_hidden(lagrangian.constraints(), rates, listed(lagrangian.velocity_names(), velocity));
}

}  // namespace

std::unique_ptr<OneStepScheme> make_constrained_lagrangian(const Lagrangian& lagrangian,
                                                           const ActionQuadrature& quadrature,
                                                           std::span<const double> q, std::span<const double> q_dot) {
  static_cast<void>(momenta(lagrangian, q, q_dot));
  check_constraints(lagrangian.constraints(), lagrangian.q_names(), q);
  check_velocities(lagrangian, q, q_dot);
  return std::make_unique<ConstrainedLagrangian>(lagrangian, quadrature, q, q_dot);
}

}  // namespace rubato
