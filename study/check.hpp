#pragma once

#include <string>

#include <rubato/study/run.hpp>

namespace rubato::study {

/// Recomputes every conservation law of a record from its stored states alone, by a path independent of the run: E_k as
/// the variation ∂A/∂t_k of the action between consecutive stored states, the residual of the step equation (3.3), node
/// energy, Γ, invariants and errors from the formulas. Counts (steps, h, iterations, bridges, step condition) are those
/// stored under /levels. With `every` > 1, states are compared with the predecessors kept beside them. \throws
/// record::Error; ProblemError if the problem in the record cannot be read
[[nodiscard]] Outcome check(const std::string& file);

}  // namespace rubato::study
