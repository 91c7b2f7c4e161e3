// S(z, x): media that are not the same everywhere.

#include <algorithm>
#include <cmath>
#include <numbers>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr double pi = std::numbers::pi;

/// What a short run leaves of the laws of energy and of momentum at its end, and by how much momentum changed.
struct End {
  double energy = 0.0, momentum = 0.0, change = 0.0, deviation = 0.0;
};

End end_of(const MultisymplecticSystem& system, const LatticeOptions& options, std::size_t cells) {
  const grids::Grid grid({{"x", -8, 8, cells}});
  InitialFields initial(system.fields().size());
  const auto hump = [](double x) { return std::exp(3 * std::cos(pi * (x - 1) / 8) - 3); };
  initial[0] = sampled(grid, hump);
  initial[1] = sampled(grid, [&](double x) { return 0.5 * hump(x + 1); });
  LatticeIntegrator lattice(system, grid, initial, options);
  const double start = lattice.totals()[1];
  End end;
  while (!lattice.finished()) {
    const StepReport report = lattice.step();
    REQUIRE(report.status == Status::success);
    end.deviation = std::max(end.deviation, std::abs(report.energy - lattice.levels().energy()));
    const auto sizes = lattice.residuals();
    end.energy = sizes[0].largest();
    end.momentum = sizes[1].largest();
  }
  end.change = std::abs(lattice.totals()[1] - start);
  return end;
}

const char* const varying = "(1 + 0.5*cos(pi*x/8))*u^2/2 + (1 - 0.3*sin(pi*x/8))*u^4/4";

}  // namespace

TEST_CASE("S may name the coordinates that its directions have, and nothing else") {
  const auto system = wave_equation("x^2*u^2/2");
  CHECK(system.coordinates() == std::vector<int>{0});
  CHECK(system.varies_in_space(0));
  CHECK_FALSE(system.varies_in_space(1));
  CHECK(system.variables().size() == 4);
  CHECK(system.hessian(std::vector{1.0, 1.0, 1.0, 3.0})(0, 0) == 9.0);
  CHECK(wave_equation("u^2/2").coordinates().empty());
  CHECK(wave_equation_2d("y*u").coordinates() == std::vector<int>{1});
  CHECK_THROWS(wave_equation("y*u^2/2"));  // there is no y on a line
  CHECK_THROWS(wave_equation("t*u^2/2"));
  // A field called x is a field.
  const auto named = make_system({"x", "v", "w"}, {{"x", "v", -1}}, {{{"x", "w", 1}}}, "(v^2 - w^2)/2 + x^2/2");
  CHECK(named.coordinates().empty());
}

TEST_CASE("in a medium that varies momentum is a balance, at the order of the scheme, and energy a law") {
  const auto system = wave_equation(varying);
  for (const auto& [scheme, order] : {std::pair("box", 2), std::pair("euler-box", 1)}) {
    INFO(scheme);
    const auto sizes = [&, name = scheme](std::size_t refined) {
      const double h = 0.04 / static_cast<double>(refined);
      return end_of(system, {.lagrangian = name, .step = h, .until = 2, .levels = Levels::fixed}, 80 * refined + 1);
    };
    const End coarse = sizes(1), fine = sizes(2), finest = sizes(4);
    CHECK(coarse.change > 0.1);
    CHECK(std::log2(coarse.momentum / fine.momentum) == Approx(order).margin(0.3));
    CHECK(std::log2(fine.momentum / finest.momentum) == Approx(order).margin(0.2));
    CHECK(std::log2(fine.energy / finest.energy) == Approx(order).margin(0.2));
  }
  // With spectral derivatives momentum does not see h: what is left is aliasing, e^-40 of the hump's harmonics here.
  const End spectral = end_of(system, {.lagrangian = "fourier", .step = 0.04, .until = 2, .levels = Levels::fixed}, 81);
  CHECK(spectral.change > 0.1);
  CHECK(spectral.momentum < 1e-9);
}

TEST_CASE("in a medium that varies the energy law holds on variable levels") {
  for (const LatticeOptions& options : {LatticeOptions{.lagrangian = "box", .step = 0.05, .until = 2},
                                        LatticeOptions{.lagrangian = "fourier", .step = 0.05, .until = 2},
                                        LatticeOptions{.lagrangian = "fourier", .stages = 2, .step = 0.1, .until = 2},
                                        LatticeOptions{.lagrangian = "leapfrog", .step = 0.05, .until = 2},
                                        LatticeOptions{.lagrangian = "splitting",
                                        .step = 0.05,
                                        .until = 2,
                                        .potential = {.kind = StepPotentialChoice::Kind::automatic}}}) {
    INFO(options.lagrangian << options.stages);
    CHECK(end_of(wave_equation(varying), options, 81).deviation < 1e-12);
  }
}

TEST_CASE("a medium that jumps across the seam is told, one that repeats is not") {
  const auto cautions = [](const std::string& V) {
    const grids::Grid grid({{"x", -8, 8, 81}});
    const auto wave = [](double x) { return 1.0 + 0.5 * std::cos(pi * x / 8); };
    return LatticeIntegrator(wave_equation(V), grid,
                             {sampled(grid, wave), sampled(grid, [](double) { return 0.0; }), std::nullopt},
                             {.step = 0.01, .until = 1})
        .cautions();
  };
  CHECK(cautions(varying).empty());
  REQUIRE(cautions("(1 + x/16)*u^2/2").size() == 1);
  CHECK_THAT(cautions("(1 + x/16)*u^2/2").front(),
             Catch::Matchers::Contains("the medium is not periodic") && Catch::Matchers::Contains("dS/du jumps"));
}

TEST_CASE("a coefficient that varies in the place of fields without an equation of motion has no splitting") {
  const auto stiff =
      make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "v^2/2 - (1 + 0.5*cos(pi*x/8))*w^2/2 + u^2/2");
  CHECK_THROWS_WITH(end_of(stiff, {.lagrangian = "splitting", .step = 0.05, .until = 1}, 81),
                    Catch::Matchers::Contains("constant coefficients S depends on w"));
  CHECK(end_of(stiff, {.lagrangian = "box", .step = 0.05, .until = 1}, 81).deviation < 1e-12);
}
