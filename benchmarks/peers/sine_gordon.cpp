#include <cmath>

#include "comparison.hpp"
#include "equations.hpp"

namespace comparison {

Problem sine_gordon_breather() {
  const double gamma = std::sqrt(0.75);
  return {.name = "sine-Gordon breather",
          .from = -20,
          .length = 40,
          .until = 12,
          .system = rubato::MultisymplecticSystem({"u", "v", "w"}, skew(3, {{0, 1, -1}}), {skew(3, {{0, 2, 1}})},
                                                  "(v^2 - w^2)/2 + 1 - cos(u)"),
          .fields = {0},
          .first = [](double) { return 0.0; },
          .second = [=](double x) { return 4 * gamma / std::cosh(gamma * x); },
          .given = {1, 2, 0},
          .converged =
              [](std::size_t n) {
                return peers::waves_and_kicks({-20, 40, n}, peers::Rest::sine, "kahan-li-8");
              },
          .converged_nodes = 320,
          .converged_steps = 2000};
}

void sine_gordon(int repeats) {
  const Problem problem = sine_gordon_breather();
  const Reference reference(problem);
  std::vector<Method> methods;
  const std::vector<std::size_t> grids = {64, 80, 96, 112, 128, 144, 160};
  for (const char* name : {"verlet", "blanes-moan-4", "kahan-li-6", "kahan-li-8", "blanes-moan-rkn-6"}) {
    for (const std::size_t n : grids) {
      methods.push_back(peer_method(problem, reference, name,
                                    peers::waves_and_kicks(problem.line(n), peers::Rest::sine, name), n, 10));
    }
  }
  add_ours(
      problem, reference,
      {splitting("blanes-moan-4"), splitting("kahan-li-6"), splitting("kahan-li-8"), splitting("blanes-moan-rkn-6")},
      grids, 10, methods);
  add_ours(problem, reference, {gauss(2), gauss(3), gauss(4), gauss(6), gauss(8)}, grids, 8, methods);
  report(problem, reference, methods, repeats);
}

}  // namespace comparison
