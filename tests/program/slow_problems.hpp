#pragma once

#include <filesystem>

/// Problem files whose formulas take long to evaluate, so that long runs make small records. Their step is 0.1.
namespace slow_problems {

/// A pendulum.
void write_orbit(const std::filesystem::path& file, int every);
/// A travelling wave on a small lattice.
void write_lattice(const std::filesystem::path& file, int every);
/// So many pendulums, each of which takes about a tenth of a second, with crossings and output times.
void write_ensemble(const std::filesystem::path& file, int members);
/// So many pendulums side by side in vectors, of which 128 take about a second.
void write_members_side_by_side(const std::filesystem::path& file, int members);

}  // namespace slow_problems
