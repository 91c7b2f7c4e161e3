#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <rubato/ode/constraints.hpp>
#include <rubato/ode/one_step_state.hpp>
#include <rubato/solve/dense_solver.hpp>

namespace rubato {

/// H_p(z), and H_pp(z) beside entries of G.
class KineticDerivatives {
public:
  /// \param T H, or its part that depends on momenta \param variables coordinates, then as many momenta
  KineticDerivatives(formula::Expression T, std::span<const formula::Expression> variables,
                     const Constraints& constraints);

  void evaluate(const double* z) { outputs_ = first_.at(z); }
  [[nodiscard]] double value() const { return outputs_[0]; }
  [[nodiscard]] const double* velocity() const { return outputs_ + 1; }
  /// matrix = length·G_1 H_pp(z) G_0ᵀ, of the entries of G_1 and G_0.
  void multiplier_matrix(const double* z, double length, const Eigen::VectorXd& entries_1,
                         const Eigen::VectorXd& entries_0, Eigen::MatrixXd& matrix);

private:
  /// An entry of H_pp times one of G_0, added to one of G_0 H_pp.
  struct Term {
    std::size_t second, entry, target;
  };

  formula::ScalarEvaluator first_, second_;
  std::vector<Constraints::Place> places_;  ///< of G
  std::vector<Term> terms_;
  std::vector<double> product_;  ///< G_0 H_pp, a column for each momentum
  std::size_t count_;
  const double* outputs_ = nullptr;
};

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

  /// \param T as KineticDerivatives \param unknowns of a step, about proportional to its length
  ConstrainedState(const Hamiltonian& hamiltonian, formula::Expression T, Index unknowns, std::span<const double> z_0);

  /// A trial step from unknowns_, which it improves; fills in δ, but for the projection, and the discrete energy, and
  /// leaves the constraints evaluated at its end.
  [[nodiscard]] virtual Status step(double h) = 0;
  /// The derivatives of step(), of columns as for linearise(), or for tangent() with no energies. It takes the step
  /// once more with the multipliers known, ends with the constraints evaluated at its end and with at_end_ there, p
  /// before the projection.
  [[nodiscard]] virtual Status vary_step(Columns columns, double h, std::span<double> energies) = 0;
  /// Unknowns to begin with where nothing is known of other steps.
  virtual void start_on_tangent(double h) = 0;
  /// Where what begins at this level is not known.
  virtual void forget_level() {}

  /// The numbers from `first` to `last` of z + δ, into at_end_.
  void displace(Index first, Index last) {
    for (Index i = first; i < last; ++i) {
      at_end_[i] = z_.value()[i] + (z_.low()[i] + delta_[i]);
    }
  }
  /// Factors length·G H_pp G_0ᵀ at at_end_. \return Status::undefined where constraints depend on each other
  [[nodiscard]] Status factor(double length, const Eigen::VectorXd& entries_0);
  /// δp -= ∂²(μᵀg)/∂q∂q δq at q, the part of a kick Gᵀμ that G has.
  void vary_gradients(const double* q, const Eigen::Ref<const Eigen::VectorXd>& mu, Columns columns);

  Constraints constraints_;
  Index n_, c_;
  ConstraintEvaluator at_;
  KineticDerivatives kinetic_;
  solve::DenseSolver multiplier_solver_;
  Eigen::VectorXd unknowns_;                  ///< of the trial
  Eigen::VectorXd at_end_, rates_;            ///< z_{k+1} as far as it is known
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

  std::vector<std::string> q_names_;
  formula::SumSizeEvaluator energy_size_;
  Eigen::MatrixXd matrix_;
  Eigen::VectorXd nu_;  ///< multipliers of the projection
  std::optional<Second> second_;
  double trial_h_ = 0.0, last_h_ = 0.0;  ///< 0 where there is no trial, or no step
};

}  // namespace rubato
