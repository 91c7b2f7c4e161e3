#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/ode/constrained_kick.hpp>
#include <rubato/ode/constraints.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace rubato {

/// What schemes for H with constraints share. Their unknowns, multipliers among them, begin from a trial at the same
/// level, or from those of the last steps, extrapolated; and steps end with p -= Gᵀν such that G H_p = 0.
class ConstrainedState : public OneStepState<Eigen::VectorXd> {
public:
  [[nodiscard]] bool has_node_law() const override { return false; }
  [[nodiscard]] bool solves_fully() const override { return true; }
  [[nodiscard]] Status advance(double h, double accuracy) final;
  /// Of the variations of constrained states it is the derivative of the step; of others that of the step's equations,
  /// which lead to the constraints from wherever it begins.
  [[nodiscard]] Status tangent(std::span<double> columns) final { return vary(columns, {}); }
  [[nodiscard]] Status linearise(std::span<double> columns, std::span<double> energies) final {
    return vary(columns, energies);
  }
  /// Along H_pp Gᵀ and Gᵀ, so that it does not depend on units.
  [[nodiscard]] Status project_variations(std::span<double> columns) override;
  [[nodiscard]] double discrete_energy() const override { return energy_; }
  [[nodiscard]] double discrete_energy_slope() const override { return slope_by_nodes(energy_, trial_h_); }
  [[nodiscard]] bool slope_costs_more() const override { return true; }
  [[nodiscard]] bool slope_to_leading_order() const override { return true; }
  [[nodiscard]] formula::SumSize energy_size() override;
  [[nodiscard]] int iterations() const override { return iterations_; }
  void accept() override;
  void restart(std::span<const double> z) override;
  void save(StateWriter& state) const override;
  void restore(StateReader& state) override;
  [[nodiscard]] std::string failure_reason() const override {
    return dependence_near(dependent_, q_names_, at_end_.head(n_));
  }

  /// Requires G H_p = 0 to rounding at the start. \throws std::invalid_argument, with the momenta that satisfy it
  void check_start(std::span<const std::string> p_names);

protected:
  using Index = Eigen::Index;
  using Columns = Eigen::Map<Eigen::MatrixXd>;  ///< variations (δq, δp)

  /// \param unknowns of a step, about proportional to its length
  ConstrainedState(const Hamiltonian& hamiltonian, Index unknowns, std::span<const double> z_0);

  /// A trial step from unknowns_, which it improves; leaves its end, before the projection, in point_, and the discrete
  /// energy.
  [[nodiscard]] virtual Status step(double h) = 0;
  /// The derivatives of step(), of columns as for linearise(), or for tangent() with no energies. It takes the step
  /// once more with the multipliers known, ends with the constraints evaluated at its end and with at_end_ there, p
  /// before the projection.
  [[nodiscard]] virtual Status vary_step(Columns columns, double h, std::span<double> energies) = 0;
  /// Unknowns to begin with where nothing is known of other steps.
  virtual void start_on_tangent(double h) = 0;
  /// Where what begins at this level is not known.
  virtual void forget_level() {}

  /// Factors the matrix of the multipliers. \return Status::undefined where constraints depend on each other
  [[nodiscard]] Status factor(const ConstrainedKick& kick);
  /// Replaces rates_ by its solution.
  void solve_multipliers();
  /// δp -= ∂²(μᵀg)/∂q∂q δq at q, the part of a kick Gᵀμ that G has.
  void vary_gradients(const double* q, const Eigen::Ref<const Eigen::VectorXd>& mu, Columns columns);

  Constraints constraints_;
  Index n_, c_;
  ConstraintEvaluator at_;
  Eigen::VectorXd unknowns_;                  ///< of the trial
  KickPoint point_;                           ///< where the trial stands
  Eigen::VectorXd at_end_, rates_;            ///< z_{k+1}
  double energy_ = 0.0;                       ///< of the trial
  double rounding_magnitude_ = 1.0;           ///< that of energy_size(), beside one evaluation of H
  VelocityHistory<Eigen::VectorXd> history_;  ///< of unknowns_
  Eigen::VectorXd errors_;                    ///< work space of 2n
  int iterations_ = 0;
  std::string dependent_;  ///< the constraint that made the trial fail

private:
  /// Where tangents are asked for.
  struct Second {
    ConstraintCurvature curvature;
    Eigen::VectorXd gradient;
    Eigen::MatrixXd hessian, block;
  };

  [[nodiscard]] Second& second();
  [[nodiscard]] Status vary(std::span<double> columns, std::span<double> energies);
  /// Derivatives of p -= Gᵀν with G H_p = 0, ν known, at at_end_, where the constraints are evaluated.
  [[nodiscard]] Status vary_projection(const Eigen::VectorXd& nu, Columns columns);
  [[nodiscard]] NodeEnergy node_at(const Eigen::VectorXd& z) override;
  void start_level();
  [[nodiscard]] bool continue_from_before(double h);
  [[nodiscard]] Status project();
  [[nodiscard]] Status factor_there();

  std::vector<std::string> q_names_;
  ConstrainedKick projection_;
  formula::SumSizeEvaluator energy_size_;
  solve::DenseSolver multiplier_solver_;
  Eigen::VectorXd multiplier_units_;
  Eigen::MatrixXd matrix_;
  Eigen::VectorXd nu_;  ///< multipliers of the projection
  std::optional<Second> second_;
  double trial_h_ = 0.0, last_h_ = 0.0;  ///< 0 where there is no trial, or no step
};

}  // namespace rubato
