#pragma once

#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/ode/constraints.hpp>

namespace rubato {

/// A Hamiltonian H(q, p) with n coordinates and n momenta, stated once, as a formula or as a generic lambda.
///
/// The state is z = (q, p); z' = J∇H(z), J = [[0, I], [-I, 0]], is q' = H_p, p' = -H_q (theory, section 1).
/// Immutable and cheap to copy; may be shared between threads. Evaluation is through HamiltonianEvaluator.
class Hamiltonian {
public:
  using Parameters = std::map<std::string, double>;

  /// H as a formula in the names `q`, `p` and `parameters`.
  /// \throws formula::ParseError; std::invalid_argument for unequal lengths, no coordinates or a name used twice
  Hamiltonian(std::vector<std::string> q, std::vector<std::string> p, std::string_view H,
              const Parameters& parameters = {});

  /// H from an expression in a graph whose variables `q` and `p` name the state.
  Hamiltonian(std::shared_ptr<formula::Graph> graph, std::vector<std::string> q, std::vector<std::string> p,
              formula::Expression H);

  /// H as a generic lambda `(auto q, auto p)`, called once with vectors of `n` expressions; the coordinates are called
  /// q1 … qn and p1 … pn.
  template <typename Function>
  Hamiltonian(std::size_t n, Function&& H);

  [[nodiscard]] std::size_t degrees_of_freedom() const { return q_names_.size(); }
  [[nodiscard]] const std::vector<std::string>& q_names() const { return q_names_; }
  [[nodiscard]] const std::vector<std::string>& p_names() const { return p_names_; }
  /// The graph in which expression() and variables() live. All copies share it: who takes derivatives or builds other
  /// formulas adds to it, and does so to that of with_own_graph().
  [[nodiscard]] const std::shared_ptr<formula::Graph>& graph() const { return graph_; }
  /// The same H with its formula in a graph that nobody else uses. It shares the code of H.
  [[nodiscard]] Hamiltonian with_own_graph() const;
  [[nodiscard]] formula::Expression expression() const { return expression_; }
  [[nodiscard]] const std::vector<formula::Expression>& variables() const { return variables_; }  ///< q, then p

  /// The constant c that was added to H (formula::separate_constant), and H - c: the motion, its steps and all that is
  /// judged by the rounding of H know nothing of c, so they are computed from H - c.
  [[nodiscard]] double constant() const { return constant_; }
  [[nodiscard]] const Hamiltonian& without_constant() const { return reduced_ ? *reduced_ : *this; }

  /// The same H with the motion restricted to g(q) = 0 (theory, section 13).
  [[nodiscard]] Hamiltonian constrained(const Constraints& constraints) const;
  [[nodiscard]] const Constraints& constraints() const { return constraints_; }

  [[nodiscard]] const formula::Bytecode& value_code() const { return *value_; }
  [[nodiscard]] const formula::Bytecode& gradient_code() const { return *gradient_; }  ///< H, then ∇H
  /// H, ∇H, and the entries of the upper triangle of H_zz that do not vanish identically, at hessian_places(), row by
  /// row: of a chain their number grows like its length.
  ///@{
  struct Place {
    std::size_t row, column;
  };
  [[nodiscard]] const formula::Bytecode& hessian_code() const;
  [[nodiscard]] const std::vector<Place>& hessian_places() const;
  ///@}
  /// H, then Γ = fᵀH_zz f with f = J∇H (theory, section 3): the sum over rows of f_i (H_zz f)_i, each a sum over its
  /// entries.
  ///@{
  [[nodiscard]] const formula::Bytecode& gamma_code() const;
  [[nodiscard]] formula::Expression gamma() const;  ///< in graph(), to which it is added
  ///@}
  /// For a formula::SumSizeEvaluator: how large the terms of H are, and the rounding error of H.
  [[nodiscard]] const formula::Bytecode& size_code() const { return *size_; }

  /// Second derivatives, computed when they are first asked for and shared by all copies.
  class Second;
  [[nodiscard]] const std::shared_ptr<Second>& second() const { return second_; }

private:
  static std::vector<std::string> numbered(std::string_view stem, std::size_t n);
  void compile();

  std::shared_ptr<formula::Graph> graph_;
  std::vector<std::string> q_names_, p_names_;
  std::vector<formula::Expression> variables_;
  formula::Expression expression_;
  double constant_ = 0.0;
  std::shared_ptr<const Hamiltonian> reduced_;  ///< H - c, if c is not 0
  Constraints constraints_;
  std::shared_ptr<const formula::Bytecode> value_, gradient_, size_;
  std::shared_ptr<Second> second_;
};

template <typename Function>
Hamiltonian::Hamiltonian(std::size_t n, Function&& H)
    : graph_(std::make_shared<formula::Graph>()), q_names_(numbered("q", n)), p_names_(numbered("p", n)) {
  std::vector<formula::Expression> q, p;
  for (const std::string& name : q_names_) {
    q.push_back(graph_->variable(name));
  }
  for (const std::string& name : p_names_) {
    p.push_back(graph_->variable(name));
  }
  variables_ = q;
  variables_.insert(variables_.end(), p.begin(), p.end());
  const auto traced = H(q, p);
  if constexpr (formula::Scalar<std::remove_cvref_t<decltype(traced)>>) {
    expression_ = graph_->constant(static_cast<double>(traced));
  } else {
    expression_ = traced;
  }
  compile();
}

/// Evaluates H, ∇H and H_zz at one point. Holds work space: one per thread. No allocation after the first evaluation of
/// each kind.
class HamiltonianEvaluator {
public:
  explicit HamiltonianEvaluator(const Hamiltonian& hamiltonian);

  /// H(z); z has 2n entries. A value outside H's domain comes back as NaN or infinity, for the caller to judge.
  [[nodiscard]] double value(const double* z);
  /// H(z), and ∇H(z) into `gradient` (2n entries).
  double gradient(const double* z, double* gradient);
  /// H(z), ∇H(z), and the full symmetric H_zz(z) into `hessian` (2n × 2n).
  double hessian(const double* z, double* gradient, double* hessian);
  /// The entries of H_zz(z) at Hamiltonian::hessian_places(), until the next evaluation.
  [[nodiscard]] std::span<const double> hessian_entries(const double* z);
  /// Γ(z) = fᵀ H_zz f with f = J∇H (theory, section 3), and H(z) into `energy`.
  double gamma(const double* z, double& energy);

  [[nodiscard]] std::size_t dimension() const { return dimension_; }  ///< 2n

private:
  formula::ScalarEvaluator& hessian_evaluator();

  std::size_t dimension_;
  std::shared_ptr<Hamiltonian::Second> second_;
  formula::ScalarEvaluator value_, gradient_;
  std::optional<formula::ScalarEvaluator> hessian_, gamma_;
};

}  // namespace rubato
