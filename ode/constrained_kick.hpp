#pragma once

#include <span>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/ode/constraints.hpp>

namespace rubato {

/// A kick p -= Gᵀμ and what follows it, with the c equations that μ solves and their derivatives by μ, as one formula:
///
///     drift        q += length ∇T(p),   g(q) = 0 at its end,
///     projection   G H_p(q, p) = 0.
///
/// Holds work space: one per thread. No allocation after construction.
class ConstrainedKick {
public:
  enum class Then { drift, projection };
  /// \param T of a drift, or H \param variables coordinates, then as many momenta
  ConstrainedKick(formula::Expression T, std::span<const formula::Expression> variables, const Constraints& constraints,
                  Then then);

  using Numbers = Eigen::Map<Eigen::VectorXd>;
  using Results = Eigen::Map<const Eigen::VectorXd>;

  /// Before the kick: z + (low + δ), 2n entries each, and the entries of G there.
  ///@{
  [[nodiscard]] Numbers z() { return input(0, 2 * n_); }
  [[nodiscard]] Numbers low() { return input(2 * n_, 2 * n_); }
  [[nodiscard]] Numbers delta() { return input(4 * n_, 2 * n_); }
  [[nodiscard]] Numbers entries() { return input(6 * n_, m_); }
  ///@}
  [[nodiscard]] Numbers mu() { return input(6 * n_ + m_, c_); }
  [[nodiscard]] double& length() { return evaluator_.inputs().back(); }  ///< of a drift

  void evaluate() { outputs_ = evaluator_.at(evaluator_.inputs().data()); }

  /// What is left of the equations.
  ///@{
  [[nodiscard]] Results values() const { return output(0, c_); }
  /// True if that is no more than so many rounding errors of the coordinates, or velocities.
  [[nodiscard]] bool is_rounding(double roundings) const;
  /// Relative to G times the largest of these; not a number where something is not finite.
  [[nodiscard]] double relative() const;
  ///@}
  /// Derivatives of the values are minus this, c × c.
  void matrix(Eigen::MatrixXd& matrix) const;
  /// After all: δ and z + (low + δ), 2n entries each, T or H, and of a drift the entries of G there.
  ///@{
  [[nodiscard]] Results delta_there() const { return output(3 * c_ + 1, 2 * n_); }
  [[nodiscard]] Results there() const { return output(3 * c_ + 1 + 2 * n_, 2 * n_); }
  [[nodiscard]] double energy() const { return outputs_[3 * c_ + 1 + 4 * n_]; }
  [[nodiscard]] Results entries_there() const { return output(3 * c_ + 2 + 4 * n_, m_); }
  ///@}

private:
  using Index = Eigen::Index;

  [[nodiscard]] Numbers input(Index first, Index size) { return {evaluator_.inputs().data() + first, size}; }
  [[nodiscard]] Results output(Index first, Index size) const { return {outputs_ + first, size}; }

  Index n_, c_, m_;
  std::vector<Constraints::Place> places_;  ///< of the entries of the matrix that do not vanish, the last outputs
  formula::ScalarEvaluator evaluator_;
  const double* outputs_ = nullptr;
};

}  // namespace rubato
