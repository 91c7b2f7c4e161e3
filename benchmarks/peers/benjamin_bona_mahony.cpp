#include <cmath>

#include "comparison.hpp"
#include "equations.hpp"

namespace comparison {

/// u_t + u_x + u u_x - u_xxt = 0: the solitary wave of the catalogue.
void benjamin_bona_mahony(int repeats) {
  const Problem problem{
      .name = "Benjamin-Bona-Mahony wave",
      .from = -50,
      .length = 100,
      .until = 40,
      .system = rubato::MultisymplecticSystem({"phi", "u", "v", "w", "p"}, skew(5, {{0, 1, 0.5}, {1, 2, 0.5}}),
                                              {skew(5, {{0, 4, 1}, {1, 3, 0.5}})}, "u^2/2 + u^3/6 - p*u - v*w/2"),
      .fields = {1},
      .first = [](double x) { return 1.5 / std::pow(std::cosh(x / std::sqrt(12.0)), 2); },
      .second = {},
      .given = {0, 1, 0, 0, 0},
      .converged =
          [](std::size_t n) {
            return peers::benjamin_bona_mahony({-50, 100, n}, "DOP853");
          },
      .converged_nodes = 360,
      .converged_steps = 4000};
  const Reference reference(problem);
  std::vector<Method> methods;
  const std::vector<std::size_t> grids = {48, 56, 64, 80, 96, 112, 128, 144, 160};
  for (const std::size_t n : grids) {
    for (const char* name : {"RK4", "IFRK4", "ETDRK4", "DOP853", "IFDOP853", "AB4", "AB6", "AB8"}) {
      methods.push_back(
          peer_method(problem, reference, name, peers::benjamin_bona_mahony(problem.line(n), name), n, 12));
    }
  }
  add_ours(problem, reference, {gauss(2), gauss(3), gauss(4), gauss(6), gauss(8)}, grids, 5, methods);
  report(problem, reference, methods, repeats);
}

}  // namespace comparison
