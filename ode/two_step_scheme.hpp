#pragma once

#include <memory>
#include <optional>
#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/node_law.hpp>
#include <rubato/ode/segment_scheme.hpp>
#include <rubato/variation/discrete_action.hpp>

namespace rubato {

/// A node of an orbit: t and z = (q, p).
struct SegmentNode {
  double t = 0.0;
  std::vector<double> z;
};

/// The two-step form of any discrete action on a segment: from the pair (z_{k-1}, z_k), z_{k+1} solves
///
///     ∂A_k/∂z_k + ∂A_{k-1}/∂z_k = 0                                  (3.3)
///     E_k := ∂A_k/∂t_k,   E_k = -∂A_{k-1}/∂t_k  (with variable levels)  (3.4)
///
/// For an autonomous A, E_k = -∂A_k/∂h is one constant for the run; otherwise (3.4) is a balance, and energy_target()
/// gives what E_k has to equal. The arbitrary starting pair (first, second) is entered through the momentum it induces,
/// P_0 = -∂A_0/∂z_0: the first step then finds `second` again.
///
/// `law` gives the node energy H(z_k) and Γ(z_k), and the order of the step law. Without it the Γ of this action is not
/// known, and reported as NaN; the step law is taken to be of order 2 where steps are predicted.
/// \throws std::invalid_argument if the pair does not fit the action, its times are equal, or A or its derivatives are
/// not finite there
[[nodiscard]] std::unique_ptr<SegmentScheme> make_two_step_scheme(std::unique_ptr<DiscreteAction> action,
                                                                  const Hamiltonian& hamiltonian,
                                                                  const SegmentNode& first, const SegmentNode& second,
                                                                  std::optional<NodeLaw> law = std::nullopt);

}  // namespace rubato
