#include <malloc.h>
#include <omp.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

/// u_tt = Δu - u - u³.
MultisymplecticSystem cubic_waves(int dimensions) {
  if (dimensions == 2) {
    return wave_equation_2d("u^2/2 + u^4/4");
  }
  return make_system({"u", "v", "a", "b", "c"}, {{"u", "v", -1}}, {{{"u", "a", 1}}, {{"u", "b", 1}}, {{"u", "c", 1}}},
                     "(v^2 - a^2 - b^2 - c^2)/2 + u^2/2 + u^4/4");
}

grids::Grid cube(int dimensions, std::size_t cells) {
  std::vector<grids::Axis> axes;
  for (int a = 0; a < dimensions; ++a) {
    axes.push_back({std::string(1, "xyz"[a]), 0.0, 2.0 * std::numbers::pi, cells});
  }
  return grids::Grid(axes);
}

/// A run of ten steps; with `laws`, of which the residuals are asked for too.
void run(const LatticeOptions& options, int dimensions, std::size_t cells, bool laws) {
  const MultisymplecticSystem system = cubic_waves(dimensions);
  const grids::Grid grid = cube(dimensions, cells);
  InitialFields initial(system.fields().size());
  std::vector<double> u(grid.size()), v(grid.size(), 0.0);
  for (std::size_t i = 0; i < u.size(); ++i) {
    u[i] = 0.3 * std::cos(grid.axis(0).node(i % cells));
  }
  initial[0] = std::move(u);
  initial[1] = std::move(v);
  LatticeIntegrator lattice(system, grid, initial, options);
  static_cast<void>(lattice.node());
  for (int step = 0; step < 10; ++step) {
    static_cast<void>(lattice.step());
  }
  static_cast<void>(lattice.node());
  static_cast<void>(lattice.level());
  if (laws) {
    static_cast<void>(lattice.residuals());
  }
}

/// The most bytes that a process has had while it did this and nothing else.
double peak_bytes(const std::function<void()>& work) {
  const pid_t child = ::fork();
  if (child == 0) {
    omp_set_num_threads(1);  // a child has no other threads
#ifdef M_MMAP_THRESHOLD
    mallopt(M_MMAP_THRESHOLD, 1 << 17);  // arrays go back to the system: what a heap keeps between them is by chance
#endif
    work();
    ::_exit(0);
  }
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  REQUIRE((WIFEXITED(status) && WEXITSTATUS(status) == 0));
  return 1024.0 * static_cast<double>(usage.ru_maxrss);
}

/// Of a run: what one node more takes.
double bytes_of_node(const LatticeOptions& options, int dimensions, std::size_t few, std::size_t many,
                     bool laws = false) {
  const auto peak = [&](std::size_t cells) { return peak_bytes([&] { run(options, dimensions, cells, laws); }); };
  const double nodes = std::pow(many, dimensions) - std::pow(few, dimensions);
  return (peak(many) - peak(few)) / nodes;
}

struct Budget {
  std::string scheme;
  std::string space = "fourier";
  int stages = 1, dimensions = 3;
  std::size_t few = 64, many = 96;  ///< cells of an axis
  double arrays;                    ///< values of a node that it keeps at the peak, those of the initial data included
  double most = 1e3;                ///< bytes that are asked for
};

LatticeOptions options_of(const Budget& budget) {
  LatticeOptions options{.lagrangian = budget.scheme,
                         .stages = budget.stages,
                         .space = budget.space,
                         .step = 0.01,
                         .until = 1.0,
                         .levels = Levels::fixed};
  options.keeps_previous = false;
  return options;
}

/// A tenth for pages, and four values for what is made of no whole array.
double allowed(const Budget& budget) {
  return std::min(budget.most, 1.1 * sizeof(double) * budget.arrays + 32.0);
}

}  // namespace

TEST_CASE("a node takes no more memory than the arrays that a scheme names") {
  if (std::getenv("RUBATO_SANITIZED") != nullptr) {
    return;  // its own memory would count
  }
  // A row of waves has a real and an imaginary part of half as many values as there are nodes: one array.
  const Budget budget = GENERATE(values<Budget>({
      // Data 2, u and v of the level 2, and of the next one, or the derived fields of a level that is asked for, 3.
      {.scheme = "leapfrog", .arrays = 7},
      {.scheme = "euler-box", .arrays = 7},
      // Data 2, level 5, waves 2, G 1, C 1.5, weights 0.5, propagators of two lengths 4, a transform 1, derivatives 0.
      {.scheme = "splitting", .few = 96, .many = 128, .arrays = 17},
      {.scheme = "splitting", .space = "differences", .few = 96, .many = 128, .arrays = 18.5},
      // Data 2, level 5 and, of u and v, what it lacks 2; derivatives for the energy of a level 3. Of the Gauss step:
      // waves of u and v at level and stage 4, rows that are transformed 2, u there, at the stage and after, and rests
      // 6, their waves 3, their map 1, resolvent 3, forecast 9, transforms and wave numbers 4.
      {.scheme = "fourier", .arrays = 44, .most = 400},
      // Stages, their rests and waves twice, their map four times, what is left of their equation 6, the level 2.
      {.scheme = "fourier", .stages = 2, .arrays = 64},
      // Data 2, level 4 and what it lacks 4, the point of a sweep and then its correction 4, residuals 4, S'' 1, the
      // step and three before it 16; of the solver right sides and one more row in Fourier space 4, of the inverse
      // there what is not 0 on all waves 4.5, the first solution and the product of what varies 2.
      {.scheme = "box", .dimensions = 2, .few = 255, .many = 511, .arrays = 45.5, .most = 400},
  }));
  INFO(budget.scheme << ", " << budget.space << ", " << budget.stages << " stages");
  LatticeOptions options = options_of(budget);
  CHECK(bytes_of_node(options, budget.dimensions, budget.few, budget.many) < allowed(budget));
  // The twin: what a run without laws once made, laws and a copy of the level before.
  options.keeps_previous = true;
  CHECK(bytes_of_node(options, budget.dimensions, budget.few, budget.many, true) > allowed(budget));
}
