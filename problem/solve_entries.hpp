#pragma once

#include <string_view>

#include <rubato/problem/reader.hpp>
#include <rubato/problem/solve.hpp>

/// \file
/// Entries of [solve] that orbits and lattices share.

namespace rubato {

/// A misspelt key explains more than a missing one, so that all are looked at first. \throws ProblemError
void refuse_unknown_keys(Section section, std::string_view table);

/// `period`, or `time` where the orbit does not close, and `energy`, which takes the place of a duration that is not
/// given. Needs `ends`. \throws ProblemError
void read_duration_and_energy(Section& section, const Problem& problem, StatedSolve& solve);
/// `steps`, without it those of [scheme]. \throws ProblemError
void read_solve_steps(Section& section, const Problem& problem, StatedSolve& solve);
/// `tolerance` and `max_iterations`. \throws ProblemError
void read_newton(Section& section, const Problem& problem, StatedSolve& solve);

/// The section of a lattice: a periodic orbit. \throws ProblemError
[[nodiscard]] StatedSolve read_lattice_solve(Section& section, const Problem& problem);

}  // namespace rubato
