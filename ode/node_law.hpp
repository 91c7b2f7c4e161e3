#pragma once

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
  /// Γ is `factor` times fᵀH_zz f; with a factor that is NaN nothing is known of it, and Γ is told as NaN.
  explicit NodeLaw(const Hamiltonian& hamiltonian, double factor = 1.0) : evaluator_(hamiltonian), factor_(factor) {}
  /// \throws std::invalid_argument as generating_order and GeneratingFunction
  NodeLaw(const Hamiltonian& hamiltonian, const Eigen::MatrixXd& F, int order)
      : evaluator_(hamiltonian),
        order_(generating_order(order, F).order),
        generating_(std::in_place, hamiltonian, F, order_) {}

  /// The exponent s of the step law.
  [[nodiscard]] int order() const { return order_; }
  /// At z (2n entries). Γ is NaN where H has no Taylor expansion, for the caller to judge.
  [[nodiscard]] NodeEnergy operator()(const double* z);
  /// Why Γ was last NaN.
  [[nodiscard]] std::string failure_reason() const { return generating_ ? generating_->failure() : std::string(); }

private:
  HamiltonianEvaluator evaluator_;
  double factor_ = 1.0;
  int order_ = 2;
  std::optional<GeneratingFunction> generating_;
};

}  // namespace rubato
