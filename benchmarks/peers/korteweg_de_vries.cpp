#include <cmath>
#include <numbers>

#include "comparison.hpp"
#include "equations.hpp"

namespace comparison {

rubato::MultisymplecticSystem korteweg_de_vries_system(const std::string& S) {
  return {{"phi", "u", "v", "w"}, skew(4, {{0, 1, 0.5}}), {skew(4, {{0, 3, 1}, {1, 2, -1}})}, S};
}

Problem korteweg_de_vries_soliton() {
  return {.name = "Korteweg-de Vries soliton",
          .from = -15,
          .length = 30,
          .until = 10,
          .system = korteweg_de_vries_system("v^2/2 - u*w + u^3"),
          .fields = {1},
          .first = [](double x) { return 2 / std::pow(std::cosh(x), 2); },
          .second = {},
          .given = {0, 1, 0, 0},
          .converged =
              [](std::size_t n) {
                return peers::korteweg_de_vries({-15, 30, n}, 6.0, 1.0, "IFDOP853");
              },
          .converged_nodes = 320,
          .converged_steps = 20000};
}

namespace {

void compare(const Problem& problem, double eta, const std::vector<std::size_t>& grids, int first, int our_first,
             int repeats) {
  const Reference reference(problem);
  std::vector<Method> methods;
  for (const std::size_t n : grids) {
    for (const char* name : {"IFRK4", "ETDRK4", "IFDOP853"}) {
      methods.push_back(
          peer_method(problem, reference, name, peers::korteweg_de_vries(problem.line(n), eta, 1.0, name), n, first));
    }
  }
  add_ours(problem, reference, {gauss(2), gauss(3), gauss(4), gauss(5), gauss(6), gauss(8)}, grids, our_first, methods);
  report(problem, reference, methods, repeats);
}

}  // namespace

/// u_t + 6 u u_x + u_xxx = 0: a soliton.
void korteweg_de_vries(int repeats) {
  compare(korteweg_de_vries_soliton(), 6.0, {80, 96, 108, 128, 144, 160, 180, 192, 216}, 200, 24, repeats);
}

/// u_t + u u_x + u_xxx = 0: two solitons, the taller overtaking.
void two_solitons(int repeats) {
  constexpr double pi = std::numbers::pi;
  const auto start = [](double x) {
    const auto soliton = [&](double A, double at) { return 3 * A * A / std::pow(std::cosh(A * (x + at) / 2), 2); };
    return soliton(25, 2) + soliton(16, 1);
  };
  compare({.name = "two Korteweg-de Vries solitons, errors beside the largest value, 1875,",
           .from = -pi,
           .length = 2 * pi,
           .until = 0.006,
           .system = korteweg_de_vries_system("v^2/2 - u*w + u^3/6"),
           .fields = {1},
           .first = start,
           .second = {},
           .given = {0, 1, 0, 0},
           .converged =
               [=](std::size_t n) {
                 return peers::korteweg_de_vries({-pi, 2 * pi, n}, 1.0, 1.0, "IFDOP853");
               },
           .converged_nodes = 640,
           .converged_steps = 40000,
           .scale = 1875},
          1.0, {216, 256, 288, 320, 384, 432}, 400, 100, repeats);
}

}  // namespace comparison
