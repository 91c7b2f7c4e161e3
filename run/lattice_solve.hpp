#pragma once

#include <string>
#include <vector>

#include <rubato/run/solve.hpp>

namespace rubato {

/// How far a run over the period of a solution may end from its start, beside closing_scales(): another orbit is
/// further away, and rounding errors of an orbit that is not very unstable are less.
inline constexpr double closing_tolerance = 1e-9;
/// What fields are compared by over a period: their largest values, and a thousandth of the largest of all, since a
/// field at rest consists of rounding errors. \param largest of each field over the period
[[nodiscard]] std::vector<double> closing_scales(std::vector<double> largest);

/// solve_problem() of a lattice: fills in the solution, writes the record of a run over one period from its first
/// level, and leaves a message where there is none.
void solve_lattice(const Problem& problem, const RunOptions& options, const std::string& file, SolveOutcome& outcome);

}  // namespace rubato
