#pragma once

#include <span>

namespace rubato::program {

/// Lets threads that wait for each other give their processors away soon, unless the environment says how they are to
/// wait (OMP_WAIT_POLICY, GOMP_SPINCOUNT). OpenMP reads that before main() begins: so the program replaces itself once,
/// by itself with a longer environment. Where that is not possible, or the arguments say that there is one thread or
/// nothing to share, nothing happens.
/// \param arguments those of main(), with a null pointer behind them
void wait_briefly(std::span<char* const> arguments);

}  // namespace rubato::program
