#pragma once

#include <functional>
#include <string>
#include <vector>

#include "../work.hpp"
#include "case.hpp"

/// \file
/// Rubato on the problems of the peers, through the library, whose headers are not for here: peers are compiled with
/// other instructions, and Eigen's objects are then others.

namespace orbits {

/// A problem of the catalogue, with the peers' initial data and measures.
struct Ours {
  std::string name;                   ///< in the catalogue
  std::vector<std::string> settings;  ///< of it
  double until = 0.0;
  double longest = 0.0;  ///< seconds of a run that is looked at
  std::vector<double> q, p;
  std::function<double(const double* q, const double* p)> energy_error;  ///< |H - H_0|/|H_0|
  std::function<double(const double* q, double t)> position_error;
};

/// dt/ds, each a name and a formula.
using TimeScales = std::vector<std::pair<std::string, std::string>>;
/// Of Kepler's problem: the time of a revolution at the distance r, but for a factor.
inline const TimeScales::value_type by_distance{"r^(3/2)", "sqrt(x^2 + y^2)*sqrt(sqrt(x^2 + y^2))"};
/// Splittings where there are any, the midpoint rule and Gauss collocation, with fixed and with variable levels; with
/// time scales Gauss collocation in their times, too.
void add_ours(const Ours& problem, bool separable, const TimeScales& time_scales, int first,
              std::vector<Method>& methods);

/// Gauss collocation of high order in these times alone.
void add_ours_in(const TimeScales& time_scales, const Ours& problem, int first, std::vector<Method>& methods);

/// What adaptation is worth where an orbit is eccentric: all with fixed levels of t, and with variable ones in these
/// times.
void add_ours_eccentric(const Ours& problem, const TimeScales& time_scales, int first, std::vector<Method>& methods);

template <typename System>
[[nodiscard]] Ours ours_of(const Case<System>& problem, std::string name, std::vector<std::string> settings) {
  const State<System> start;
  const double first = System::energy(start.q.data(), start.p.data());
  return {.name = std::move(name),
          .settings = std::move(settings),
          .until = problem.until,
          .longest = problem.longest,
          .q = start.q,
          .p = start.p,
          .energy_error = [first](const double* q,
                                  const double* p) { return std::abs((System::energy(q, p) - first) / first); },
          .position_error = [&problem](const double* q, double t) { return problem.reference.error(q, t); }};
}

}  // namespace orbits
