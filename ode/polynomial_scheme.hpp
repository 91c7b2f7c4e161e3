#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

#include <rubato/ode/increment.hpp>
#include <rubato/ode/legendre.hpp>
#include <rubato/ode/polynomial_action.hpp>
#include <rubato/ode/segment_scheme.hpp>

namespace rubato {

/// What schemes by the action of a polynomial share: velocities at both levels, the polynomial that Newton's method
/// begins from, and whether it stayed on the branch of the step.
class PolynomialScheme : public OneStepScheme {
public:
  [[nodiscard]] std::size_t dimension() const override { return static_cast<std::size_t>(2 * n_); }
  [[nodiscard]] std::span<const double> state() const override { return as_span(z_.value()); }
  [[nodiscard]] std::span<const double> velocities() override {
    static_cast<void>(node());
    return as_span(std::as_const(velocity_));
  }
  [[nodiscard]] int order() const override { return action_.quadrature.order(); }
  [[nodiscard]] double discrete_energy() const override { return energy_; }
  /// By the node laws at both ends, E - H = (s+1) h^s η + O(h^(s+1)) with signs that agree (theory, section 8).
  [[nodiscard]] double discrete_energy_slope() const override {
    return order() * (energy_ - 0.5 * (here_->energy + there_.energy)) / trial_h_;
  }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override;
  [[nodiscard]] int iterations() const override { return iterations_; }
  [[nodiscard]] NodeEnergy node() override {
    if (!here_) {
      here_ = read(z_.value(), seed_, velocity_);
    }
    return *here_;
  }

  void restart(std::span<const double> z) override;
  void save(StateWriter& state) const override;
  void restore(StateReader& state) override;
  /// The velocities near which those of the next level are sought, and the usual increments.
  void save_guesses(StateWriter& state) const override;
  void restore_guesses(StateReader& state) override;

protected:
  using Index = Eigen::Index;
  using VectorXd = Eigen::VectorXd;
  using MatrixXd = Eigen::MatrixXd;

  /// What a step is solved for, a column for each control point.
  struct Unknowns {
    MatrixXd Y;   ///< q at the control points but the first, less q_k
    MatrixXd mu;  ///< multipliers at the control points but the last, about proportional to h
  };

  /// \param constraints how many \param beside_others share of the largest usual increment that is usual for every
  /// coordinate
  PolynomialScheme(const Lagrangian& lagrangian, const ActionQuadrature& quadrature, std::span<const double> q,
                   std::span<const double> q_dot, Index constraints, double beside_others);

  /// Newton's method for x_.
  [[nodiscard]] virtual Status iterate(double h, double accuracy) = 0;
  /// H and Γ at z, and the velocities there, found from `from`.
  [[nodiscard]] virtual NodeEnergy read(const VectorXd& z, const VectorXd& from, VectorXd& velocity) = 0;
  virtual void start_level();
  /// Where the motion is fast to change, the tangent is no neighbour of the step.
  virtual void start_on_parabola(double h) { start_on_tangent(h); }

  void start_on_tangent(double h);
  /// The unknowns to begin with: those of a trial already made at this level, the last step's continued, or the
  /// tangent. \return whether by what was made before
  bool start(double h);
  /// iterate(), and whether what it found is the step: Newton's method may end far away, at a polynomial that no motion
  /// has anything to do with.
  [[nodiscard]] Status iterate_nearby(double h, double accuracy);
  /// The step on the branch that begins with h = 0, from a shorter one in lengths that grow ever less.
  [[nodiscard]] Status approach(double h, double accuracy);
  /// What was found is that of a trial at this level.
  void remember_trial(double h);
  /// What was found is that of the last step, and z_ its end, with velocities near `seed`.
  void move_on(const VectorXd& seed);

  PolynomialAction action_;
  LegendreTransform transform_;
  Index n_, d_;
  CompensatedState<VectorXd> z_;
  VectorXd seed_;                       ///< velocities that those at this level are found from
  VectorXd velocity_, trial_velocity_;  ///< at both levels, where here_ and there_ are known
  std::optional<NodeEnergy> here_;
  NodeEnergy there_;
  Unknowns x_;
  bool far_ = false;  ///< whether the last iteration ended far from where it began
  VectorXd usual_;    ///< the largest increments since construction, of other runs of the scheme as well
  double trial_h_ = 0.0, last_h_ = 0.0, energy_ = 0.0;
  int iterations_ = 0;

private:
  void continue_from(const Unknowns& from, double origin, double theta);

  formula::SumSizeEvaluator energy_size_;
  double beside_others_;
  Unknowns last_, trial_, shorter_;  ///< of the last step; of a trial; of a shorter step, to continue
  MatrixXd begun_;                   ///< where an iteration began
  VectorXd point_, errors_, weights_, last_end_;
  double known_trial_h_ = 0.0;  ///< of trial_; 0 where there is none
};

}  // namespace rubato
