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
  /// Stands at z (2n finite entries), with no past.
  virtual void restart(std::span<const double> z) = 0;
};

/// What every one-step scheme asks of z_0. \throws std::invalid_argument, with the values, if it has not 2n entries or
/// is not finite, or H or ∇H is not finite there
void check_initial_state(const Hamiltonian& hamiltonian, std::span<const double> z_0);

}  // namespace rubato
