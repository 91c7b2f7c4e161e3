#pragma once

#include <filesystem>

/// Problem files whose formulas take long to evaluate, so that long runs make small records. Their step is 0.1.
namespace slow_problems {

/// A pendulum.
void write_orbit(const std::filesystem::path& file, int every);
/// A travelling wave on a small lattice.
void write_lattice(const std::filesystem::path& file, int every);

}  // namespace slow_problems
