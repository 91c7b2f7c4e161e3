#pragma once

#include <rubato/problem/problem.hpp>

namespace rubato {

/// Puts what [scheme] says of a run into the options of an orbit or of a lattice: both have it under the same names.
template <typename Options>
void set_run_options(const Scheme& scheme, Options& options) {
  options.step = scheme.step.value_or(0.0);
  options.until = scheme.until;
  options.levels = scheme.levels;
  options.on_singular = scheme.on_singular;
  options.potential = scheme.potential;
  options.tolerance = scheme.tolerance;
}

}  // namespace rubato
