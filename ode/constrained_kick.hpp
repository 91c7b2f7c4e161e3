#pragma once

#include <span>

#include <Eigen/Core>

#include <rubato/formula/bytecode.hpp>
#include <rubato/formula/expression.hpp>
#include <rubato/ode/constraints.hpp>

namespace rubato {

/// What kicks start from, and their multipliers, with all numbers side by side as ConstrainedKick reads them.
class KickPoint {
public:
  /// \param n coordinates \param entries of G that do not vanish \param constraints multipliers
  KickPoint(Eigen::Index n, Eigen::Index entries, Eigen::Index constraints)
      : n_(n), m_(entries), c_(constraints), numbers_(Eigen::VectorXd::Zero(6 * n + entries + constraints + 1)) {}

  using Numbers = Eigen::Map<Eigen::VectorXd>;

  /// Before the kick: z + (low + δ), 2n entries each, and the entries of G there.
  ///@{
  [[nodiscard]] Numbers z() { return part(0, 2 * n_); }
  [[nodiscard]] Numbers low() { return part(2 * n_, 2 * n_); }
  [[nodiscard]] Numbers delta() { return part(4 * n_, 2 * n_); }
  [[nodiscard]] Numbers entries() { return part(6 * n_, m_); }
  ///@}
  [[nodiscard]] Numbers mu() { return part(6 * n_ + m_, c_); }
  [[nodiscard]] double& length() { return numbers_[6 * n_ + m_ + c_]; }  ///< of a drift

  /// Stands at `at` + `below`, with δ = 0.
  void stand_at(const Eigen::VectorXd& at, const Eigen::VectorXd& below) {
    z() = at;
    low() = below;
    delta().setZero();
  }

  [[nodiscard]] const double* data() const { return numbers_.data(); }

private:
  [[nodiscard]] Numbers part(Eigen::Index first, Eigen::Index size) { return {numbers_.data() + first, size}; }

  Eigen::Index n_, m_, c_;
  Eigen::VectorXd numbers_;
};

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

  using Results = Eigen::Map<const Eigen::VectorXd>;

  void evaluate(const KickPoint& from) { outputs_ = evaluator_.at(from.data()); }

  /// What is left of the equations.
  ///@{
  [[nodiscard]] Results values() const { return output(0, c_); }
  /// True if that is no more than so many rounding errors of the coordinates, or velocities.
  [[nodiscard]] bool is_rounding(double roundings) const;
  /// Relative to G times the largest of these; not a number where something is not finite.
  [[nodiscard]] double relative() const;
  ///@}
  /// Derivatives of the values are minus this, c × c; here U A U with a diagonal U that makes the diagonal 1 where it
  /// is not 0, so that units of constraints do not choose the pivots.
  void matrix(Eigen::MatrixXd& matrix, Eigen::VectorXd& units) const;
  /// After all: δ and z + (low + δ), 2n entries each, T or H, and of a drift the entries of G there.
  ///@{
  [[nodiscard]] Results delta_there() const { return output(3 * c_ + 1, 2 * n_); }
  [[nodiscard]] Results there() const { return output(3 * c_ + 1 + 2 * n_, 2 * n_); }
  [[nodiscard]] double energy() const { return outputs_[3 * c_ + 1 + 4 * n_]; }
  [[nodiscard]] Results entries_there() const { return output(3 * c_ + 2 + 4 * n_, m_); }
  ///@}

private:
  using Index = Eigen::Index;

  [[nodiscard]] Results output(Index first, Index size) const { return {outputs_ + first, size}; }

  Index n_, c_, m_;
  std::vector<Constraints::Place> places_;  ///< of the entries of the matrix that do not vanish, the last outputs
  formula::ScalarEvaluator evaluator_;
  const double* outputs_ = nullptr;
};

}  // namespace rubato
