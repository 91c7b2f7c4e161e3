#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

void henon_heiles(int repeats) {
  const Case<HenonHeiles> problem(200.0, 4000);
  std::vector<Method> methods;
  add_peers(problem, 60, methods);
  add_ours(ours_of(problem, "henon-heiles", {}), true, {}, 60, methods);
  report(study("Henon and Heiles, energy 1/12", problem.until, problem.reference.uncertainty()), methods, repeats);
}

}  // namespace orbits
