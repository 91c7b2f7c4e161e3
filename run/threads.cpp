#include <rubato/run/threads.hpp>

#include <cstdlib>
#include <stdexcept>

#include <fmt/format.h>
#include <omp.h>

namespace rubato {

namespace {

/// Values of all fields from which a second thread helps. A step makes 4 to 20 parallel loops, and a sleeping thread
/// takes some 10 us to start each. A step on so many values takes 0.3 ms with the fastest scheme and several ms with
/// implicit ones: a second thread gains from there on, and costs time below a third of this.
constexpr double least_shared_values = 2e5;

int default_count(const Problem& problem) {
  double values = 0.0;
  if (const MultisymplecticProblem* const pde = problem.multisymplectic()) {
    values = static_cast<double>(pde->fields.size());
    for (const GridAxis& axis : pde->axes) {
      values *= static_cast<double>(axis.cells);
    }
  }
  return std::getenv("OMP_NUM_THREADS") != nullptr || values >= least_shared_values ? 0 : 1;
}

}  // namespace

ThreadCount::ThreadCount(int threads) : before_(omp_get_max_threads()) {
  if (threads < 0 || threads > most_threads) {
    throw std::invalid_argument(
        fmt::format("{} is not a number of threads from 1 to {}, or 0 for OpenMP's choice", threads, most_threads));
  }
  if (threads == 0 && before_ > most_threads) {
    throw std::invalid_argument(
        fmt::format("OMP_NUM_THREADS asks for {} threads, and at most {} are used: set it to the number of cores, or "
                    "give --threads",
                    before_, most_threads));
  }
  if (threads > 0) {
    omp_set_num_threads(threads);
  }
}

ThreadCount::ThreadCount(int threads, const Problem& problem)
    : ThreadCount(threads == 0 ? default_count(problem) : threads) {}

ThreadCount::~ThreadCount() {
  omp_set_num_threads(before_);
}

}  // namespace rubato
