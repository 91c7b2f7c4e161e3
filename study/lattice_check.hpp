#pragma once

#include <rubato/study/problem.hpp>
#include <rubato/study/stored.hpp>

namespace rubato::study {

/// The laws of a lattice from its record alone, level by level: E_k of every step, the residual of the scheme's own
/// equation ("step_equation"), the local residuals (LatticeResiduals), node energy, Γ, totals, invariants and errors.
///
/// Where only some levels are stored, each with the one before it, these are the laws of those steps; Γ is then that in
/// their middle, and what needs consecutive steps (variational residuals, tangent solutions) is left out.
/// \throws record::Error
[[nodiscard]] Statistics check_lattice(const record::Reader& reader, const StoredLevels& levels,
                                       const Problem& problem);

}  // namespace rubato::study
