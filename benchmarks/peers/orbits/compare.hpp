#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "dop853.hpp"
#include "gauss.hpp"
#include "ias15.hpp"
#include "odeint.hpp"
#include "ours.hpp"
#include "splittings.hpp"
#include "sundials.hpp"

namespace orbits {

/// All peers that a problem can have. \param first steps to begin a search with
template <typename System>
void add_peers(const Case<System>& problem, int first, std::vector<Method>& methods) {
  if constexpr (System::separable) {
    add_splittings(problem, first, methods);
    methods.push_back(problem.method("IAS15", Class::peer, 3, Ias15<System>()));
  }
  add_gauss(problem, first, methods);
  methods.push_back(problem.method("DOP853", Class::peer, 3, Dop853<System>()));
  add_odeint(problem, first, methods);
  add_sundials(problem, first, methods);
}

[[nodiscard]] inline comparison::Study study(const std::string& what, double until, double uncertainty) {
  char title[160];
  std::snprintf(title, sizeof title, "%s to t = %.6g; the solution compared with is known to %.1e", what.c_str(), until,
                uncertainty);
  return {.title = title,
          .measures = {"energy", "position"},
          .targets = {1e-3, 1e-6, 1e-9, 1e-12},
          .longest_search = 0.5,
          .longest_run = 0.2,
          .growth_of_levels = 2.0,  // each has a look-ahead
          .shortest_measurement = 3e-4,
          .steadily = true};
}

}  // namespace orbits
