#include <rubato/ode/lagrangian_scheme.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <rubato/base/all_finite.hpp>
#include <rubato/base/limits.hpp>
#include <rubato/formula/rounding.hpp>
#include <rubato/ode/constrained_lagrangian.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/legendre.hpp>
#include <rubato/ode/polynomial_action.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace rubato {

namespace {

using namespace tuning::of_lagrangian;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

std::vector<double> joined(std::span<const double> q, std::span<const double> p) {
  std::vector<double> z(q.begin(), q.end());
  z.insert(z.end(), p.begin(), p.end());
  return z;
}
VectorXd vector_of(std::span<const double> values) {
  return Eigen::Map<const VectorXd>(values.data(), static_cast<Index>(values.size()));
}

class LagrangianScheme final : public OneStepScheme {
public:
  LagrangianScheme(const Lagrangian& lagrangian, const ActionQuadrature& quadrature, std::span<const double> q,
                   std::span<const double> q_dot)
      : lagrangian_(lagrangian),
        action_(lagrangian, quadrature),
        transform_(lagrangian),
        energy_size_(lagrangian.energy_size_code()),
        rounding_(lagrangian.gradient_code()),
        n_(static_cast<Index>(q.size())),
        d_(quadrature.degree),
        m_(quadrature.nodes.size()),
        factors_(static_cast<int>(n_ * d_)),
        z_(vector_of(joined(q, momenta(lagrangian, q, q_dot)))),
        seed_(vector_of(q_dot)) {
    for (MatrixXd* matrix : {&Y_, &last_Y_, &trial_Y_, &begun_, &shorter_, &correction_, &residual_, &bounds_}) {
      matrix->setZero(n_, d_);
    }
    changes_.setZero(2 * n_);
    matrix_.setZero(n_ * d_, n_ * d_);
    weights_.setZero(d_ + 1);
    last_end_.setZero(n_);
    for (VectorXd* vector : {&delta_, &lost_, &largest_, &usual_, &end_, &sums_, &errors_}) {
      vector->setZero(2 * n_);
    }
    for (VectorXd* vector : {&velocity_, &trial_velocity_, &acceleration_, &seed_at_level_}) {
      vector->setZero(n_);
    }
  }

  [[nodiscard]] std::size_t dimension() const override { return static_cast<std::size_t>(2 * n_); }
  [[nodiscard]] std::span<const double> state() const override { return as_span(z_.value()); }
  [[nodiscard]] std::span<const double> velocities() override {
    static_cast<void>(node());
    return as_span(std::as_const(velocity_));
  }
  [[nodiscard]] int order() const override { return action_.quadrature.order(); }
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
    const auto varied_point = [&](const auto& column, Index j) {  // of (q, q̇) at a quadrature point
      changes_.head(n_).noalias() = correction_.lazyProduct(action_.quadrature.values.row(j).tail(d_).transpose());
      changes_.head(n_) += column.head(n_);
      changes_.tail(n_).noalias() = correction_.lazyProduct(action_.quadrature.rates.row(j).tail(d_).transpose());
      changes_.tail(n_) /= trial_h_;
      errors_.noalias() = action_.hessians.middleCols(2 * n_ * j, 2 * n_).lazyProduct(changes_);
    };
    for (std::size_t first = 0; first < columns.size(); first += dimension()) {
      Eigen::Map<VectorXd> column(columns.data() + first, 2 * n_);
      residual_.setZero();
      residual_.col(0) = column.tail(n_);
      correction_.setZero();
      for (Index j = 0; j < m_; ++j) {
        varied_point(column, j);
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
        varied_point(column, j);
        sums_.tail(n_) += action_.quadrature.weights[j] * trial_h_ * errors_.head(n_);
      }
      sums_.head(n_) = correction_.col(d_ - 1);
      column += sums_;
    }
    return all_finite(columns) ? Status::success : Status::undefined;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// By the node laws at both ends, E - H = (s+1) h^s η + O(h^(s+1)) with signs that agree (theory, section 8).
  [[nodiscard]] double discrete_energy_slope() const override {
    return order() * (energy_ - 0.5 * (here_->energy + there_.energy)) / trial_h_;
  }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override {
    if (trial_h_ == 0.0) {
      static_cast<void>(node());
      changes_ << z_.value().head(n_), velocity_;
      errors_.head(n_) = 2.0 * changes_.head(n_).cwiseAbs();
    } else {
      changes_ = action_.points.col(m_ / 2);
      errors_.head(n_) = 2.0 * (changes_.head(n_).cwiseAbs() + Y_.col(d_ - 1).cwiseAbs());
    }
    errors_.tail(n_) = 4.0 * changes_.tail(n_).cwiseAbs();
    return energy_size_(as_span(std::as_const(changes_)), as_span(std::as_const(errors_)));
  }
  [[nodiscard]] int iterations() const override { return iterations_; }

