#pragma once

#include <mutex>

#include <rubato/ode/integrate.hpp>

namespace rubato {

/// One of many orbits, run by itself. What is made of H, whose graph grows, is made under the lock.
/// \throws as OrbitIntegrator
[[nodiscard]] OrbitEnd integrate_to_end(const Hamiltonian& hamiltonian, const InitialState& initial,
                                        const IntegrationOptions& options, std::mutex& making);

}  // namespace rubato
