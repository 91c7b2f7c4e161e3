#pragma once

#include "audit/accounts.hpp"
#include "audit/findings.hpp"
#include "audit/orbit_oracle.hpp"
#include "audit/program.hpp"
#include "audit/stored.hpp"

namespace audit {

/// Judges a record by the equations, and by them what the run reported on it. Returns how much of the figures is
/// rounding.
Roundings judge_orbit(const OrbitProblem& problem, const Stored& record, const Json& reported, Disagreements& findings);

}  // namespace audit
