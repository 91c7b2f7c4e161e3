#pragma once

#include <string>

#include <rubato/study/run.hpp>

namespace rubato::study {

/// Recomputes every conservation law of a record from its stored states alone, by a path independent of the run: see
/// check_orbit and check_lattice. Counts (steps, h, iterations, bridges, step condition) are those stored under
/// /levels. With `every` > 1, states are compared with the predecessors kept beside them.
///
/// The record is read level by level. It may be that of a run still going, or of one that was killed. \throws
/// record::Error if it cannot be read, or contradicts itself
[[nodiscard]] Outcome check(const std::string& file);

}  // namespace rubato::study
