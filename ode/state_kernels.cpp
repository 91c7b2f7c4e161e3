#include <rubato/ode/state_kernels.hpp>

#include <cmath>

#include <rubato/base/wide_vectors.hpp>

namespace rubato {

RUBATO_WIDE_VECTORS void add_to_state(std::size_t n, const double* __restrict delta, double* __restrict high,
                                      double* __restrict low) {
  for (std::size_t i = 0; i < n; ++i) {
    const double before = high[i], change = delta[i];
    const double sum = before + change;
    const double part = sum - before;
    const double rest = low[i] + ((before - (sum - part)) + (change - part));
    const double rounded = sum + rest;
    high[i] = rounded;
    low[i] = rest - (rounded - sum);
  }
}

RUBATO_WIDE_VECTORS void middle_of_states(std::size_t n, const double* __restrict here, const double* __restrict there,
                                          double* __restrict middle, double* __restrict errors) {
  for (std::size_t i = 0; i < n; ++i) {
    const double mean = 0.5 * (here[i] + there[i]);
    middle[i] = mean;
    errors[i] = 2.0 * (std::abs(mean) + std::abs(there[i] - here[i]));
  }
}

}  // namespace rubato
