#include "waiting.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <system_error>

#include <rubato/ranks/communicator.hpp>

namespace rubato::program {

namespace {

/// How often a waiting thread looks again before it sleeps. The default, 300,000, is about a millisecond: where other
/// programs have the processor of one thread, all others burn theirs for that long at every loop. On two processors
/// with six programs more, a run took 32 s so, 9 s with 30,000 looks, 4 s with 10,000 and 2 s on one thread; on an idle
/// machine 20,000 cost nothing that could be measured, 4000 a third.
constexpr const char* looks = "20000";

#ifdef RUBATO_OWN_OPENMP
/// An OpenMP that the program has in itself reads its environment after this.
[[gnu::constructor(101)]] void say_how_to_wait() {
  if (std::getenv("OMP_WAIT_POLICY") == nullptr) {
    setenv("GOMP_SPINCOUNT", looks, 0);
  }
}
#endif

using Words = std::span<char* const>;

/// Those of main().
Words& words() {
  static Words all;
  return all;
}

bool is(Words arguments, std::size_t i, std::string_view word) {
  return i < arguments.size() && arguments[i] == word;
}

bool has_one_thread(Words arguments) {
  for (std::size_t i = 2; i < arguments.size(); ++i) {
    if (is(arguments, i, "--threads=1") || (is(arguments, i, "--threads") && is(arguments, i + 1, "1"))) {
      return true;
    }
  }
  return false;
}

void replace_program(Words arguments) {
  if (has_one_thread(arguments) || std::getenv("GOMP_SPINCOUNT") != nullptr ||
      std::getenv("OMP_WAIT_POLICY") != nullptr) {
    return;
  }
  if (setenv("GOMP_SPINCOUNT", looks, 0) == 0) {
    execv("/proc/self/exe", arguments.data());  // returns only if it cannot
  }
}

bool can_be_read_again(const std::filesystem::path& file) {
  std::error_code none;
  return std::filesystem::is_regular_file(file, none) || !std::filesystem::exists(file, none);
}

}  // namespace

void wait_briefly(Words arguments) {
  constexpr std::array<std::string_view, 4> sharing = {"scan", "converge", "resume", "check"};
  words() = arguments;
  if (std::ranges::any_of(sharing, [&](std::string_view command) { return is(arguments, 1, command); }) ||
      (ranks::joins() && is(arguments, 1, "run"))) {
    replace_program(arguments);
  }
}

void wait_briefly_for(const rubato::Problem& problem, const std::string& name) {
  if (!ranks::joins() && (problem.ensemble || problem.hamiltonian() == nullptr) && can_be_read_again(name)) {
    replace_program(words());
  }
}

}  // namespace rubato::program
