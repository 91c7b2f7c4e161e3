#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

void outer_solar_system(int repeats) {
  const Case<OuterSolarSystem> problem(100000.0, 4000);
  std::vector<Method> methods;
  add_peers(problem, 100, methods);
  add_ours(ours_of(problem, "outer-solar-system", {}), true, "", 100, methods);
  report(study("The Sun and five outer planets", problem.until, problem.reference.uncertainty()), methods, repeats);
}

}  // namespace orbits
