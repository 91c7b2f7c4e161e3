#pragma once

#include <span>
#include <string>

#include <rubato/problem/problem.hpp>

namespace rubato::program {

/// Lets threads that wait for each other give their processors away soon, unless the environment says how they are to
/// wait (OMP_WAIT_POLICY, GOMP_SPINCOUNT). OpenMP reads that before main() begins. A program that has OpenMP in itself
/// says it earlier still; where it is a shared library the program replaces itself once, by itself with a longer
/// environment. Where that is not possible, or the arguments say that there is one thread or nothing to share, nothing
/// happens. `run` waits until it has read its problem (wait_briefly_for), unless ranks are joined before, which cannot
/// be done twice: an orbit has nothing to share, and starting is a good part of a short run. \param arguments those of
/// main(), with a null pointer behind them
void wait_briefly(std::span<char* const> arguments);

/// The same for `run`, before it does or prints anything.
/// \param name what was read as `problem`: it must be there to be read again, which a pipe is not
void wait_briefly_for(const rubato::Problem& problem, const std::string& name);

}  // namespace rubato::program
