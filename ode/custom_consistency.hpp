#pragma once

#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/orbit_methods.hpp>

namespace rubato {

/// How far the variation of a stated 𝕃 stays off the motion of H as steps get smaller, relative to the terms: with
/// z_± = z ± h ż + h²/2 z̈ of that motion, A = (t_1 - t_0)·𝕃,
///
///     [∂A/∂z_1(z_-, z) + ∂A/∂z_0(z, z_+)]/h → 0,      ∂A/∂t_0(z, z_+) → H(z)
///
/// at points about z. 0 where both fall with h, the first steps at least; not a number where 𝕃 names t otherwise than
/// by t_1 - t_0, or is not defined there. Constants that are added to 𝕃 or H do not count.
[[nodiscard]] double off_motion(const Hamiltonian& hamiltonian, const Custom& stated, std::span<const double> z,
                                double t, double step);

}  // namespace rubato
