#include "waiting.hpp"

#include <unistd.h>

#include <cstdlib>

namespace rubato::program {

namespace {

/// How often a waiting thread looks again before it sleeps. The default, 300,000, is about a millisecond: where another
/// program has the processor of one thread, all others burn theirs for that long at every loop, and two threads took
/// 20 times as long as one. A thousand looks are some microseconds, which is what waking up costs.
constexpr const char* looks = "1000";

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
