#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

/// Of codes that choose their steps.
void comet(int repeats) {
  using System = Kepler<990>;
  Case<System> problem(2000 * 3.14159265358979323846, 0);
  problem.longest = 4.0;
  std::vector<Method> methods;
  methods.push_back(problem.method("IAS15", Class::peer, 10, Ias15<System>()));
  methods.push_back(problem.method("DOP853", Class::peer, 50, Dop853<System>()));
  add_odeint(problem, 0, methods);
  add_sundials(problem, 0, methods);
  // What cannot come near is left out: the first runs alone would take minutes.
  std::erase_if(methods, [](const Method& one) {
    return one.name == "dopri5" || one.name == "CVODE BDF" || one.name == "ERKStep Verner 6";
  });
  for (Method& one : methods) {
    one.first = one.name == "IAS15" ? 50 : 700;
  }
  add_ours_in({by_distance, {"r", "sqrt(x^2 + y^2)"}}, ours_of(problem, "kepler", {"parameters.e=0.99"}), 32000,
              methods);
  comparison::Study table = study("Kepler, e = 0.99, a thousand revolutions", problem.until, 0.0);
  table.measures = {"energy"};
  table.targets = {1e-6, 1e-10};
  table.longest_search = 3.0;
  table.longest_run = 1.5;
  report(table, methods, repeats);
}

}  // namespace orbits
