#pragma once

#include <vector>

#include "../work.hpp"

/// \file
/// The comparisons, one for each problem.

namespace orbits {

void pendulum(int repeats);
void kepler(int repeats);
void eccentric_kepler(int repeats);
void henon_heiles(int repeats);
void outer_solar_system(int repeats);
void chain_32(int repeats);
void chain_1024(int repeats);
void non_separable(int repeats);
void comet(int repeats);

}  // namespace orbits
