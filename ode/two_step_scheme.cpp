#include <rubato/ode/two_step_scheme.hpp>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/increment.hpp>
#include <rubato/ode/tuning.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace rubato {

namespace {

using namespace tuning::two_step;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

class TwoStepScheme final : public SegmentScheme {
public:
  TwoStepScheme(std::unique_ptr<DiscreteAction> action, const Hamiltonian& hamiltonian, std::optional<NodeLaw> law,
                const SegmentNode& first, const SegmentNode& second)
      : action_(std::move(action)),
        law_(std::move(law)),
        node_energy_(hamiltonian),
        size_(static_cast<Index>(action_->element().values)),
        corners_(action_->element().size()),
        gradient_(static_cast<Index>(action_->element().size())),
        hessian_(gradient_.size(), gradient_.size()),
        z_(VectorXd(Eigen::Map<const VectorXd>(first.z.data(), size_))),
        history_(size_),
        t_(first.t),
        factors_(static_cast<int>(size_)) {
    for (VectorXd* vector : {&delta_, &rate_, &correction_, &momentum_, &point_}) {
      vector->setZero(size_);
    }
    delta_ = Eigen::Map<const VectorXd>(second.z.data(), size_) - z_.value();
    trial_h_ = second.t - first.t;
    place(trial_h_);
    action_->gradient(corners_, gradient_);
    action_->hessian(corners_, hessian_);
    if (!gradient_.allFinite() || !hessian_.allFinite()) {
      throw std::invalid_argument(
          "the discrete Lagrangian or one of its derivatives is not finite at the starting pair");
    }
    mixed_ = hessian_.block(first_value(0), first_value(1), size_, size_);
    if (factors_.factor(mixed_.data()) != Status::success) {
      throw std::invalid_argument(
          "the discrete Lagrangian is degenerate: its mixed derivatives by the values of both levels form a singular "
          "matrix at the starting pair, so that two levels do not determine the next one; name every coordinate and "
          "momentum at both levels, such as (p_0 + p_1)/2");
    }
    autonomous_ = is_autonomous(*action_, corners_);
    if (autonomous_) {
      place(trial_h_);
      action_->gradient(corners_, gradient_);
    }
    momentum_ = -gradient_.segment(first_value(0), size_);
    target_ = gradient_[time(0)];
    first_delta_ = delta_;
  }

  [[nodiscard]] std::size_t dimension() const override { return static_cast<std::size_t>(size_); }
  [[nodiscard]] std::span<const double> state() const override { return as_span(z_.value()); }

  [[nodiscard]] Status advance(double h, double accuracy) override {
    if (!factored_) {
      if (history_.empty()) {
        delta_ = first_delta_;
      } else {
        history_.predict(h, delta_);
      }
      if (!factor(h)) {
        return Status::undefined;
      }
    } else {
      delta_ += (h - trial_h_) * rate_;
    }
    trial_h_ = h;
    StagnationTest test(accuracy);
    int stalls = 0;
    for (int iteration = 0; iteration < most_iterations; ++iteration) {
      place(h);
      action_->gradient(corners_, gradient_);
      ++iterations_;
      correction_ = -(gradient_.segment(first_value(0), size_) + momentum_);
      const double residual = history_.relative_size(correction_, delta_, z_.value());
      factors_.solve(correction_.data());
      delta_ += correction_;
      const double size = history_.relative_size(correction_, delta_, z_.value());
      if (!std::isfinite(size) || !std::isfinite(gradient_[time(0)])) {
        factored_ = false;
        return Status::undefined;
      }
      const auto verdict = test.judge(size, residual);
      stalls += verdict == StagnationTest::Verdict::stalled ? 1 : 0;
      if (verdict == StagnationTest::Verdict::done || stalls == rounding_stalls ||
          (verdict != StagnationTest::Verdict::again && is_rounding())) {
        // E at the corrected point; its total derivative follows dz_1/dh along the solved step.
        place(h);
        action_->gradient(corners_, gradient_);
        ++iterations_;
        energy_ = gradient_[time(0)];
        slope_ = energy_slope_ + energy_row_.dot(rate_);
        return std::isfinite(energy_) ? Status::success : Status::undefined;
      }
      if (verdict != StagnationTest::Verdict::again && !factor(h)) {
        return Status::undefined;
      }
    }
    factored_ = false;
    return Status::not_converged;
  }

  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] formula::SumSize energy_size() override {
    place(trial_h_);
    return action_->energy_size(corners_);
  }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_; }
  [[nodiscard]] std::optional<double> energy_target() const override {
    return autonomous_ ? std::nullopt : std::optional(target_);
  }
  [[nodiscard]] int order() const override { return law_ ? law_->order() : 2; }
  [[nodiscard]] bool has_gamma() const override { return law_.has_value(); }
  [[nodiscard]] double gamma_factor() const override {
    return law_ ? law_->gamma_factor() : std::numeric_limits<double>::quiet_NaN();
  }
  [[nodiscard]] int iterations() const override { return iterations_; }
  [[nodiscard]] bool has_node_law() const override { return false; }

  [[nodiscard]] NodeEnergy node() override { return node_at(z_.value()); }

  void accept() override {
    place(trial_h_);
    action_->gradient(corners_, gradient_);
    momentum_ = gradient_.segment(first_value(1), size_);
    target_ = -gradient_[time(1)];
    history_.record(trial_h_, delta_);
    z_.add(delta_);
    t_ += trial_h_;
    factored_ = false;
    iterations_ = 0;
  }

  void save(StateWriter& state) const override {
    z_.save(state);
    history_.save(state);
    state.write(as_span(momentum_));
    state.write(target_);
    state.write(t_);
  }

  void restore(StateReader& state) override {
    z_.restore(state);
    history_.restore(state);
    state.read(as_span(momentum_));
    state.read(target_);
    state.read(t_);
    factored_ = false;
    iterations_ = 0;
  }

