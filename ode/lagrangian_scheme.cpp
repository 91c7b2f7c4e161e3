#include <rubato/ode/lagrangian_scheme.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/ode/constrained_lagrangian.hpp>
#include <rubato/ode/polynomial_scheme.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace rubato {

namespace {

using namespace tuning::of_lagrangian;

class LagrangianScheme final : public PolynomialScheme {
public:
  LagrangianScheme(const Lagrangian& lagrangian, const ActionQuadrature& quadrature, std::span<const double> q,
                   std::span<const double> q_dot)
      : PolynomialScheme(lagrangian, quadrature, q, q_dot, 0, 0.0),
        lagrangian_(lagrangian),
        rounding_(lagrangian.gradient_code()),
        m_(quadrature.nodes.size()),
        factors_(static_cast<int>(n_ * d_)) {
    for (MatrixXd* matrix : {&correction_, &residual_, &bounds_}) {
      matrix->setZero(n_, d_);
    }
    matrix_.setZero(n_ * d_, n_ * d_);
    for (VectorXd* vector : {&changes_, &delta_, &lost_, &end_, &sums_, &errors_}) {
      vector->setZero(2 * n_);
    }
    for (VectorXd* vector : {&largest_, &acceleration_, &seed_at_level_}) {
      vector->setZero(n_);
    }
  }

  [[nodiscard]] bool has_node_law() const override {
    return action_.quadrature.points == ActionQuadrature::Points::gauss && action_.quadrature.degree == 1;
  }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    trial_h_ = h;
    if (!std::isfinite(node().energy)) {
      return Status::undefined;
    }
    const bool continued = start(h);
    Status status = iterate_nearby(h, accuracy);
    if (status != Status::success && continued) {
      const bool was_far = far_;
      start_on_tangent(h);
      status = iterate_nearby(h, accuracy);
      far_ = far_ || was_far;
    }
    if (status != Status::success && far_) {
      start_on_parabola(h);
      status = iterate_nearby(h, accuracy);
      status = status == Status::success ? status : approach(h, accuracy);
    }
    return end_trial(status, h);
  }

  [[nodiscard]] Status advance_to(std::span<const double> z_1, double h) override {
    trial_h_ = h;
    if (!std::isfinite(node().energy) || !start_on_cubic(z_1, h)) {
      return Status::undefined;
    }
    return end_trial(iterate(h, 0.0), h);
  }

  /// By the second variation of the action: that of its equations by the control points is the matrix of Newton's
  /// method, that by q_k moves all points alike, and that by p_k is 1 in the first equation.
  [[nodiscard]] Status tangent(std::span<double> columns) override {
    if (!evaluate(trial_h_)) {
      return Status::undefined;
    }
    assemble(trial_h_);
    if (const Status status = factors_.factor(matrix_.data()); status != Status::success) {
      return status;
    }
    for (std::size_t first = 0; first < columns.size(); first += dimension()) {
      Eigen::Map<VectorXd> column(columns.data() + first, 2 * n_);
      residual_.setZero();
      residual_.col(0) = column.tail(n_);
      correction_.setZero();
      for (Index j = 0; j < m_; ++j) {
        action_.vary(j, trial_h_, column.head(n_), correction_, 0.0, changes_, errors_);
        for (Index row = 0; row < d_; ++row) {
          residual_.col(row) +=
              action_.quadrature.weights[j] * (trial_h_ * action_.quadrature.values(j, row) * errors_.head(n_) +
                                               action_.quadrature.rates(j, row) * errors_.tail(n_));
        }
      }
      correction_ = -residual_;
      factors_.solve(correction_.data());
      sums_.setZero();
      for (Index j = 0; j < m_; ++j) {
        action_.vary(j, trial_h_, column.head(n_), correction_, 0.0, changes_, errors_);
        sums_.tail(n_) += action_.quadrature.weights[j] * trial_h_ * errors_.head(n_);
      }
      sums_.head(n_) = correction_.col(d_ - 1);
      column += sums_;
    }
    return all_finite(columns) ? Status::success : Status::undefined;
  }

