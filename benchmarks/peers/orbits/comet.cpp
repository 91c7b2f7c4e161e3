#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

/// Of codes that choose their steps.
void comet(int repeats) {
  using System = Kepler<990>;
  Case<System> problem(2000 * 3.14159265358979323846, 0);
  problem.longest = 12.0;
  std::vector<Method> methods;
  methods.push_back(problem.method("IAS15", Class::peer, 10, Ias15<System>()));
  methods.push_back(problem.method("DOP853", Class::peer, 50, Dop853<System>()));
  add_odeint(problem, 0, methods);
  add_sundials(problem, 0, methods);
  // Steps of s, of which a revolution takes some ten.
  add_ours(ours_of(problem, "kepler", {"parameters.e=0.99"}), false,
           {{"r^(3/2)", "sqrt(x^2 + y^2)*sqrt(sqrt(x^2 + y^2))"}, {"r", "sqrt(x^2 + y^2)"}}, 2000, methods);
  comparison::Study table = study("Kepler, e = 0.99, a thousand revolutions", problem.until, 0.0);
  table.measures = {"energy"};
  table.targets = {1e-6, 1e-8, 1e-10};
  table.longest_search = 12.0;
  table.longest_run = 6.0;
  report(table, methods, repeats);
}

}  // namespace orbits
