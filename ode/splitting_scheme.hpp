#pragma once

#include <memory>
#include <span>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/segment_scheme.hpp>
#include <rubato/variation/composition.hpp>

namespace rubato {

/// An explicit splitting of H = T(p) + V(q), with its discrete energy (theory, sections 8 and 8.2): the composition of
/// the flows of T and of V over a_i h and b_i h, and
///
///     E_k = Σ a_i T(p on drift i) + Σ b_i V(q on kick i),
///
/// the Hamiltonian that generates the family of maps in h. With levels from E_k = E the step is symplectic in the
/// extended sense.
///
/// The golden splitting obeys the midpoint rule's step law, with E_k - H = ((7 - 3√5)/16) h²Γ + O(h⁴): its Γ, in the
/// terms of NodeEnergy, is -((7 - 3√5)/2) fᵀH_zz f. The others have no node law in closed form. The slope dE/dh is that
/// of make_gauss_scheme(). Where H has constraints it is make_constrained_splitting(). \throws std::invalid_argument if
/// H is not separable, naming the term; if T is not quadratic where the composition needs it; if sizes do not fit or H
/// is not finite at z_0
[[nodiscard]] std::unique_ptr<OneStepScheme> make_splitting_scheme(const Hamiltonian& hamiltonian,
                                                                   const Composition& composition,
                                                                   std::span<const double> z_0);

}  // namespace rubato
