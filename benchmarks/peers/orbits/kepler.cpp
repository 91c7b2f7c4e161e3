#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

void kepler(int repeats) {
  const Case<Kepler<600>> problem(20 * 3.14159265358979323846, 8000);
  std::vector<Method> methods;
  add_peers(problem, 150, methods);
  add_ours(ours_of(problem, "kepler", {}), true, {by_distance}, 150, methods);
  report(study("Kepler, e = 0.6, ten revolutions", problem.until, problem.reference.uncertainty()), methods, repeats);
}

/// Where steps that follow the orbit pay: fixed levels are those of t.
void eccentric_kepler(int repeats) {
  const Case<Kepler<900>> problem(200 * 3.14159265358979323846, 640000);
  std::vector<Method> methods;
  add_peers(problem, 4000, methods);
  add_ours_eccentric(ours_of(problem, "kepler", {"parameters.e=0.9"}), {by_distance}, 4000, methods);
  report(study("Kepler, e = 0.9, a hundred revolutions, fixed levels of t", problem.until,
               problem.reference.uncertainty()),
         methods, repeats);
}

}  // namespace orbits
