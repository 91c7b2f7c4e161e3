#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

void pendulum(int repeats) {
  const Case<Pendulum> problem(100.0, 4000);
  std::vector<Method> methods;
  add_peers(problem, 60, methods);
  add_ours(ours_of(problem, "pendulum", {}), true, {}, 60, methods);
  report(study("Pendulum, p = 1.9", problem.until, problem.reference.uncertainty()), methods, repeats);
}

}  // namespace orbits
