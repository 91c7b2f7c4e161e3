#pragma once

#include <rubato/base/spread.hpp>
#include <rubato/problem/problem.hpp>
#include <rubato/problem/stored.hpp>
#include <rubato/run/disagreements.hpp>

namespace rubato {

/// Everything of an orbit's record that its stored states determine, by a path independent of the run:
///
/// - at each of them, and at the predecessors of stored levels: H, Γ, the invariants; at each the exact solution; the
///   first is the problem's initial state;
/// - of each step between two of them: E_k as the variation ∂A/∂t_k of the action, and the equation of the step, (3.3)
///   in one-step form Jδ = ∇Φ where the scheme has one. The two-step equation of the others needs three levels that
///   follow each other.
///
/// `has_gamma`: whether the scheme has the Γ of the node law. \return the residuals of the step equation
/// \throws record::Error
[[nodiscard]] Spread check_orbit(const record::Reader& reader, const StoredLevels& levels, const Problem& problem,
                                 bool has_gamma, Disagreements& findings);

}  // namespace rubato
