#pragma once

#include <rubato/ode/integrate.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// What [hamiltonian], [initial] and [scheme] of a problem stand for in the library's own terms.
/// Of a problem stated by L, H is the Legendre transform of a formula that is quadratic in the velocities.
/// \throws ProblemError at L if it is not
///@{
/// H as an expression in which `parameters` are variables, too.
[[nodiscard]] formula::Expression build_hamiltonian(const Problem& problem, formula::Graph& graph,
                                                    std::span<const std::string> parameters = {});
[[nodiscard]] Hamiltonian make_hamiltonian(const Problem& problem);
/// H with these parameters as variables: its last coordinates, or momenta, each with a partner that H does not name.
[[nodiscard]] Hamiltonian make_hamiltonian(const Problem& problem, std::span<const std::string> parameters,
                                           bool as_momenta);
///@}
/// [constraints] as formulas of q, the coordinates of the problem and what comes after them, parameters of it among
/// that; none where there is no such table.
[[nodiscard]] Constraints make_constraints(const Problem& problem, std::span<const std::string> q);
/// Of a problem stated by L.
[[nodiscard]] Lagrangian make_lagrangian(const Problem& problem);
[[nodiscard]] SegmentLagrangian make_discretisation(const Problem& problem);
/// Without events; `step` is 0 for step = "auto".
[[nodiscard]] IntegrationOptions make_integration_options(const Problem& problem);
/// \throws ProblemError at the place in the problem that is wrong
[[nodiscard]] OrbitIntegrator make_integrator(const Problem& problem);

}  // namespace rubato
