// An accepted step solves its equation to rounding, by the residual, or the step is not accepted: also where S''
// changes so fast that corrections are small and mend nothing.

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <rubato/pde/cell_sweep.hpp>
#include <rubato/pde/lattice_method.hpp>
#include <rubato/pde/row_rounding.hpp>

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
  for (const char* name : {"box", "fourier", "euler-box", "leapfrog"}) {
    for (const double width : {1e-2, 1e-3, 1e-4, 1e-5}) {
      const Worst worst = steps_over_a_kink({.name = name}, width);
      INFO(name << ", width " << width << ": " << worst.steps << " steps, the last " << to_string(worst.end));
      CHECK(worst.residual <= 1.0);
      CHECK(worst.steps >= (width > 1e-3 ? 300 : 10));
    }
  }
}

TEST_CASE("the backward error of a step tells a step that is solved from one that is nearly so") {
  const grids::Grid line({{"x", -8, 8, 45}});
  const MultisymplecticSystem system = sine_gordon();
  for (const char* name : {"box", "fourier"}) {
    INFO(name);
    const auto method = make_lattice_method({.name = name});
    InitialFields initial(3);
    initial[0] = sampled(line, [](double x) { return std::cos(2 * std::numbers::pi * x / 16); });
    initial[1] = sampled(line, [](double x) { return std::sin(2 * std::numbers::pi * x / 16); });
    const LatticeLevel first = method->first_level(system, line, initial).level;
    const double h = 0.5;
    const auto scheme = method->scheme(system, line, first, h);
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    scheme->accept();
    CellSweep sweep(system, line, std::string(name) == "box" ? Collocation::cells : Collocation::nodes);
    const auto backward_error = [&](double displacement) {
      grids::FieldSet after = scheme->level().fields, point = after, rate = after, residual = after;
      after.field(1)[7] += displacement;
      for (int f = 0; f < system.field_count(); ++f) {
        const bool at_midpoints = system.structure().at_midpoints()[static_cast<std::size_t>(f)];
        for (std::size_t i = 0; i < line.size(); ++i) {
          const double z_0 = first.fields.field(f)[i], z_1 = after.field(f)[i];
          point.field(f)[i] = at_midpoints ? z_1 : 0.5 * (z_0 + z_1);
          rate.field(f)[i] = at_midpoints ? 0.0 : z_1 - z_0;
        }
      }
      grids::FieldSet hessian(static_cast<int>(system.varying_hessian().size()), line.size());
      return sweep(std::as_const(point).pointers(), first.slopes, std::as_const(rate).pointers(), 1.0 / h,
                   residual.pointers(), hessian.pointers())
          .backward_error;
    };
    // Levels of size 1 are stored rounded, and their differences are about as large: a few units in the last place.
    CHECK(backward_error(0.0) < 16.0 * epsilon);
    CHECK(backward_error(1e-13) > 64.0 * epsilon);
  }
}

TEST_CASE("the rounding of a row is that of the values it is computed from, in any units") {
  const grids::Grid line({{"x", -8, 8, 45}});
  const MultisymplecticSystem system = sine_gordon();  // fields u, v, w; rows -v_t + w_x - sin u, u_t - v, -u_x + w
  const RowRounding rounding(system, line);
  grids::FieldSet hessian(static_cast<int>(system.varying_hessian().size()), line.size());
  hessian.fill(1.0);
  const double h = 0.5;
  RowRounding::Values values;
  // The middle of a step from v = 1 to v = -1 at u = 0: no term is left of the second row, and v is rounded on the way.
  values.point[1] = 1.0;
  values.increment[1] = 2.0;
  const RowRounding::Sizes bounds = rounding(values, 1.0 / h, hessian);
  CHECK(bounds[1] >= 1.0);
  // The first row holds 2/h, and the coefficients of 2/h, 2/Δx and 1 carry three times as much.
  CHECK(bounds[0] >= 2.0 / h);
  CHECK(bounds[0] <= 5.0 * 2.0 / h);
  // A unit of the fields that is 2^20 times larger makes the bounds as many times smaller, and nothing else.
  for (std::size_t f = 0; f < 3; ++f) {
    values.point[f] = std::ldexp(values.point[f], -20);
    values.increment[f] = std::ldexp(values.increment[f], -20);
  }
  const RowRounding::Sizes scaled = rounding(values, 1.0 / h, hessian);
  for (std::size_t f = 0; f < 3; ++f) {
    CHECK(std::ldexp(scaled[f], 20) == bounds[f]);
  }
  // Fields that are 0 explain no residual.
  CHECK(rounding({}, 1.0 / h, hessian)[1] == 0.0);
}