private:
  [[nodiscard]] Index time(std::size_t corner) const {
    return static_cast<Index>(action_->element().coordinate(corner, 0));
  }
  [[nodiscard]] Index first_value(std::size_t corner) const {
    return static_cast<Index>(action_->element().value(corner, 0));
  }

  /// Writes (t_k, z_k, t_k + h, z_k + δ) into the corner vector; where t_k does not matter, 0 in its place: t_k + h
  /// would round h away.
  void place(double h) {
    Eigen::Map<VectorXd> corners(corners_.data(), static_cast<Index>(corners_.size()));
    const double start = autonomous_ ? 0.0 : t_;
    corners[time(0)] = start;
    corners[time(1)] = start + h;
    corners.segment(first_value(0), size_) = z_.value();
    z_.displaced(1.0, delta_, point_);
    corners.segment(first_value(1), size_) = point_;
  }

  /// True if the last digits of the corners and of the terms of each row explain ∂A/∂z_0 + p as evaluated last.
  [[nodiscard]] bool is_rounding() const {
    const Eigen::Map<const VectorXd> corners(corners_.data(), static_cast<Index>(corners_.size()));
    for (Index i = 0; i < size_; ++i) {
      const Index row = first_value(0) + i;
      double bound = std::abs(momentum_[i]) + std::abs(gradient_[row]);
      for (const std::size_t corner : {std::size_t{0}, std::size_t{1}}) {
        const Index first = first_value(corner);
        bound += hessian_.row(row).segment(first, size_).cwiseAbs().dot(corners.segment(first, size_).cwiseAbs());
      }
      if (!(std::abs(gradient_[row] + momentum_[i]) <= roundings * std::numeric_limits<double>::epsilon() * bound)) {
        return false;
      }
    }
    return true;
  }

  /// Factors ∂²A/∂z_0∂z_1 at the present δ, and takes what dE/dh needs from the same second variation.
  bool factor(double h) {
    place(h);
    action_->hessian(corners_, hessian_);
    ++iterations_;
    mixed_ = hessian_.block(first_value(0), first_value(1), size_, size_);
    factored_ = hessian_.allFinite() && factors_.factor(mixed_.data()) == Status::success;
    if (!factored_) {
      return false;
    }
    rate_ = -hessian_.block(first_value(0), time(1), size_, 1);
    factors_.solve(rate_.data());
    energy_row_ = hessian_.block(time(0), first_value(1), 1, size_).transpose();
    energy_slope_ = hessian_(time(0), time(1));
    return true;
  }

  NodeEnergy node_at(const VectorXd& z) {
    return law_ ? (*law_)(z.data())
                : NodeEnergy{.energy = node_energy_.value(z.data()), .gamma = std::numeric_limits<double>::quiet_NaN()};
  }

  std::unique_ptr<DiscreteAction> action_;
  std::optional<NodeLaw> law_;
  HamiltonianEvaluator node_energy_;
  Index size_;
  std::vector<double> corners_;
  VectorXd gradient_;
  MatrixXd hessian_;
  CompensatedState<VectorXd> z_;
  VelocityHistory<VectorXd> history_;
  double t_;
  bool autonomous_ = false;

  VectorXd momentum_;    ///< ∂A_{k-1}/∂z_k
  double target_ = 0.0;  ///< -∂A_{k-1}/∂t_k
  VectorXd first_delta_;

  VectorXd delta_, rate_, correction_, point_, energy_row_;
  double energy_slope_ = 0.0;
  MatrixXd mixed_;  ///< ∂²A/∂z_0∂z_1
  solve::DenseSolver factors_;
  bool factored_ = false;
  double trial_h_ = 0.0;
  double energy_ = 0.0;
  double slope_ = 0.0;
  int iterations_ = 0;
};

}  // namespace

std::unique_ptr<SegmentScheme> make_two_step_scheme(std::unique_ptr<DiscreteAction> action,
                                                    const Hamiltonian& hamiltonian, const SegmentNode& first,
                                                    const SegmentNode& second, std::optional<NodeLaw> law) {
  const Element& element = action->element();
  if (element.corners != 2 || element.coordinates != 1 || element.values != first.z.size() ||
      element.values != second.z.size() || element.values != 2 * hamiltonian.degrees_of_freedom()) {
    throw std::invalid_argument(
        fmt::format("a starting pair with {} and {} entries does not fit a segment action with {} values and a "
                    "Hamiltonian of {} variables",
                    first.z.size(), second.z.size(), element.values, 2 * hamiltonian.degrees_of_freedom()));
  }
  if (!(std::isfinite(first.t) && std::isfinite(second.t)) || first.t == second.t) {
    throw std::invalid_argument(
        fmt::format("the times of a starting pair must be finite and differ; got {} and {}", first.t, second.t));
  }
  return std::make_unique<TwoStepScheme>(std::move(action), hamiltonian, std::move(law), first, second);
}

}  // namespace rubato
