#pragma once

#include <rubato/ode/integrate.hpp>

namespace rubato {

/// One of many orbits, run by itself.
/// \throws as OrbitIntegrator
[[nodiscard]] OrbitEnd integrate_to_end(const Hamiltonian& hamiltonian, const InitialState& initial,
                                        const IntegrationOptions& options);

}  // namespace rubato
