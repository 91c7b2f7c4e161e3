#pragma once

#include <optional>
#include <string>
#include <vector>

#include <rubato/ode/stationary_action.hpp>
#include <rubato/solve/damped_newton.hpp>
#include <rubato/variation/time_levels.hpp>

namespace rubato {

struct BoundaryValueOptions {
  SegmentLagrangian lagrangian = Midpoint{};
  Levels levels = Levels::variable;
  /// Of free levels. The usual one: none where the pure law has levels along the whole orbit, else one that makes them
  /// exist (see solve_boundary_value()).
  StepPotentialChoice potential = {.kind = StepPotentialChoice::Kind::usual};
  std::optional<double> duration = std::nullopt, energy = std::nullopt;  ///< absent: free
  double tolerance = 1e-12;                                              ///< of the largest scaled residual
  std::size_t most_iterations = 100;
};

using solve::NewtonIteration;

/// A stationary orbit, or how far the search came.
struct BoundaryValueSolution {
  NodesOfOrbit orbit;
  StepPotential potential = {};
  std::vector<double> energy = {};  ///< K_k + f'(h_k), of every step
  double conserved = 0.0;           ///< E, their mean: with free levels every one of them is that
  double mean_energy = 0.0;         ///< Σ h_k K_k / Σ h_k
  double residual = 0.0;            ///< max |residual|, scaled (StationaryAction)
  std::string worst = {};           ///< the equation that leaves most
  /// Stage 0 has equal levels, 1 levels by the step law, 2 free ones.
  std::vector<NewtonIteration> history = {};
  Status status = Status::not_converged;
  std::string message = {};  ///< for people; empty on success

  [[nodiscard]] bool found() const { return status == Status::success; }
};

/// Makes the action stationary over all interior nodes and, with variable levels, over all levels, beginning from a
/// guess.
///
/// Newton's method with corrections of least norm, damped by the natural monotonicity test (Deuflhard 2004). Where
/// solutions are not isolated (the phase of a periodic orbit, rotations and translations) it converges quadratically to
/// one near the guess, and conditions that follow from others (the energy makes one of a periodic orbit) do no harm. No
/// symmetry has to be known.
///
/// Free levels exist where (s+1)h^s η keeps its sign (theory, section 3). The orbit is found with equal levels first.
/// That shows η; at order 2 the pure law is taken if η has one sign, with a margin. Else
///
///     f'(h) = σ (s+1) μ h^s,
///
/// with μ twice the largest |η|, at order 4 and above so large that levels are nearly equal. The levels then start from
/// the step law h ∝ (η + μ)^(-1/(s+1)).
///
/// \param guess N + 1 nodes with N >= 1 steps of one sign
/// \throws std::invalid_argument as make_segment_equation(), or for a guess that does not fit
[[nodiscard]] BoundaryValueSolution solve_boundary_value(const Hamiltonian& hamiltonian, EndConditions ends,
                                                         const NodesOfOrbit& guess,
                                                         const BoundaryValueOptions& options);

/// What the equations of a boundary-value problem leave at an orbit: the residual of a solution as
/// solve_boundary_value() reports it, from the nodes and levels alone. `energy`, mean_energy and worst are filled in.
[[nodiscard]] BoundaryValueSolution boundary_value_residual(const Hamiltonian& hamiltonian, EndConditions ends,
                                                            const NodesOfOrbit& orbit, const StepPotential& potential,
                                                            const BoundaryValueOptions& options);

/// Newton's method of solve_boundary_value() on given equations, from u, which it improves.
/// \param further linear conditions beside those of `equations`
/// \return true if the residual is below the tolerance
[[nodiscard]] bool find_stationary(StationaryAction& equations, std::span<const LinearCondition> further, int stage,
                                   const BoundaryValueOptions& options, Eigen::VectorXd& u,
                                   BoundaryValueSolution& solution);

/// A guess by integrating from z_0 over `steps` equal steps of the length h.
/// \return as far as the scheme came, with fewer steps where it failed
[[nodiscard]] NodesOfOrbit guess_by_integrating(const Hamiltonian& hamiltonian, const SegmentLagrangian& lagrangian,
                                                std::span<const double> z_0, double h, std::size_t steps);

}  // namespace rubato
