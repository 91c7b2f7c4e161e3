#pragma once

#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/variation/level_scheme.hpp>

namespace rubato {

/// A time-stepping scheme for an orbit: what TimeLevels needs, and the state z = (q, p).
class SegmentScheme : public LevelScheme {
public:
  [[nodiscard]] virtual std::size_t dimension() const = 0;          ///< 2n
  [[nodiscard]] virtual std::span<const double> state() const = 0;  ///< z_k, rounded to double
  /// q̇ at z_k of a problem that is stated by L(q, q̇); empty for others.
  [[nodiscard]] virtual std::span<const double> velocities() { return {}; }
};

/// One whose step depends on z_k and h alone, z_{k+1} = ψ_h(z_k): the past serves to begin the solution of a step, and
/// nothing else.
class OneStepScheme : public SegmentScheme {
public:
  /// Stands at z (2n finite entries), with no past but its guesses.
  virtual void restart(std::span<const double> z) = 0;
  /// advance(h, 0) for a step that is there and leads to z_1: the iteration begins with the cubic through both ends, so
  /// that it verifies the step where a search from the start finds none, or another one.
  [[nodiscard]] virtual Status advance_to(std::span<const double> /*z_1*/, double h) { return advance(h, 0.0); }
  /// Replaces each of the columns (2n entries, one column after the other) by its image under the tangent of the trial
  /// step at its length h, ∂ψ_h/∂z at z_k: the derivative of the map that the step solves, which preserves dp∧dq to
  /// rounding errors. Hypothesis: the last advance succeeded, and was not accepted. Where it fails the columns are
  /// undefined. Plain steps do nothing for it.
  [[nodiscard]] virtual Status tangent(std::span<double> columns) = 0;
  /// Replaces each of the columns by its projection on the variations that states of the scheme have at z_k: all,
  /// unless there are constraints.
  [[nodiscard]] virtual Status project_variations(std::span<double> /*columns*/) { return Status::success; }
  /// tangent() for what makes steps part of larger equations. The last column, 0 before, becomes ∂ψ_h/∂h, and
  /// `energies` gets the derivative of the discrete energy along each column. Only schemes with constraints have it.
  [[nodiscard]] virtual Status linearise(std::span<double> /*columns*/, std::span<double> /*energies*/) {
    return Status::undefined;
  }
  /// What the next restart() keeps: after restore_guesses() it leads to the same bits.
  ///@{
  virtual void save_guesses(StateWriter& /*state*/) const {}
  virtual void restore_guesses(StateReader& /*state*/) {}
  ///@}
};

/// What every one-step scheme asks of z_0. \throws std::invalid_argument, with the values, if it has not 2n entries or
/// is not finite, or H or ∇H is not finite there
void check_initial_state(const Hamiltonian& hamiltonian, std::span<const double> z_0);

}  // namespace rubato
