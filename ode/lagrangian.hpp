#pragma once

#include <map>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/ode/constraints.hpp>

namespace rubato {

/// A Lagrangian L(q, q̇) with n coordinates, stated once, as a formula or as a generic lambda: the motion makes the
/// integral of L stationary, d/dt ∂L/∂q̇ = ∂L/∂q.
///
/// Momenta are p = ∂L/∂q̇, the energy is E(q, q̇) = q̇·∂L/∂q̇ - L, which is H(q, p) at these momenta. L has to fix every
/// velocity by the momenta, that is to be regular: ∂²L/∂q̇² is invertible along the orbit (LegendreTransform).
/// Immutable and cheap to copy; may be shared between threads. Evaluation is through LagrangianEvaluator.
class Lagrangian {
public:
  using Parameters = std::map<std::string, double>;

  /// L as a formula in the names `q`, the same with suffix _dot for the velocities, and `parameters`.
  /// \throws formula::ParseError; std::invalid_argument for no coordinates or a name used twice
  Lagrangian(std::vector<std::string> q, std::string_view L, const Parameters& parameters = {});

  /// L from an expression in a graph whose variables `q` and `q_dot` name coordinates and velocities.
  Lagrangian(std::shared_ptr<formula::Graph> graph, std::vector<std::string> q, std::vector<std::string> q_dot,
             formula::Expression L);

  /// L as a generic lambda `(auto q, auto q_dot)`, called once with vectors of `n` expressions; the coordinates are
  /// called q1 … qn.
  template <typename Function>
  Lagrangian(std::size_t n, Function&& L);

  [[nodiscard]] std::size_t degrees_of_freedom() const { return q_names_.size(); }
  [[nodiscard]] const std::vector<std::string>& q_names() const { return q_names_; }
  [[nodiscard]] const std::vector<std::string>& velocity_names() const { return velocity_names_; }
  /// The graph in which expression() and variables() live.
  [[nodiscard]] const std::shared_ptr<formula::Graph>& graph() const { return graph_; }
  [[nodiscard]] formula::Expression expression() const { return expression_; }
  [[nodiscard]] const std::vector<formula::Expression>& variables() const { return variables_; }  ///< q, then q̇
  /// E = q̇·∂L/∂q̇ - L
  [[nodiscard]] formula::Expression energy() const { return energy_; }

  /// The constant c that was added to L, and L - c, of which the motion is computed: E is less by c.
  [[nodiscard]] double constant() const { return constant_; }
  [[nodiscard]] const Lagrangian& without_constant() const { return reduced_ ? *reduced_ : *this; }

  /// The same L with the motion restricted to g(q) = 0 (theory, section 13).
  [[nodiscard]] Lagrangian constrained(const Constraints& constraints) const;
  [[nodiscard]] const Constraints& constraints() const { return constraints_; }

  [[nodiscard]] const formula::Bytecode& gradient_code() const { return *gradient_; }  ///< L, ∂L/∂q, ∂L/∂q̇
  /// The same, then the upper triangle of the Hessian in (q, q̇).
  [[nodiscard]] const formula::Bytecode& hessian_code() const { return *hessian_; }
  /// For a formula::SumSizeEvaluator: how large the terms of E are, and the rounding error of E.
  [[nodiscard]] const formula::Bytecode& energy_size_code() const { return *energy_size_; }

private:
  static std::vector<std::string> numbered(std::size_t n);
  static std::vector<std::string> dotted(const std::vector<std::string>& q);
  void declare();
  void compile();

  std::shared_ptr<formula::Graph> graph_;
  std::vector<std::string> q_names_, velocity_names_;
  std::vector<formula::Expression> variables_;
  formula::Expression expression_, energy_;
  double constant_ = 0.0;
  std::shared_ptr<const Lagrangian> reduced_;  ///< L - c, if c is not 0
  Constraints constraints_;
  std::shared_ptr<const formula::Bytecode> gradient_, hessian_, energy_size_;
};

template <typename Function>
Lagrangian::Lagrangian(std::size_t n, Function&& L)
    : graph_(std::make_shared<formula::Graph>()), q_names_(numbered(n)), velocity_names_(dotted(q_names_)) {
  declare();
  const auto middle = variables_.begin() + static_cast<std::ptrdiff_t>(n);
  const auto traced = L(std::vector<formula::Expression>(variables_.begin(), middle),
                        std::vector<formula::Expression>(middle, variables_.end()));
  if constexpr (formula::Scalar<std::remove_cvref_t<decltype(traced)>>) {
    expression_ = graph_->constant(static_cast<double>(traced));
  } else {
    expression_ = traced;
  }
  compile();
}

/// Evaluates L and its derivatives at one point. Holds work space: one per thread. No allocation after construction.
class LagrangianEvaluator {
public:
  explicit LagrangianEvaluator(const Lagrangian& lagrangian);

  /// L at `inputs` (q, q̇), ∇L into `gradient` (2n entries: ∂L/∂q, ∂L/∂q̇), and the full symmetric Hessian into `hessian`
  /// (2n × 2n). What is outside L's domain comes back as NaN or infinity, for the caller to judge.
  double hessian(const double* inputs, double* gradient, double* hessian);
  /// L and ∇L alone.
  double gradient(const double* inputs, double* gradient);

private:
  std::size_t size_;
  formula::ScalarEvaluator gradient_, hessian_;
};

/// An L that does not fix velocities by momenta.
class SingularLagrangianError : public std::invalid_argument {
public:
  using std::invalid_argument::invalid_argument;
};

/// p = ∂L/∂q̇ at (q, q̇), n entries each. \throws std::invalid_argument, with the values, if sizes do not fit, or q, q̇, L
/// or its derivatives are not finite there; SingularLagrangianError if ∂²L/∂q̇² is singular there, with what of the
/// velocities L leaves free
[[nodiscard]] std::vector<double> momenta(const Lagrangian& lagrangian, std::span<const double> q,
                                          std::span<const double> q_dot);

}  // namespace rubato
