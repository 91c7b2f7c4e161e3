#include <rubato/ode/constrained_lagrangian.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <Eigen/Core>

#include <rubato/base/larger.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/ode/constraints.hpp>
#include <rubato/ode/polynomial_scheme.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/dense_solver.hpp>
#include <rubato/solve/small_matrices.hpp>
#include <rubato/variation/tuning.hpp>

namespace rubato {

namespace {

using namespace tuning::constraints;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// p and q̇ at q with ∂L/∂q̇ = p + Gᵀν and G q̇ = 0, by Newton's method for (q̇, ν).
class MomentumProjection {
public:
  MomentumProjection(const Lagrangian& lagrangian, Index constraints)
      : evaluator_(lagrangian),
        curvature_(lagrangian.constraints()),
        n_(static_cast<Index>(lagrangian.degrees_of_freedom())),
        solver_(static_cast<int>(n_ + constraints)) {
    point_.setZero(2 * n_);
    gradient_.setZero(2 * n_);
    hessian_.setZero(2 * n_, 2 * n_);
    nu_.setZero(constraints);
    unknown_.setZero(n_ + constraints);
    matrix_.setZero(n_ + constraints, n_ + constraints);
    block_.setZero(n_, n_);
  }

  /// \param p in, its projection out \param velocity in: near q̇
  [[nodiscard]] Status operator()(const VectorXd& q, const ConstraintEvaluator& at, Eigen::Ref<VectorXd> p,
                                  VectorXd& velocity) {
    const MatrixXd& G = at.G();
    point_ << q, velocity;
    nu_.setZero();
    const double before = velocity.lpNorm<Eigen::Infinity>();
    double last = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      if (factor(G) != Status::success) {
        return Status::undefined;
      }
      unknown_.head(n_) = p - gradient_.tail(n_);
      unknown_.head(n_).noalias() += G.transpose() * nu_;
      unknown_.tail(nu_.size()).noalias() = -G * point_.tail(n_);
      solver_.solve(unknown_.data());
      point_.tail(n_) += unknown_.head(n_);
      nu_ += unknown_.tail(nu_.size());
      // Where the motion turns round velocities are less than what rounds in them.
      const double speed = std::max(point_.tail(n_).lpNorm<Eigen::Infinity>(), before);
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

  /// Its derivatives at the q and q̇ that it ended with, or of no projection at those given.
  ///@{
  void stand_at(const VectorXd& q, const VectorXd& velocity) {
    point_ << q, velocity;
    nu_.setZero();
  }
  /// δp in, that of the projection out.
  [[nodiscard]] Status vary(const ConstraintEvaluator& at, Eigen::Ref<MatrixXd> columns) {
    if (const Status status = factor(at.G()); status != Status::success) {
      return status;
    }
    block_.setZero();
    curvature_.add_to(point_.data(), nu_, block_);
    const MatrixXd& by_q = curvature_.of_rates(point_.data(), point_.data() + n_);
    for (auto column : columns.colwise()) {
      auto q = column.head(n_), p = column.tail(n_);
      p += block_.lazyProduct(q);
      unknown_.head(n_) = p - hessian_.bottomLeftCorner(n_, n_).lazyProduct(q);
      unknown_.tail(nu_.size()) = -by_q.lazyProduct(q);
      solver_.solve(unknown_.data());
      p += at.G().transpose().lazyProduct(unknown_.tail(nu_.size()));
    }
    return columns.allFinite() ? Status::success : Status::undefined;
  }
  /// δq less what is not along the constraints, in units of ∂²L/∂q̇².
  [[nodiscard]] Status project(const ConstraintEvaluator& at, Eigen::Ref<MatrixXd> columns) {
    if (const Status status = factor(at.G()); status != Status::success) {
      return status;
    }
    for (auto column : columns.colwise()) {
      unknown_.head(n_).setZero();
      unknown_.tail(nu_.size()) = at.G().lazyProduct(column.head(n_));
      solver_.solve(unknown_.data());
      column.head(n_) -= unknown_.head(n_);
    }
    return vary(at, columns);
  }
  ///@}

private:
  [[nodiscard]] Status factor(const MatrixXd& G) {
    evaluator_.hessian(point_.data(), gradient_.data(), hessian_.data());
    matrix_.topLeftCorner(n_, n_) = hessian_.bottomRightCorner(n_, n_);
    matrix_.topRightCorner(n_, nu_.size()) = -G.transpose();
    matrix_.bottomLeftCorner(nu_.size(), n_) = G;
    return solver_.factor(matrix_.data());
  }

  LagrangianEvaluator evaluator_;
  ConstraintCurvature curvature_;
  Index n_;
  solve::DenseSolver solver_;
  VectorXd point_, gradient_, nu_, unknown_;
  MatrixXd hessian_, matrix_, block_;
};

class ConstrainedLagrangian final : public PolynomialScheme {
public:
  ConstrainedLagrangian(const Lagrangian& lagrangian, const ActionQuadrature& quadrature, std::span<const double> q,
                        std::span<const double> q_dot)
      : PolynomialScheme(lagrangian, quadrature, q, q_dot, static_cast<Index>(lagrangian.constraints().count()),
                         beside_others),
        q_names_(lagrangian.q_names()),
        constraints_(lagrangian.constraints()),
        at_(constraints_),
        curvature_(constraints_),
        project_(lagrangian, static_cast<Index>(constraints_.count())),
        c_(static_cast<Index>(constraints_.count())),
        solver_(static_cast<int>((n_ + c_) * d_)) {
    residual_.setZero(n_, d_);
    first_G_.setZero(c_, n_);
    matrix_.setZero((n_ + c_) * d_, (n_ + c_) * d_);
    unknown_.setZero((n_ + c_) * d_);
    delta_.setZero(2 * n_);
    end_.setZero(2 * n_);
    for (VectorXd* vector : {&node_, &kick_, &seed_at_end_}) {
      vector->setZero(n_);
    }
    first_curvature_.setZero(n_, n_);
    curvatures_.setZero(n_, n_ * d_);
    for (VectorXd* vector : {&point_change_, &gradient_change_}) {
      vector->setZero(2 * n_);
    }
    for (MatrixXd* matrix : {&Y_change_, &rows_}) {
      matrix->setZero(n_, d_);
    }
  }

