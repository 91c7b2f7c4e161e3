#pragma once

#include <rubato/formula/bytecode.hpp>
#include <rubato/ode/hamiltonian.hpp>

/// \file
/// What Taylor arithmetic needs of a Hamiltonian, compiled without reuse of registers.

namespace rubato {

/// z ↦ J∇H(z).
[[nodiscard]] formula::Bytecode flow_code(const Hamiltonian& hamiltonian);
/// (z, v) ↦ (J∇H(z), J H_zz(z) v): the flow with a tangent vector.
[[nodiscard]] formula::Bytecode tangent_flow_code(const Hamiltonian& hamiltonian);
/// z ↦ H(z).
[[nodiscard]] formula::Bytecode energy_code(const Hamiltonian& hamiltonian);

}  // namespace rubato
