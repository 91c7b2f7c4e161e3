#pragma once

#include <limits>
#include <optional>
#include <string>

#include <rubato/ode/generating_action.hpp>
#include <rubato/ode/generating_function.hpp>
#include <rubato/ode/hamiltonian.hpp>
#include <rubato/variation/level_scheme.hpp>

namespace rubato {

/// What the choice of time levels reads at a node of an orbit: H, and Γ = fᵀH_zz f for schemes of order 2 (theory,
/// section 3), or -24 φ^(s+1), which is the same for s = 2, for a generating function's scheme of order s. Other
/// families have -24 η in its place (theory, section 8), where that is known in closed form.
class NodeLaw {
public:
  /// Γ is `factor` times fᵀH_zz f; with a factor that is NaN nothing is known of it, and Γ is reported as NaN.
  explicit NodeLaw(const Hamiltonian& hamiltonian, double factor = 1.0) : evaluator_(hamiltonian), factor_(factor) {}
  /// \throws std::invalid_argument as generating_order and GeneratingFunction
  NodeLaw(const Hamiltonian& hamiltonian, const Eigen::MatrixXd& F, int order)
      : evaluator_(hamiltonian),
        factor_(gamma_factor(F, generating_order(order, F).order)),
        order_(generating_order(order, F).order),
        generating_(std::in_place, hamiltonian, F, order_) {}

  /// What it has as Γ over fᵀH_zz f; NaN where that is no multiple of it, or not known.
  [[nodiscard]] double gamma_factor() const { return factor_; }
  /// The exponent s of the step law.
  [[nodiscard]] int order() const { return order_; }
  /// At z (2n entries). Γ is NaN where H has no Taylor expansion, for the caller to judge.
  [[nodiscard]] NodeEnergy operator()(const double* z);
  /// Why Γ was last NaN.
  [[nodiscard]] std::string failure_reason() const { return generating_ ? generating_->failure() : std::string(); }

  /// Of a generating function's scheme of that order: -24 φ³ is Γ for F = 0.
  [[nodiscard]] static double gamma_factor(const Eigen::MatrixXd& F, int order) {
    return F.isZero(0.0) && order == 2 ? 1.0 : std::numeric_limits<double>::quiet_NaN();
  }

private:
  HamiltonianEvaluator evaluator_;
  double factor_ = 1.0;
  int order_ = 2;
  std::optional<GeneratingFunction> generating_;
};

}  // namespace rubato
