// Many orbits of Hénon and Heiles: each alone in a loop over integrate(), all of them one after the other at the best
// that the library does for one orbit, and side by side. Prints a table of medians, and ratios within each pass.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <omp.h>

#include <rubato/ode/integrate.hpp>

namespace {

using namespace rubato;

constexpr std::size_t members = 4096;
constexpr int passes = 7;

std::vector<InitialState> states() {
  std::vector<InitialState> result(members);
  for (std::size_t m = 0; m < members; ++m) {
    const auto part = [&](double by) { return 0.2 * std::sin(by * static_cast<double>(m + 1)); };
    result[m] = {.q = {part(1.1), part(2.3)}, .p = {part(3.7), part(4.9)}};
  }
  return result;
}

template <typename Run>
double seconds(const Run& run) {
  const auto begin = std::chrono::steady_clock::now();
  run();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

double median(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

/// One orbit after the other: the integrator's steps and nothing else, of one integrator for each.
double one_after_another(const Hamiltonian& hamiltonian, const std::vector<InitialState>& initial,
                         const IntegrationOptions& options) {
  double sum = 0.0;
  for (const InitialState& state : initial) {
    OrbitIntegrator integrator(hamiltonian, state, options);
    while (!integrator.finished()) {
      if (integrator.step().status != Status::success) {
        std::abort();
      }
    }
    sum += integrator.q()[0];
  }
  return sum;
}

double together(const Hamiltonian& hamiltonian, const std::vector<InitialState>& initial,
                const IntegrationOptions& options) {
  double sum = 0.0;
  for (const OrbitEnd& end : integrate(hamiltonian, initial, options)) {
    sum += end.q[0];
  }
  return sum;
}

}  // namespace

int main() {
  const Hamiltonian hamiltonian({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 + (x^2 + y^2)/2 + x^2*y - y^3/3");
  const std::vector<InitialState> initial = states();
  fmt::print("{} orbits, ns a step of one; medians of {} passes; ratios of the passes' own times\n", members, passes);
  fmt::print("{:<16}{:>9}{:>7}{:>12}{:>14}{:>12}{:>9}{:>13}\n", "composition", "levels", "steps", "one by one",
             "side by side", "two threads", "ratio", "two threads");
  for (const Levels levels : {Levels::fixed, Levels::variable}) {
    for (const std::string composition : {"golden", "verlet", "blanes-moan-4", "kahan-li-8"}) {
      const IntegrationOptions options{
          .lagrangian = Splitting{composition}, .step = 0.1, .until = 200.0, .levels = levels};
      const double steps = 2000.0 * members;
      std::vector<double> alone, one, two, ratio, more;
      double expected = 0.0, found = 0.0;
      for (int pass = 0; pass < passes; ++pass) {
        alone.push_back(seconds([&] { expected = one_after_another(hamiltonian, initial, options); }));
        omp_set_num_threads(1);
        one.push_back(seconds([&] { found = together(hamiltonian, initial, options); }));
        omp_set_num_threads(2);
        two.push_back(seconds([&] { found += together(hamiltonian, initial, options); }));
        if (found != 2.0 * expected) {
          fmt::print(stderr, "{}: the orbits are not the same\n", composition);
          return EXIT_FAILURE;
        }
        ratio.push_back(alone.back() / one.back());
        more.push_back(one.back() / two.back());
      }
      fmt::print("{:<16}{:>9}{:>7}{:>12.1f}{:>14.1f}{:>12.1f}{:>9.1f}{:>13.2f}\n", composition,
                 levels == Levels::fixed ? "fixed" : "variable", 2000, 1e9 * median(alone) / steps,
                 1e9 * median(one) / steps, 1e9 * median(two) / steps, median(ratio), median(more));
      std::fflush(stdout);
    }
  }
}
