#pragma once

#include <rubato/study/problem.hpp>
#include <rubato/study/stored.hpp>

namespace rubato::study {

/// The laws of an orbit from its record alone: E_k as the variation ∂A/∂t_k of the action between consecutive stored
/// states, the residual of the step equation (3.3), node energy, Γ, invariants and errors from the formulas.
/// \throws record::Error
[[nodiscard]] Statistics check_orbit(const record::Reader& reader, const StoredLevels& levels, const Problem& problem);

}  // namespace rubato::study