  [[nodiscard]] NodeEnergy node() override {
    if (!here_) {
      here_ = read(z_.value(), seed_, velocity_);
    }
    return *here_;
  }

  void accept() override {
    largest_ = largest_.cwiseMax(delta_.cwiseAbs());
    usual_ = usual_.cwiseMax(largest_);
    // The level's velocities are found from those before it, by a resumed run as well.
    seed_ = velocity_;
    z_.add(delta_, lost_);
    std::swap(last_Y_, Y_);
    last_h_ = trial_h_;
    start_level();
  }
  void restart(std::span<const double> z) override {
    if (here_ && std::isfinite(here_->energy)) {
      seed_ = velocity_;
    }
    z_ = CompensatedState<VectorXd>(vector_of(z));
    largest_.setZero();
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
    for (const VectorXd* vector : {&seed_, &largest_, &usual_}) {
      state.write(as_span(*vector));
    }
    state.write({last_Y_.data(), static_cast<std::size_t>(last_Y_.size())});
  }
  void restore(StateReader& state) override {
    z_.restore(state);
    state.read(last_h_);
    for (VectorXd* vector : {&seed_, &largest_, &usual_}) {
      state.read(as_span(*vector));
    }
    state.read(std::span<double>(last_Y_.data(), static_cast<std::size_t>(last_Y_.size())));
    start_level();
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
  void start_level() {
    here_.reset();
    known_ = false;
    failure_ = Failure::none;
    trial_h_ = 0.0;
    iterations_ = 0;
  }

  /// What the iteration found, as the trial.
  [[nodiscard]] Status end_trial(Status status, double h) {
    if (status != Status::success) {
      return status;
    }
    finish(h);
    if (!known_) {
      trial_Y_ = Y_;
      known_trial_h_ = h;
      known_ = true;
    }
    z_.displaced(1.0, delta_, end_);
    there_ = read(end_, velocity_, trial_velocity_);
    return std::isfinite(there_.energy) ? Status::success : Status::undefined;
  }

  /// H and Γ at z, and the velocities there, found from `from`.
  [[nodiscard]] NodeEnergy read(const VectorXd& z, const VectorXd& from, VectorXd& velocity) {
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

  /// The polynomial to begin with: that of a trial already made at this level, the last step's continued, or the
  /// tangent. \return whether by what was made before
  bool start(double h) {
    if (known_ && near(h / known_trial_h_)) {
      continue_from(trial_Y_, 0.0, h / known_trial_h_);
    } else if (last_h_ != 0.0 && near(h / last_h_)) {
      continue_from(last_Y_, 1.0, h / last_h_);
    } else {
      start_on_tangent(h);
      return false;
    }
    return true;
  }
  /// From σ = origin on, over θ steps.
  void continue_from(const MatrixXd& Y, double origin, double theta) {
    last_end_.setZero();
    if (origin != 0.0) {
      last_end_ = Y.col(d_ - 1);
    }
    for (Index i = 0; i < d_; ++i) {
      action_.quadrature.interpolation(origin + theta * action_.quadrature.control[i + 1], weights_);
      Y_.col(i) = -last_end_;
      Y_.col(i).noalias() += Y.lazyProduct(weights_.tail(d_));
    }
  }
  void start_on_tangent(double h) {
    for (Index i = 0; i < d_; ++i) {
      Y_.col(i) = h * action_.quadrature.control[i + 1] * velocity_;
    }
  }
  /// Where the motion is fast to change, the tangent is no neighbour of the step.
  void start_on_parabola(double h) {
    start_on_tangent(h);
    VectorXd& velocity = seed_at_level_;
    velocity = velocity_;
    if (transform_.solve(z_.value().data(), z_.value().data() + n_, velocity.data()) != Status::success ||
        !transform_.acceleration(acceleration_.data())) {
      return;
    }
    for (Index i = 0; i < d_; ++i) {
      const double time = h * action_.quadrature.control[i + 1];
      Y_.col(i) += 0.5 * time * time * acceleration_;
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
        Y_(r, i) = c * (change + rest * (rest * (h * velocity_[r] - change) - c * (h * velocity[r] - change)));
      }
    }
    return true;
  }
  [[nodiscard]] static bool near(double ratio) {
    return ratio > 1.0 / tuning::longest_continuation && ratio < tuning::longest_continuation;
  }

  /// iterate(), and whether what it found is the step: Newton's method may end far away, at a polynomial that no motion
  /// has anything to do with.
  [[nodiscard]] Status iterate_nearby(double h, double accuracy) {
    begun_ = Y_;
    const Status status = iterate(h, accuracy);
    far_ = false;
    for (Index r = 0; r < n_ && status == Status::success; ++r) {
      const double moved = (Y_.row(r) - begun_.row(r)).cwiseAbs().maxCoeff();
      const double usual = std::max(begun_.row(r).cwiseAbs().maxCoeff(), usual_[r]);
      far_ = far_ || (usual_[r] > 0.0 && moved > lagrangian_farthest * usual);
    }
    return far_ ? Status::not_converged : status;
  }

  /// The step on the branch that begins with h = 0, from a shorter one in lengths that grow ever less.
  [[nodiscard]] Status approach(double h, double accuracy) {
    for (int parts = 2; parts <= lagrangian_finest_approach; parts *= 2) {
      double share = 1.0 / parts;
      const double growth = std::pow(share, -1.0 / parts);
      start_on_parabola(share * h);
      Status status = iterate_nearby(share * h, accuracy);
      for (int part = 0; part < parts && status == Status::success; ++part) {
        const double next = part + 1 == parts ? 1.0 : share * growth;
        shorter_ = Y_;
        continue_from(shorter_, 0.0, next / share);
        share = next;
        status = iterate_nearby(share * h, accuracy);
      }
      if (status == Status::success) {
        return status;
      }
    }
    return Status::not_converged;
  }

  [[nodiscard]] Status iterate(double h, double accuracy) {
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
        Y_ -= correction_;
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
        const double sum = Y_(a, d_ - 1) + correction_(a, d_ - 1);
        lost_[a] = correction_(a, d_ - 1) - (sum - Y_(a, d_ - 1));
      }
      Y_ += correction_;
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
    return action_.evaluate(z_, Y_, h);
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
          std::max({Y_.row(r).cwiseAbs().maxCoeff(), largest_[r], correction, epsilon * std::abs(z_.value()[r])});
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
        errors_.tail(n_) += 2.0 / std::abs(h) * std::abs(action_.quadrature.rates(j, i + 1)) * Y_.col(i).cwiseAbs();
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
    delta_.head(n_) = Y_.col(d_ - 1);
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
  PolynomialAction action_;
  LegendreTransform transform_;
  formula::SumSizeEvaluator energy_size_;
  formula::RoundingEvaluator rounding_;
  Index n_, d_, m_;
  solve::DenseSolver factors_;
  CompensatedState<VectorXd> z_;
  VectorXd seed_;                          ///< velocities that those at this level are found from
  VectorXd velocity_, trial_velocity_;     ///< at both levels, where here_ and there_ are known
  VectorXd acceleration_, seed_at_level_;  ///< at this level, where steps begin on a parabola
  std::optional<NodeEnergy> here_;
  NodeEnergy there_;
  MatrixXd Y_, last_Y_, trial_Y_;  ///< q at the control points but the first, less q_k; of the last step; of a trial
  MatrixXd begun_, shorter_;       ///< where an iteration began; of a shorter step, to continue
  bool far_ = false;               ///< whether the last iteration ended far from where it began
  MatrixXd correction_, residual_, bounds_;
  VectorXd changes_, weights_, last_end_;
  MatrixXd matrix_;
  VectorXd delta_, lost_, largest_, end_, sums_, errors_;
  VectorXd usual_;  ///< the largest increments since construction, of other runs of the scheme as well
  double trial_h_ = 0.0, known_trial_h_ = 0.0, last_h_ = 0.0;
  bool known_ = false;  ///< whether trial_Y_ is
  double energy_ = 0.0;
  int iterations_ = 0;
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
