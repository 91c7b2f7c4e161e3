// Data against the seam of the period: what contradicts a constraint, what does not repeat, and what only seems so.

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/periodicity.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr double pi = std::numbers::pi;

/// The level of a wave equation with these u and w.
InitialLevel with_w(const grids::Grid& grid, const Profile& u, const Profile& w, Collocation collocation) {
  return prepare_initial_level(sine_gordon(), grid,
                               {sampled(grid, u), sampled(grid, [](double) { return 0.0; }), sampled(grid, w)},
                               collocation);
}

bool refused(const grids::Grid& grid, const Profile& u, const Profile& w, Collocation collocation) {
  try {
    static_cast<void>(with_w(grid, u, w, collocation));
    return false;
  } catch (const InitialFieldError& error) {
    CHECK(error.field() == 2);
    CHECK_THAT(error.what(), Catch::Contains("the initial w contradicts its constraint") && Catch::Contains("at x = "));
    return true;
  }
}

std::optional<SeamBreak> seam(double from, double to, std::size_t cells, const Profile& u) {
  const grids::Grid grid({{"x", from, to, cells}});
  return find_seam_break(grid, sampled(grid, u));
}

double bump(double x) {
  return std::exp(-x * x);
}
double slope_of_bump(double x) {
  return -2.0 * x * std::exp(-x * x);
}

}  // namespace

TEST_CASE("a jump at the seam excuses what differs there, and nothing else") {
  for (const Collocation collocation : {Collocation::cells, Collocation::nodes, Collocation::corners}) {
    INFO("collocation " << static_cast<int>(collocation.points));
    const grids::Grid grid({{"x", -10, 10, 401}});
    CHECK(refused(
        grid, bump, [](double x) { return 3.0 * x; }, collocation));
    CHECK(refused(
        grid, bump, [](double x) { return slope_of_bump(x) + 0.01 * x; }, collocation));
    CHECK(refused(
        grid, bump, [](double) { return 0.0; }, collocation));
    // Right everywhere but at the seam, where u has a kink, or even jumps.
    CHECK_FALSE(refused(
        grid, [](double x) { return 1.5 * x * x; }, [](double x) { return 3.0 * x; }, collocation));
    CHECK_FALSE(refused(
        grid, [](double x) { return 2.0 * x; }, [](double) { return 2.0; }, collocation));
    CHECK_FALSE(refused(grid, bump, slope_of_bump, collocation));
    // The same, but wrong inside.
    CHECK(refused(
        grid, [](double x) { return 1.5 * x * x; }, [](double x) { return 3.0 * x + bump(x); }, collocation));
    CHECK(refused(
        grid, [](double x) { return 2.0 * x; }, [](double) { return 2.2; }, collocation));
  }
}

TEST_CASE("seams in y are seams") {
  const auto system = wave_equation_2d("1 - cos(u)");
  const grids::Grid grid({{"x", -5, 5, 51}, {"y", -5, 5, 53}});
  const auto level = [&](const auto& u, const auto& b) {
    InitialFields initial(4);
    for (const int f : {0, 1, 3}) {
      initial[static_cast<std::size_t>(f)] = std::vector<double>(grid.size(), 0.0);
    }
    for (std::size_t i = 0; i < grid.size(); ++i) {
      const double x = grid.axis(0).node(grid.place(i)[0]);
      const double y = grid.axis(1).node(grid.place(i)[1]);
      (*initial[0])[i] = u(x, y);
      (*initial[3])[i] = b(x, y);
    }
    return prepare_initial_level(system, grid, initial);
  };
  const auto hump = [](double x, double y) { return bump(x) * bump(y); };
  const auto hump_y = [](double x, double y) { return bump(x) * slope_of_bump(y); };
  CHECK(level(hump, hump_y).cautions.empty());
  CHECK_THROWS_AS(level(hump, [](double, double y) { return 3.0 * y; }), InitialFieldError);
  const auto jumping = level([](double x, double y) { return bump(x) * y; }, [](double x, double) { return bump(x); });
  REQUIRE(jumping.cautions.size() == 1);
  CHECK_THAT(jumping.cautions.front(),
             Catch::Contains("the initial u is not periodic in y") && Catch::Contains("x = "));
}

