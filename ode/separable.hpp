#pragma once

#include <span>
#include <string>

#include <rubato/ode/hamiltonian.hpp>

namespace rubato {

/// H = T(p) + V(q), found from the formula: every term of its sum depends on momenta alone or on coordinates alone.
/// A factor or divisor that is a number is carried into the sum it stands before. Constants count as part of V.
struct Separation {
  formula::Expression T, V;
  std::string mixed;  ///< the first term that depends on both, as a formula; empty if there is none

  [[nodiscard]] bool separable() const { return mixed.empty(); }
};
/// `variables`: coordinates, then as many momenta.
[[nodiscard]] Separation separate(formula::Expression H, std::span<const formula::Expression> variables);
[[nodiscard]] Separation separate(const Hamiltonian& hamiltonian);

/// True if T is of degree two in the momenta: ∂²T/∂p∂p depends on nothing. Asked of the formula as it stands: of
/// sqrt(p^4) it is not found.
[[nodiscard]] bool is_quadratic(formula::Expression T, std::span<const formula::Expression> momenta);

}  // namespace rubato
