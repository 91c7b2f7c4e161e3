#include "compare.hpp"
#include "comparisons.hpp"
#include "planets.hpp"

namespace orbits {

void outer_solar_system(int repeats) {
  const Case<OuterSolarSystem> problem(100000.0, 4000);
  std::vector<Method> methods;
  add_peers(problem, 100, methods);
  for (const rubato::Composition& one : planetary_compositions()) {
    methods.push_back(problem.method(std::string(one.name), Class::peer, 30, KeplerSplitting(one)));
  }
  add_ours(ours_of(problem, "outer-solar-system", {}), true, {}, 100, methods);
  report(study("The Sun and five outer planets", problem.until, problem.reference.uncertainty()), methods, repeats);
}

}  // namespace orbits