  [[nodiscard]] bool has_node_law() const override { return false; }
  [[nodiscard]] bool solves_fully() const override { return true; }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    trial_h_ = h;
    dependent_.clear();
    if (!std::isfinite(node().energy)) {
      return Status::undefined;
    }
    node_ = z_.value().head(n_);
    at_.evaluate(node_.data());
    first_G_ = at_.G();
    const bool continued = start(h);
    Status status = iterate_nearby(h, accuracy);
    if (status != Status::success && continued) {
      start_on_tangent(h);
      status = iterate_nearby(h, accuracy);
    }
    if (status != Status::success) {
      status = approach(h, accuracy);
    }
    return status == Status::success ? finish(h) : status;
  }

  /// By the derivatives of what finish() makes of the solution of assemble()'s equations.
  [[nodiscard]] Status tangent(std::span<double> columns) override { return linearise(columns, {}); }
  [[nodiscard]] Status linearise(std::span<double> columns, std::span<double> energies) override {
    const double h = trial_h_;
    first_curvature_.setZero();
    node_ = z_.value().head(n_);
    at_.evaluate(node_.data());
    first_G_ = at_.G();
    curvature_.add_to(node_.data(), x_.mu.col(0), first_curvature_);
    if (!action_.evaluate(z_, x_.Y, h) || !assemble(h)) {
      return Status::undefined;
    }
    if (const Status status = solver_.factor(matrix_.data()); status != Status::success) {
      return status;
    }
    Eigen::Map<MatrixXd> all(columns.data(), 2 * n_, static_cast<Index>(columns.size()) / (2 * n_));
    for (Index i = 0; i < all.cols(); ++i) {
      const bool by_h = !energies.empty() && i + 1 == all.cols();
      vary_step(all.col(i), h, by_h ? 1.0 : 0.0, energies.empty() ? nullptr : &energies[static_cast<std::size_t>(i)]);
    }
    return project_.vary(at_, all);  // at_ and project_ are at the end
  }
  [[nodiscard]] Status project_variations(std::span<double> columns) override {
    node_ = z_.value().head(n_);
    at_.evaluate(node_.data());
    static_cast<void>(node());
    project_.stand_at(node_, velocity_);
    return project_.project(
        at_, Eigen::Map<MatrixXd>(columns.data(), 2 * n_, static_cast<Index>(columns.size()) / (2 * n_)));
  }

