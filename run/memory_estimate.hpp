#pragma once

#include <optional>

#include <rubato/problem/problem.hpp>

namespace rubato {

/// Estimates the memory that the run of a lattice takes at its peak, in bytes: two steps of the same problem with far
/// fewer cells, in child processes of two sizes, give the bytes of a cell. Nothing for an orbit, and where a small
/// lattice cannot run.
[[nodiscard]] std::optional<double> estimated_memory(const Problem& problem, bool tangents);

/// \param copies runs at the same time, or the reciprocal of the ranks that share one
/// \throws ProblemError if the memory that is available does not suffice
void require_memory_for(const Problem& problem, bool tangents, double copies = 1.0);

}  // namespace rubato
