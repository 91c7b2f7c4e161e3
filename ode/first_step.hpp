#pragma once

#include <rubato/ode/integrate.hpp>

namespace rubato {

/// A first step for `options`, in place of its `step`, with which max |H(z_k) - E| stays within `tolerance` of
/// E, relative to TimeLevels::energy_scale: found by trial runs of at most 2000 steps with the
/// same options (choose_first_step). An orbit whose Γ is largest later than that can stray farther;
/// with a step potential also one that the trials did not follow to where it is fastest. \throws
/// std::invalid_argument as OrbitIntegrator and choose_first_step do
[[nodiscard]] double choose_first_step(const Hamiltonian& hamiltonian, const InitialState& initial,
                                       IntegrationOptions options, double tolerance);
/// The same for a problem stated by L.
[[nodiscard]] double choose_first_step(const Lagrangian& lagrangian, const InitialMotion& initial,
                                       IntegrationOptions options, double tolerance);

}  // namespace rubato
