#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

void non_separable(int repeats) {
  const Case<NonSeparable> problem(100.0, 5000);
  std::vector<Method> methods;
  add_peers(problem, 60, methods);
  add_ours(ours_of(problem, "non-separable", {}), false, {}, 60, methods);
  report(study("H = (q^2 + 1)(p^2 + 1)/2", problem.until, problem.reference.uncertainty()), methods, repeats);
}

}  // namespace orbits
