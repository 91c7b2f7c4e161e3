#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include <rubato/formula/batch.hpp>
#include <rubato/ode/hamiltonian.hpp>

namespace rubato {

/// J∇H and H at the stages of collocation, side by side: of H as a whole, or by the halves of H = T(p) + V(q), of which
/// p' = -∇V takes the coordinates alone and q' = ∇T the momenta alone.
class StageSlopes {
public:
  /// One row for each component of the state, the stages side by side.
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  /// \param Z the stages, 2n rows; \param f J∇H there. Both are referred to, and their sizes are to stay.
  StageSlopes(const Hamiltonian& hamiltonian, const Rows& Z, Rows& f);
  StageSlopes(const StageSlopes&) = delete;
  StageSlopes& operator=(const StageSlopes&) = delete;

  /// True if H is T(p) + V(q), and the halves can be asked for.
  [[nodiscard]] bool has_halves() const { return halves_.has_value(); }

  /// True if T is a quadratic form: then ∇T of a sum of momenta is the sum of velocities.
  [[nodiscard]] bool has_linear_velocities() const { return linear_.has_value(); }

  void evaluate();
  /// The rows of p', from those of q; and the rows of q', from those of p.
  ///@{
  void evaluate_forces() { halves_->V.run(); }
  void evaluate_velocities() { halves_->T.run(); }
  ///@}
  /// ∇T of momenta(), n rows, as velocities(), where it is linear.
  ///@{
  Rows& momenta() { return linear_->p; }
  void evaluate_linear_velocities() {
    if (!linear_->same) {
      linear_->evaluate.run();
    }
  }
  [[nodiscard]] const Rows& velocities() const { return linear_->same ? linear_->p : linear_->v; }
  ///@}
  /// H at a stage, by what was evaluated last of all its parts.
  [[nodiscard]] double energy(Eigen::Index stage, bool by_halves) const {
    return by_halves ? energies_(1, stage) + energies_(2, stage) : energies_(0, stage);
  }
  /// Instructions of what a sweep evaluates, for all stages.
  [[nodiscard]] std::size_t instructions() const;

private:
  struct Halves {
    formula::BatchEvaluator T, V;  ///< with ∇T and -∇V
  };
  struct Linear {
    Rows p, v;
    formula::BatchEvaluator evaluate;
    bool same = false;  ///< ∇T = p
  };

  const Rows& Z_;
  Rows& f_;
  Rows energies_;  ///< of H, T and V
  formula::BatchEvaluator whole_;
  std::optional<Halves> halves_;
  std::optional<Linear> linear_;
};

}  // namespace rubato
