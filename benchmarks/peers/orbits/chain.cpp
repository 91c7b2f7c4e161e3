#include "compare.hpp"
#include "comparisons.hpp"

namespace orbits {

namespace {

template <std::size_t N>
void compare_chain(int reference_steps, double search, double run, int repeats) {
  Case<Chain<N>> problem(1000.0, reference_steps);
  problem.longest = 4.0 * run;
  std::vector<Method> methods;
  add_peers(problem, 400, methods);
  char amplitude[48];
  std::snprintf(amplitude, sizeof amplitude, "parameters.amplitude=%.17g", Chain<N>::amplitude);
  add_ours(ours_of(problem, "fput-chain", {"parameters.N=" + std::to_string(N), amplitude}), true, {}, 400, methods);
  comparison::Study table = study("Fermi, Pasta, Ulam and Tsingou's chain of " + std::to_string(N) + " masses",
                                  problem.until, problem.reference.uncertainty());
  table.longest_search = search;
  table.longest_run = run;
  comparison::report(table, methods, repeats);
}

}  // namespace

void chain_32(int repeats) {
  compare_chain<31>(4000, 1.0, 0.4, repeats);
}
void chain_1024(int repeats) {
  compare_chain<1023>(1500, 1.0, 0.5, repeats);
}

}  // namespace orbits
