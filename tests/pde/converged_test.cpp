// An accepted step solves its equation to rounding, by the residual, or the step is not accepted: also where S'' changes
// so fast that corrections are small and mend nothing.

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include <catch2/catch.hpp>
#include <fmt/format.h>

#include <rubato/pde/lattice_method.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

struct Worst {
  int steps = 0;
  double residual = 0.0;  ///< of all accepted steps, relative to what rounding may make of it
  Status end = Status::success;
};

/// The wave equation with a kink of V at u = 0.3, rounded on a length of `width`: V'' is 1/(2 width) there and about 1
/// elsewhere, and waves of size 1 go to and fro over it.
Worst steps_over_a_kink(const LatticeMethodChoice& choice, double width) {
  const grids::Grid line({{"x", -8, 8, 45}});
  const MultisymplecticSystem system =
      wave_equation(fmt::format("1 - cos(u) + sqrt((u - 0.3)^2 + {:g})/2", width * width));
  const auto method = make_lattice_method(choice);
  InitialFields initial(3);
  const auto hump = [](double x) { return std::exp(2 * std::cos(2 * std::numbers::pi * (x - 1) / 16) - 2); };
  initial[0] = sampled(line, hump);
  initial[1] = sampled(line, [&](double x) { return 0.5 * hump(x + 2); });
  const LatticeLevel first = method->first_level(system, line, initial).level;
  const double h = 0.05;
  const auto scheme = method->scheme(system, line, first, h);
  const auto equation = method->equation(system, line, first, h);
  // 64 units in the last place of the terms of a row: z/h, 2z/Δx with |z| < 2, S''z with S'' < 1/(2 width) + 1.
  const double rounding = 64.0 * epsilon * 2.0 * (2.0 / h + 2.0 / line.spacing(0) + 0.5 / width + 2.0);
  Worst worst;
  for (; worst.steps < 300; ++worst.steps) {
    const LatticeLevel before = scheme->level();
    worst.end = scheme->advance(h, 0.0);
    if (worst.end != Status::success) {
      break;
    }
    scheme->accept();
    worst.residual =
        std::max(worst.residual, equation->measure(before, scheme->level(), h).residual.largest() / rounding);
  }
  return worst;
}

}  // namespace

TEST_CASE("an accepted step of a lattice solves its equation, or is not accepted") {
  for (const char* name : {"box", "fourier", "euler-box"}) {
    for (const double width : {1e-2, 1e-3, 1e-4, 1e-5}) {
      const Worst worst = steps_over_a_kink({.name = name}, width);
      INFO(name << ", width " << width << ": " << worst.steps << " steps, the last " << to_string(worst.end));
      CHECK(worst.residual <= 1.0);
      CHECK(worst.steps >= (width > 1e-3 ? 300 : 20));
    }
  }
}