  void accept() override {
    largest_ = largest_.cwiseMax(delta_.head(n_).cwiseAbs());
    usual_ = usual_.cwiseMax(largest_);
    z_.add(delta_, lost_);
    // The level's velocities are found from those before it, by a resumed run as well.
    move_on(velocity_);
  }
  void restart(std::span<const double> z) override {
    PolynomialScheme::restart(z);
    largest_.setZero();
  }
  void save(StateWriter& state) const override {
    PolynomialScheme::save(state);
    state.write(as_span(largest_));
  }
  void restore(StateReader& state) override {
    PolynomialScheme::restore(state);
    state.read(as_span(largest_));
  }

  [[nodiscard]] std::string failure_reason() const override {
    if (failure_ == Failure::none) {
      return {};
    }
    const std::string place =
        fmt::format("{} = ({:.6g})", fmt::join(lagrangian_.q_names(), ", "), fmt::join(failed_q_, ", "));
    return failure_ == Failure::singular
               ? fmt::format(
                     "the Hessian of L in the velocities is singular near {}, {} = ({:.6g}), so that momenta "
                     "do not determine velocities",
                     place, fmt::join(lagrangian_.velocity_names(), ", "), fmt::join(failed_at_, ", "))
               : fmt::format("no velocities were found near {} = ({:.6g}) that have the momenta ({:.6g}) at {}",
                             fmt::join(lagrangian_.velocity_names(), ", "), fmt::join(failed_from_, ", "),
                             fmt::join(failed_at_, ", "), place);
  }

private:
  void start_level() override {
    PolynomialScheme::start_level();
    failure_ = Failure::none;
  }

  /// What the iteration found, as the trial.
  [[nodiscard]] Status end_trial(Status status, double h) {
    if (status != Status::success) {
      return status;
    }
    finish(h);
    remember_trial(h);
    z_.displaced(1.0, delta_, end_);
    there_ = read(end_, velocity_, trial_velocity_);
    return std::isfinite(there_.energy) ? Status::success : Status::undefined;
  }