  void accept() override {
    usual_ = usual_.cwiseMax(delta_.head(n_).cwiseAbs());
    z_.add(delta_);
    move_on(trial_velocity_);
  }

  [[nodiscard]] std::string failure_reason() const override { return dependence_near(dependent_, q_names_, node_); }

private:
  static constexpr double beside_others = 0.25;

  [[nodiscard]] NodeEnergy read(const VectorXd& z, const VectorXd& from, VectorXd& velocity) override {
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    velocity = from;
    const bool found = transform_.solve(z.data(), z.data() + n_, velocity.data()) == Status::success;
    return {found ? transform_.energy() : none, none};
  }

  /// Newton's method for the polynomial and the multipliers; at its end `action_` is of what was found.
  [[nodiscard]] Status iterate(double h, double) override {
    double last = 1.0;
    bool settled = false;
    for (int iteration = 0; iteration < most_multiplier_iterations; ++iteration) {
      ++iterations_;
      if (!action_.evaluate(z_, x_.Y, h)) {
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
      x_.Y -= unknown_.head(n_ * d_).reshaped(n_, d_);
      x_.mu -= unknown_.tail(c_ * d_).reshaped(c_, d_);
      const double size = relative_size();
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      // Newton's iteration converges quadratically: the next correction is this one times the last contraction squared.
      const double contraction = size / last;
      settled = size * contraction * (iteration == 0 ? 1.0 : contraction) <= tuning::least_leftover ||
                size <= epsilon || (contraction >= 0.5 && size <= stagnant_constraint);
      last = size;
    }
    return Status::not_converged;
  }

  /// What is left of the equations, into unknown_, and its derivatives. \return true if all are finite
  [[nodiscard]] bool assemble(double h) {
    matrix_.setZero();
    action_.differentiate(h, residual_, matrix_);
    residual_.col(0) += z_.value().tail(n_) + z_.low().tail(n_);
    residual_.col(0).noalias() += first_G_.transpose() * x_.mu.col(0);
    const Index equations = n_ * d_;
    matrix_.block(0, equations, n_, c_) = first_G_.transpose();
    for (Index i = 0; i < d_; ++i) {  // at the end of Y.col(i)
      node_ = z_.value().head(n_) + (z_.low().head(n_) + x_.Y.col(i));
      at_.evaluate(node_.data());
      const Index row = equations + i * c_;
      unknown_.segment(row, c_) = at_.g();
      matrix_.block(row, i * n_, c_, n_) = at_.G();
      if (i + 1 == d_) {
        break;
      }
      residual_.col(i + 1).noalias() += at_.G().transpose() * x_.mu.col(i + 1);
      matrix_.block((i + 1) * n_, row + c_, n_, c_) = at_.G().transpose();
      add_curvature(i);
    }
    unknown_.head(equations) = residual_.reshaped();
    return unknown_.allFinite() && matrix_.allFinite();
  }
  /// ∂²(μᵀg)/∂q∂q at the control point of Y.col(i).
  void add_curvature(Index i) {
    auto block = curvatures_.middleCols(i * n_, n_);
    block.setZero();
    curvature_.add_to(node_.data(), x_.mu.col(i + 1), block);
    matrix_.block((i + 1) * n_, i * n_, n_, n_) += block;
  }

  /// A variation through the step, before its projection; of h, too, which changes by `change`.
  void vary_step(Eigen::Ref<VectorXd> column, double h, double change, double* energy) {
    const ActionQuadrature& of = action_.quadrature;
    const auto q = column.head(n_);
    auto p = column.tail(n_);
    const auto curvature = [this](Index i) { return curvatures_.middleCols(i * n_, n_); };
    const auto G = [this](Index i) { return matrix_.block(n_ * d_ + i * c_, i * n_, c_, n_); };
    p += first_curvature_.lazyProduct(q);
    Y_change_.setZero();
    rows_.setZero();
    rows_.col(0) = p;
    for (Index j = 0; j < action_.values.size(); ++j) {
      action_.vary(j, h, q, Y_change_, change, point_change_, gradient_change_);
      for (Index row = 0; row < d_; ++row) {
        const double value = of.values(j, row), rate = of.rates(j, row);
        rows_.col(row) += of.weights[j] * (h * value * gradient_change_.head(n_) + rate * gradient_change_.tail(n_) +
                                           change * value * action_.gradients.col(j).head(n_));
      }
    }
    for (Index i = 0; i < d_; ++i) {
      unknown_.segment(n_ * d_ + i * c_, c_) = G(i).lazyProduct(q);
      if (i + 1 < d_) {
        rows_.col(i + 1) += curvature(i).lazyProduct(q);
      }
    }
    unknown_.head(n_ * d_) = rows_.reshaped();
    solver_.solve(unknown_.data());
    Y_change_ = -unknown_.head(n_ * d_).reshaped(n_, d_);
    p -= first_G_.transpose().lazyProduct(unknown_.segment(n_ * d_, c_));
    for (Index i = 0; i + 1 < d_; ++i) {
      p -= G(i).transpose().lazyProduct(unknown_.segment(n_ * d_ + (i + 1) * c_, c_));
      p += curvature(i).lazyProduct(q + Y_change_.col(i));
    }
    double sum = 0.0;
    for (Index j = 0; j < action_.values.size(); ++j) {
      action_.vary(j, h, q, Y_change_, change, point_change_, gradient_change_);
      const auto gradient = action_.gradients.col(j);
      p += of.weights[j] * (h * gradient_change_.head(n_) + change * gradient.head(n_));
      sum += of.weights[j] * (action_.points.col(j).tail(n_).dot(gradient_change_.tail(n_)) -
                              gradient.head(n_).dot(point_change_.head(n_)));
    }
    if (energy != nullptr) {
      *energy = sum;
    }
    column.head(n_) += Y_change_.col(d_ - 1);
  }

  /// Corrections of Y relative to the largest increment.
  [[nodiscard]] double relative_size() const {
    const double scale =
        std::max(x_.Y.lpNorm<Eigen::Infinity>(), epsilon * z_.value().head(n_).lpNorm<Eigen::Infinity>());
    const double size = unknown_.head(n_ * d_).lpNorm<Eigen::Infinity>();
    return size == 0.0 ? 0.0 : size / scale;
  }

  /// δ, with p_{k+1} - p_k = h Σ b_j ∂L/∂q + Σ_i G_iᵀμ_i and the projection; E; the node energy there.
  [[nodiscard]] Status finish(double h) {
    delta_.head(n_) = x_.Y.col(d_ - 1);
    kick_.setZero();
    double energy = 0.0;
    for (Index j = 0; j < action_.values.size(); ++j) {
      const double weight = action_.quadrature.weights[j];
      const auto gradient = action_.gradients.col(j);
      kick_ += weight * h * gradient.head(n_);
      energy += weight * (action_.points.col(j).tail(n_).dot(gradient.tail(n_)) - action_.values[j]);
    }
    energy_ = energy;
    kick_.noalias() += first_G_.transpose() * x_.mu.col(0);
    for (Index i = 0; i < d_; ++i) {
      node_ = z_.value().head(n_) + (z_.low().head(n_) + x_.Y.col(i));
      at_.evaluate(node_.data());
      if (i + 1 < d_) {
        kick_.noalias() += at_.G().transpose() * x_.mu.col(i + 1);
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
    remember_trial(h);
    return std::isfinite(there_.energy) && std::isfinite(energy_) ? Status::success : Status::undefined;
  }

  std::vector<std::string> q_names_;
  Constraints constraints_;
  ConstraintEvaluator at_;
  ConstraintCurvature curvature_;
  MomentumProjection project_;
  Index c_;
  solve::DenseSolver solver_;
  VectorXd seed_at_end_;  ///< velocities that those at the end are found from
  MatrixXd first_G_, residual_, matrix_;
  VectorXd unknown_, delta_, end_, node_, kick_;
  VectorXd point_change_, gradient_change_;  ///< of variations
  MatrixXd Y_change_, rows_, first_curvature_,
      curvatures_;  ///< curvatures_: at the ends of all columns of Y but the last
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
    velocity -= solve::least_squares(at.G(), at.G() * velocity);
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
