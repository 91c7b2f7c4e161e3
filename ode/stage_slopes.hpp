#pragma once

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

  /// Whether H is T(p) + V(q), and the halves can be asked for.
  [[nodiscard]] bool has_halves() const { return halves_.has_value(); }

  void evaluate() { evaluate_and_turn(whole_); }
  /// The rows of p', from those of q; and the rows of q', from those of p.
  ///@{
  void evaluate_forces() { evaluate_and_turn(halves_->V); }
  void evaluate_velocities() { evaluate_and_turn(halves_->T); }
  ///@}
  /// H at a stage, by what was evaluated last of all its parts.
  [[nodiscard]] double energy(Eigen::Index stage, bool by_halves) const {
    return by_halves ? energies_(1, stage) + energies_(2, stage) : energies_(0, stage);
  }
  /// Instructions of what a sweep evaluates, for all stages.
  [[nodiscard]] std::size_t instructions() const;

private:
  struct Part {
    formula::BatchEvaluator evaluate;
    std::vector<const double*> in;
    std::vector<double*> out;
  };
  struct Halves {
    Part T, V;
  };
  void evaluate_and_turn(Part& part);

  const Rows& Z_;
  Rows& f_;
  Rows energies_;  ///< of H, T and V
  Part whole_;
  std::optional<Halves> halves_;
};

}  // namespace rubato
