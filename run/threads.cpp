#include <rubato/run/threads.hpp>

#include <stdexcept>

#include <fmt/format.h>
#include <omp.h>

namespace rubato {

void use_threads(int threads) {
  if (threads < 0 || threads > most_threads) {
    throw std::invalid_argument(
        fmt::format("{} is not a number of threads from 1 to {}, or 0 for OpenMP's choice", threads, most_threads));
  }
  if (threads > 0) {
    omp_set_num_threads(threads);
  } else if (omp_get_max_threads() > most_threads) {
    throw std::invalid_argument(
        fmt::format("OMP_NUM_THREADS asks for {} threads, and at most {} are used: set it to the number of cores, or "
                    "give --threads",
                    omp_get_max_threads(), most_threads));
  }
}

}  // namespace rubato
