#pragma once

namespace rubato::program {

/// Lets threads that wait for each other give their processors away soon, unless the environment says how they are to
/// wait (OMP_WAIT_POLICY, GOMP_SPINCOUNT). OpenMP reads that before main() begins: so the program replaces itself once,
/// by itself with a longer environment. Where that is not possible nothing happens.
void wait_briefly(char** arguments);

}  // namespace rubato::program
