#pragma once

#include <cstdint>
#include <string>

#include "audit/findings.hpp"
#include "audit/lattice_problem.hpp"
#include "audit/levels_judge.hpp"

namespace audit {

/// Judges a record of a lattice by the equations, and by them what the run reported on it.
Roundings judge_lattice(const LatticeProblem& problem, const Stored& record, const Json& reported,
                        Disagreements& findings);

/// Runs one random lattice through the program's commands and judges all that they say.
void audit_lattice(const std::string& program, std::uint64_t number, Disagreements& findings);

/// As orbit_twins().
int lattice_twins(const std::string& program);

}  // namespace audit
