// Steps of Gauss collocation so long that its fixed point does not contract: Newton's method with GMRES.

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/grids/fourier.hpp>
#include <rubato/pde/gauss_step.hpp>
#include <rubato/pde/lattice.hpp>
#include <rubato/pde/step_equation.hpp>
#include <rubato/pde/tangent.hpp>

#include "humps.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr double speed = 0.02;

/// A kink and an antikink that approach each other at `speed`, 2|s| apart:
/// u = 4 atan(sinh(γs)/(c cosh(γx))), s = ct.
double kinks(double x, double s) {
  const double gamma = 1.0 / std::sqrt(1.0 - speed * speed);
  return 4.0 * std::atan(std::sinh(gamma * s) / (speed * std::cosh(gamma * x)));
}

grids::Grid ring() {
  return grids::Grid({{"x", -36, 36, 240}});
}

LatticeLevel kinks_at(double s) {
  const grids::Grid grid = ring();
  InitialFields initial(3);
  auto& u = initial[0].emplace(grid.size());
  auto& v = initial[1].emplace(grid.size());
  constexpr double d = 1e-4;  // of a derivative by differences of fourth order, to 1e-13
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const double x = grid.axis(0).node(grid.place(i)[0]);
    u[i] = kinks(x, s);
    v[i] = speed * (8.0 * (kinks(x, s + d) - kinks(x, s - d)) - (kinks(x, s + 2 * d) - kinks(x, s - 2 * d))) / (12 * d);
  }
  return initial_level(sine_gordon(), grid, initial, Collocation::nodes);
}

grids::FieldSet derivative(const grids::FieldSet& z) {
  grids::FieldSet result(z.fields(), z.size());
  grids::SpectralDerivative{ring()}(0, z.pointers(), result.pointers());
  return result;
}

/// What the stages leave of u_t = v, v_t = w_x - strength sin u, w = u_x.
double left_by_stages(StageSource& stages, double strength) {
  grids::FieldSet z(3, ring().size()), rate = z;
  double largest = 0.0;
  for (int i = 0; i < stages.count(); ++i) {
    stages.stage(i, z, rate);
    const grids::FieldSet slope = derivative(z);
    for (std::size_t x = 0; x < z.size(); ++x) {
      const auto at = [x](const grids::FieldSet& of, int f) { return of.field(f)[x]; };
      largest = std::max({largest, std::abs(at(rate, 0) - at(z, 1)),
                          std::abs(at(rate, 1) - at(slope, 2) + strength * std::sin(at(z, 0))),
                          std::abs(at(z, 2) - at(slope, 0))});
    }
  }
  return largest;
}

}  // namespace

TEST_CASE("stages of steps in which no fixed point contracts are those of Gauss collocation") {
  for (const int stages : {1, 2, 3, 4}) {
    INFO(stages << " stages");
    const auto scheme = make_gauss_lattice(sine_gordon(), ring(), stages, kinks_at(-12.0));
    const double h = 20.0;
    const MultisymplecticSystem system = sine_gordon();
    const auto of_levels = make_midpoint_equation(system, ring(), Collocation::nodes, kinks_at(-12.0), h);
    double time = 0.0;
    for (int k = 0; k < 5; ++k) {
      const LatticeLevel before = scheme->level();
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      time += h;
      // w_x has waves of up to k = π/Δx ~ 10, twice, on values of 2π.
      constexpr double rounding = 64.0 * 100.0 * epsilon * 2.0 * std::numbers::pi;
      if (const auto source = scheme->stages()) {
        CHECK(left_by_stages(*source, 1.0) <= rounding);
        CHECK(left_by_stages(*source, 1.001) > 1e-4);  // the twin: of another equation
      }
      scheme->accept();
      if (stages == 1) {  // whose equation two levels give
        CHECK(of_levels->measure(before, scheme->level(), h).residual.largest() <= rounding);
        CHECK(of_levels->measure(before, scheme->level(), 1.1 * h).residual.largest() > 1e-4);
      }
    }
    // They lead where the kinks go: by 0.4 of their width in each step.
    double error = 0.0;
    for (std::size_t i = 0; i < ring().size(); ++i) {
      error = std::max(error, std::abs(scheme->level().fields.field(0)[i] -
                                       kinks(ring().axis(0).node(ring().place(i)[0]), -12.0 + speed * time)));
    }
    CHECK(error < (stages == 1 ? 0.5 : 1e-2));
  }
}

TEST_CASE("a long step of Gauss collocation goes on from a saved state bit by bit") {
  const double h = 20.0;
  const LatticeLevel first = kinks_at(-12.0);
  const auto scheme = make_gauss_lattice(sine_gordon(), ring(), 3, first);
  const auto resumed = make_gauss_lattice(sine_gordon(), ring(), 3, first);
  static_cast<void>(after(*scheme, h, 3));
  StateWriter state;
  scheme->save(state);
  StateReader reader(state.values());
  resumed->restore(reader);
  CHECK(reader.done());
  const grids::FieldSet expected = after(*scheme, h, 2), found = after(*resumed, h, 2);
  CHECK(std::ranges::equal(expected.all(), found.all()));
}

TEST_CASE("tangents of a long step are the derivatives of the step") {
  const double h = 20.0, d = 1e-4;
  const LatticeLevel first = kinks_at(-12.0);
  const auto moved = [&](double part) {
    LatticeLevel level = kinks_at(-12.0);
    const LatticeLevel ahead = kinks_at(-11.9);
    for (std::size_t i = 0; i < level.fields.all().size(); ++i) {
      level.fields.all()[i] += part * (ahead.fields.all()[i] - first.fields.all()[i]);
    }
    return level;
  };
  const auto step_from = [&](double part) {
    return after(*make_gauss_lattice(sine_gordon(), ring(), 2, moved(part)), h, 1);
  };
  grids::FieldSet u = moved(1.0).fields, u_after = u;
  for (std::size_t i = 0; i < u.all().size(); ++i) {
    u.all()[i] -= first.fields.all()[i];
  }
  LatticeLevel end = first;
  end.fields.copy_from(step_from(0.0));
  const auto tangents = make_gauss_tangents(sine_gordon(), ring(), 2, {});
  REQUIRE((*tangents)(first, end, h, u, u_after) == Status::success);
  const grids::FieldSet plus = step_from(d), minus = step_from(-d);
  double difference = 0.0, wrong = 0.0, size = 0.0;
  for (std::size_t i = 0; i < 2 * ring().size(); ++i) {  // u and v; w is in ker M
    const double expected = (plus.all()[i] - minus.all()[i]) / (2.0 * d);
    size = std::max(size, std::abs(expected));
    difference = std::max(difference, std::abs(u_after.all()[i] - expected));
    wrong = std::max(wrong, std::abs(u.all()[i] - expected));
  }
  // Differences of a step that is known to some 1e-12 (h² ε), by d, and their third order, d² times the third
  // derivative.
  CHECK(difference < 1e-5 * size);
  CHECK(wrong > 1e-3 * size);  // the twin: the step does something to a tangent
}
