#pragma once

#include <cstdint>
#include <string>

#include "audit/findings.hpp"

namespace audit {

/// Runs one random orbit through the program's commands and judges all that they say.
void audit_orbit(const std::string& program, std::uint64_t number, Disagreements& findings);

/// Gives the judge records in which one thing is wrong. Returns how many were taken for good, each reported on standard
/// output.
int orbit_twins(const std::string& program);

}  // namespace audit