  [[nodiscard]] NodeEnergy read(const VectorXd& z, const VectorXd& from, VectorXd& velocity) override {
    velocity = from;
    if (transform_.solve(z.data(), z.data() + n_, velocity.data()) != Status::success) {
      if (transform_.singular()) {
        blame_hessian(z, velocity);
      } else {
        failure_ = Failure::no_velocity;
        failed_q_.assign(z.begin(), z.begin() + n_);
        failed_at_.assign(z.begin() + n_, z.end());
        failed_from_.assign(from.begin(), from.end());
      }
      return {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
    }
    return {transform_.energy(), has_node_law() ? transform_.gamma() : std::numeric_limits<double>::quiet_NaN()};
  }
  void blame_hessian(const VectorXd& z, const VectorXd& velocity) {
    failure_ = Failure::singular;
    failed_q_.assign(z.begin(), z.begin() + n_);
    failed_at_.assign(velocity.begin(), velocity.end());
  }

  void start_on_parabola(double h) override {
    start_on_tangent(h);
    VectorXd& velocity = seed_at_level_;
    velocity = velocity_;
    if (transform_.solve(z_.value().data(), z_.value().data() + n_, velocity.data()) != Status::success ||
        !transform_.acceleration(acceleration_.data())) {
      return;
    }
    for (Index i = 0; i < d_; ++i) {
      const double time = h * action_.quadrature.control[i + 1];
      x_.Y.col(i) += 0.5 * time * time * acceleration_;
    }
  }
  /// Hermite's, with the velocities at both ends. \return false if there are none at z_1
  [[nodiscard]] bool start_on_cubic(std::span<const double> z_1, double h) {
    VectorXd& velocity = seed_at_level_;
    velocity = velocity_;
    if (transform_.solve(z_1.data(), z_1.data() + n_, velocity.data()) != Status::success) {
      return false;
    }
    for (Index i = 0; i < d_; ++i) {
      const double c = action_.quadrature.control[i + 1], rest = 1.0 - c;
      for (Index r = 0; r < n_; ++r) {
        const double change = z_1[static_cast<std::size_t>(r)] - z_.value()[r];
        x_.Y(r, i) = c * (change + rest * (rest * (h * velocity_[r] - change) - c * (h * velocity[r] - change)));
      }
    }
    return true;
  }
  [[nodiscard]] Status iterate(double h, double accuracy) override {
    StagnationTest test(std::min(accuracy, tuning::loosest_trial));
    double last = std::numeric_limits<double>::infinity();
    int halvings = 0;
    correction_.setZero();
    for (int iteration = 0; iteration < most_newton_iterations;) {
      if (!evaluate(h)) {
        if (correction_.isZero(0.0) || ++halvings > most_halvings) {
          return Status::undefined;
        }
        correction_ *= 0.5;
        x_.Y -= correction_;
        continue;
      }
      assemble(h);
      if (const Status status = factors_.factor(matrix_.data()); status != Status::success) {
        if (status == Status::singular) {
          blame_hessian(z_.value(), velocity_);
        }
        return Status::undefined;
      }
      correction_ = -residual_;
      factors_.solve(correction_.data());
      const double size = relative_size();
      if (!std::isfinite(size)) {
        return Status::undefined;
      }
      for (Index a = 0; a < n_; ++a) {
        const double sum = x_.Y(a, d_ - 1) + correction_(a, d_ - 1);
        lost_[a] = correction_(a, d_ - 1) - (sum - x_.Y(a, d_ - 1));
      }
      x_.Y += correction_;
      // Newton's iteration converges faster than the last contraction says.
      if (std::isfinite(last) && size / last * size <= tuning::least_leftover) {
        return Status::success;
      }
      const auto verdict = test.judge(size, size);
      if (verdict == StagnationTest::Verdict::done || (verdict != StagnationTest::Verdict::again && is_rounding(h))) {
        return Status::success;
      }
      last = size;
      ++iteration;
    }
    return Status::not_converged;
  }

  /// q and q̇ at the quadrature points, and L there with its derivatives; whether all are finite.
  bool evaluate(double h) {
    ++iterations_;
    return action_.evaluate(z_, x_.Y, h);
  }

  /// What the polynomial leaves of p_k + ∂S/∂q_k = 0 and of ∂S/∂q = 0 at the control points between, and its
  /// derivatives by all control points but the first.
  void assemble(double h) {
    action_.differentiate(h, residual_, matrix_);
    sums_.head(n_).setZero();
    sums_.tail(n_) = residual_.col(0);
    z_.displaced(1.0, sums_, end_);
    residual_.col(0) = end_.tail(n_);
  }

  /// Corrections relative to the increments, each component in units of its own. A component that is 0 with slope 0 at
  /// the start has no unit but its first correction.
  [[nodiscard]] double relative_size() const {
    double result = 0.0;
    for (Index r = 0; r < n_; ++r) {
      const double correction = correction_.row(r).cwiseAbs().maxCoeff();
      const double scale =
          std::max({x_.Y.row(r).cwiseAbs().maxCoeff(), largest_[r], correction, epsilon * std::abs(z_.value()[r])});
      result = larger(result, correction == 0.0 ? 0.0 : correction / scale);
    }
    return result;
  }

  /// Whether what is left of the equations is no more than what the evaluation of L's derivatives rounds at.
  [[nodiscard]] bool is_rounding(double h) {
    constexpr double unit = 0.5 * epsilon;
    bounds_.setZero();
    bounds_.col(0) = 2.0 * z_.value().tail(n_).cwiseAbs();
    for (Index j = 0; j < m_; ++j) {
      changes_ = action_.points.col(j);
      errors_ = 2.0 * changes_.cwiseAbs();
      for (Index i = 0; i < d_; ++i) {
        errors_.tail(n_) += 2.0 / std::abs(h) * std::abs(action_.quadrature.rates(j, i + 1)) * x_.Y.col(i).cwiseAbs();
      }
      rounding_.run(as_span(std::as_const(changes_)), as_span(std::as_const(errors_)));
      for (Index row = 0; row < d_; ++row) {
        for (Index a = 0; a < n_; ++a) {
          bounds_(a, row) +=
              action_.quadrature.weights[j] *
              (std::abs(h * action_.quadrature.values(j, row)) * rounding_.bound(static_cast<std::size_t>(1 + a)) +
               std::abs(action_.quadrature.rates(j, row)) * rounding_.bound(static_cast<std::size_t>(1 + n_ + a)));
        }
      }
    }
    return (residual_.array().abs() <= 2.0 * unit * bounds_.array()).all();
  }

  /// δ with what its rounding loses, and E, from the points last evaluated, to first order in the last correction.
  /// p_{k+1} - p_k = ∂S/∂q_{k+1} + ∂S/∂q_k = h Σ b_j ∂L/∂q, since rows of `values` sum to 1, those of `rates` to 0.
  void finish(double h) {
    delta_.head(n_) = x_.Y.col(d_ - 1);
    long double energy = 0.0L;
    lost_.tail(n_).setZero();
    sums_.setZero();
    for (Index j = 0; j < m_; ++j) {
      changes_.head(n_).noalias() = correction_.lazyProduct(action_.quadrature.values.row(j).tail(d_).transpose());
      changes_.tail(n_).noalias() = correction_.lazyProduct(action_.quadrature.rates.row(j).tail(d_).transpose());
      changes_.tail(n_) /= h;
      const auto hessian = action_.hessians.middleCols(2 * n_ * j, 2 * n_);
      errors_.noalias() = hessian.lazyProduct(changes_);  // how ∇L changes
      const double weight = action_.quadrature.weights[j];
      for (Index a = 0; a < n_; ++a) {
        // The sum of ∂L/∂q with what it loses, by Knuth.
        const double term = weight * h * (action_.gradients(a, j) + errors_[a]);
        const double sum = sums_[a] + term;
        const double part = sum - sums_[a];
        lost_[n_ + a] += (sums_[a] - (sum - part)) + (term - part);
        sums_[a] = sum;
        energy += static_cast<long double>(weight) * static_cast<long double>(action_.points(n_ + a, j)) *
                  static_cast<long double>(action_.gradients(n_ + a, j) + errors_[n_ + a]);
        energy -= static_cast<long double>(weight) * static_cast<long double>(action_.gradients(a, j) * changes_[a]);
      }
      energy -= static_cast<long double>(weight) * static_cast<long double>(action_.values[j]);
    }
    delta_.tail(n_) = sums_.head(n_);
    energy_ = static_cast<double>(energy);
  }

  Lagrangian lagrangian_;
  formula::RoundingEvaluator rounding_;
  Index m_;
  solve::DenseSolver factors_;
  VectorXd acceleration_, seed_at_level_;  ///< at this level, where steps begin on a parabola
  MatrixXd correction_, residual_, bounds_, matrix_;
  VectorXd changes_, delta_, lost_, end_, sums_, errors_;
  VectorXd largest_;  ///< increments so far
  enum class Failure { none, singular, no_velocity };
  Failure failure_ = Failure::none;
  std::vector<double> failed_q_, failed_at_, failed_from_;  ///< at_: velocities, or momenta that have none
};

}  // namespace

std::unique_ptr<OneStepScheme> make_lagrangian_scheme(const Lagrangian& lagrangian, const ActionQuadrature& quadrature,
                                                      std::span<const double> q, std::span<const double> q_dot) {
  if (!lagrangian.constraints().none()) {
    return make_constrained_lagrangian(lagrangian, quadrature, q, q_dot);
  }
  return std::make_unique<LagrangianScheme>(lagrangian, quadrature, q, q_dot);
}

}  // namespace rubato
