#pragma once

#include <optional>

#include <rubato/figures/verdict.hpp>
#include <rubato/ode/open_directions.hpp>
#include <rubato/ode/step_error.hpp>
#include <rubato/problem/problem.hpp>

namespace rubato {

/// What the solution of a boundary-value problem is worth.
struct SolutionMeasures {
  figures::Measures measures = {};                ///< for the verdict
  std::optional<StepError> error = std::nullopt;  ///< of the whole orbit; none at rest
  OpenDirections open = {};
};

/// Compares the orbit that solves a problem of [solve] with one of half the step, and counts what its conditions leave
/// open. \param rests the orbit is an equilibrium, which the conditions were not meant for
[[nodiscard]] SolutionMeasures measure_solution(const Problem& problem, const NodesOfOrbit& orbit, bool rests);

}  // namespace rubato