TEST_CASE("a potential is compared with its slope and its periodic part") {
  const auto system = korteweg_de_vries(6, 1);
  const grids::Grid grid({{"x", -pi, pi, 101}});
  const auto agrees = [&](const Profile& phi, const Profile& u) {
    try {
      static_cast<void>(
          initial_level(system, grid, {sampled(grid, phi), sampled(grid, u), std::nullopt, std::nullopt}));
      return true;
    } catch (const InitialFieldError& error) {
      CHECK(error.field() == 0);
      return false;
    }
  };
  const auto sine = [](double x) { return std::sin(x); };
  const auto cosine = [](double x) { return std::cos(x); };
  CHECK(agrees(sine, cosine));
  CHECK(agrees([](double x) { return 7.0 + std::sin(x); }, cosine));  // up to a constant
  CHECK(agrees([](double x) { return 2.0 * x + std::sin(x); }, [](double x) { return 2.0 + std::cos(x); }));
  CHECK(agrees(sine, [](double x) { return 2.0 + std::cos(x); }));  // the periodic part, as records have it
  CHECK_FALSE(agrees([](double x) { return 3.0 * x + std::sin(x); }, [](double x) { return 2.0 + std::cos(x); }));
  CHECK_FALSE(agrees([](double x) { return 3.0 * x; }, cosine));
  CHECK_FALSE(agrees([](double x) { return std::sin(2 * x); }, cosine));
}

TEST_CASE("data that do not repeat with the period are found, jumps and kinks") {
  const auto ramp = seam(0, 1, 101, [](double x) { return x; });
  REQUIRE(ramp);
  CHECK(ramp->jump);
  CHECK(ramp->across == Approx(-1.0));  // the value jumps from 1 to 0
  CHECK(ramp->inside < 1e-14);
  const auto kink = seam(-10, 10, 401, [](double x) { return 4 * std::atan(std::exp(x)); });
  REQUIRE(kink);
  CHECK(kink->across == Approx(-2 * pi).epsilon(1e-3));
  const auto square = seam(-1, 1, 101, [](double x) { return x * x; });
  REQUIRE(square);
  CHECK_FALSE(square->jump);
  CHECK(square->across == Approx(-4.0).epsilon(0.05));  // the slope from 2 to -2, over one cell
  CHECK(seam(0, 6.28, 101, [](double x) { return std::sin(x); }));
  CHECK(seam(-6, 6, 201, [](double x) { return sech(x); }));
  CHECK(seam(-10, 10, 401, [](double x) { return std::tanh(10 * x); }));
}

TEST_CASE("data that repeat give no alarm, be they smooth, steep, rough or random") {
  for (const std::size_t cells : {20U, 21U, 32U, 101U, 128U, 1001U}) {
    INFO(cells << " cells");
    CHECK_FALSE(seam(0, 2 * pi, cells, [](double x) { return std::sin(x); }));
    CHECK_FALSE(seam(0, 2 * pi, cells, [](double x) { return std::exp(3 * std::cos(2 * x + 1)); }));
    CHECK_FALSE(seam(-20, 20, cells, [](double x) { return sech(x); }));
    CHECK_FALSE(seam(-1, 1, cells, [](double x) { return std::abs(x); }));  // the cusp at the seam is one of two
    CHECK_FALSE(seam(-1, 1, cells, [](double x) { return std::sin(pi * x) > 0 ? 1 : -1; }));
    CHECK_FALSE(seam(0, 1, cells, [](double) { return 3.7; }));
    CHECK_FALSE(seam(0, 1, cells, [](double) { return 0.0; }));
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 200; ++i) {
      CHECK_FALSE(seam(0, 1, cells, [&](double) { return normal(random); }));
    }
  }
  // A narrow hump right at the seam, four cells wide.
  CHECK_FALSE(seam(0, 10, 201, [](double x) { return bump(5 * x) + bump(5 * (x - 10)); }));
}

TEST_CASE("data for a field that exists at midpoints only are not used, which is said") {
  const auto system = korteweg_de_vries(6, 1);
  const grids::Grid grid({{"x", -10, 10, 101}});
  const auto level = prepare_initial_level(
      system, grid, {std::nullopt, sampled(grid, bump), std::nullopt, sampled(grid, bump)}, Collocation::cells);
  REQUIRE(level.cautions.size() == 1);
  CHECK_THAT(level.cautions.front(), Catch::Contains("the initial w is not used"));
}
