#include "waiting.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string_view>

namespace rubato::program {

namespace {

/// How often a waiting thread looks again before it sleeps. The default, 300,000, is about a millisecond: where other
/// programs have the processor of one thread, all others burn theirs for that long at every loop. On two processors
/// with six programs more, a run took 32 s so, 9 s with 30,000 looks, 4 s with 10,000 and 2 s on one thread; on an idle
/// machine 20,000 cost nothing that could be measured, 4000 a third.
constexpr const char* looks = "20000";

/// Whether threads may have to wait for each other at all.
bool may_share_work(std::span<char* const> arguments) {
  constexpr std::array<std::string_view, 5> sharing = {"run", "scan", "converge", "resume", "check"};
  const auto is = [&](std::size_t i, std::string_view word) { return i < arguments.size() && arguments[i] == word; };
  if (std::ranges::none_of(sharing, [&](std::string_view command) { return is(1, command); })) {
    return false;
  }
  for (std::size_t i = 2; i < arguments.size(); ++i) {
    if (is(i, "--threads=1") || (is(i, "--threads") && is(i + 1, "1"))) {
      return false;
    }
  }
  return true;
}

}  // namespace

void wait_briefly(std::span<char* const> arguments) {
  if (!may_share_work(arguments) || std::getenv("GOMP_SPINCOUNT") != nullptr ||
      std::getenv("OMP_WAIT_POLICY") != nullptr) {
    return;
  }
  if (setenv("GOMP_SPINCOUNT", looks, 0) == 0) {
    execv("/proc/self/exe", arguments.data());  // returns only if it cannot
  }
}

}  // namespace rubato::program
