#include <catch2/catch.hpp>

#include <cstdlib>
#include <optional>
#include <string>

#include <omp.h>

#include <rubato/run/threads.hpp>

#include "problem/problem_texts.hpp"

using namespace rubato;

namespace {

/// OMP_NUM_THREADS for one test.
class Environment {
public:
  explicit Environment(const char* value) {
    if (const char* const before = std::getenv(name)) {
      before_ = before;
    }
    value == nullptr ? ::unsetenv(name) : ::setenv(name, value, 1);
  }
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;
  ~Environment() { before_ ? ::setenv(name, before_->c_str(), 1) : ::unsetenv(name); }

private:
  static constexpr const char* name = "OMP_NUM_THREADS";
  std::optional<std::string> before_;
};

int threads_of(const std::string& name, int threads, const std::vector<std::string>& settings = {}) {
  const ThreadCount count(threads, read_problem(name, settings));
  return omp_get_max_threads();
}

}  // namespace

TEST_CASE("a small lattice has one thread unless the user gives a number, and a large one OpenMP's") {
  const ThreadCount three(3);
  REQUIRE(omp_get_max_threads() == 3);
  const std::vector<std::string> large = {"grid.x.cells=255", "grid.y.cells=255"};  // of four fields: 260,100 values
  {
    const Environment none(nullptr);
    CHECK(threads_of("pendulum", 0) == 1);
    CHECK(threads_of("sine-gordon", 0) == 1);
    CHECK(threads_of("sine-gordon-2d", 0, large) == 3);
    CHECK(threads_of("sine-gordon", 2) == 2);
    CHECK(threads_of("sine-gordon-2d", 1, large) == 1);
  }
  const Environment given("3");
  CHECK(threads_of("sine-gordon", 0) == 3);
  CHECK(threads_of("sine-gordon", 1) == 1);
  CHECK(omp_get_max_threads() == 3);  // as before
}
