#include <cmath>
#include <numbers>

#include "comparison.hpp"
#include "equations.hpp"

namespace comparison {

Problem schroedinger_soliton() {
  const double c = 4 * std::numbers::pi / 40;
  return {
      .name = "Schroedinger soliton",
      .from = -20,
      .length = 40,
      .until = 10,
      .system = rubato::MultisymplecticSystem({"p", "q", "v", "w"}, skew(4, {{0, 1, 1}}),
                                              {skew(4, {{0, 2, -1}, {1, 3, -1}})}, "(v^2 + w^2)/2 + (p^2 + q^2)^2/2"),
      .fields = {0, 1},
      .first = [=](double x) { return std::cos(c * x / 2) / std::cosh(x); },
      .second = [=](double x) { return std::sin(c * x / 2) / std::cosh(x); },
      .given = {1, 2, 0, 0},
      .converged =
          [](std::size_t n) {
            return peers::split_step({-20, 40, n}, 2.0, "kahan-li-8");
          },
      .converged_nodes = 320,
      .converged_steps = 8000};
}

void schroedinger(int repeats) {
  const Problem problem = schroedinger_soliton();
  const Reference reference(problem);
  std::vector<Method> methods;
  const std::vector<std::size_t> grids = {48, 64, 80, 96, 112, 128, 160, 192};
  for (const std::size_t n : grids) {
    for (const char* name : {"verlet", "blanes-moan-4", "kahan-li-6", "kahan-li-8"}) {
      const std::string called = std::string("split ") + name;
      methods.push_back(peer_method(problem, reference, called, peers::split_step(problem.line(n), 2.0, name), n, 20));
    }
    for (const char* name : {"ETDRK4", "IFRK4", "IFDOP853"}) {
      methods.push_back(peer_method(problem, reference, name, peers::schroedinger(problem.line(n), 2.0, name), n, 20));
    }
  }
  add_ours(problem, reference,
           {splitting("golden"), splitting("blanes-moan-4"), splitting("kahan-li-6"), splitting("kahan-li-8")}, grids,
           20, methods);
  add_ours(problem, reference, {gauss(3), gauss(4), gauss(6), gauss(8)}, grids, 5, methods);
  report(problem, reference, methods, repeats);
}

}  // namespace comparison
