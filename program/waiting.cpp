#include "waiting.hpp"

#include <unistd.h>

#include <cstdlib>

namespace rubato::program {

namespace {

/// How often a waiting thread looks again before it sleeps. The default, 300,000, is about a millisecond: where other
/// programs have the processor of one thread, all others burn theirs for that long at every loop. On two processors
/// with six programs more, a run took 32 s so, 9 s with 30,000 looks, 4 s with 10,000 and 2 s on one thread; on an idle
/// machine 20,000 cost nothing that could be measured, 4000 a third.
constexpr const char* looks = "20000";

}  // namespace

void wait_briefly(char** arguments) {
  if (std::getenv("GOMP_SPINCOUNT") != nullptr || std::getenv("OMP_WAIT_POLICY") != nullptr) {
    return;
  }
  if (setenv("GOMP_SPINCOUNT", looks, 0) == 0) {
    execv("/proc/self/exe", arguments);  // returns only if it cannot
  }
}

}  // namespace rubato::program
