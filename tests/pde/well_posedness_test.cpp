// Waves that grow the faster the shorter they are, and those that only grow.

#include <algorithm>
#include <cmath>
#include <complex>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/pde/lattice.hpp>
#include <rubato/pde/well_posedness.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

/// With values of all fields that vary over the grid.
std::optional<ShortWaveGrowth> growth(const MultisymplecticSystem& system, std::size_t cells = 64, double size = 1.0) {
  std::vector<grids::Axis> axes;
  for (int a = 0; a < system.directions(); ++a) {
    axes.push_back({std::string(1, static_cast<char>('x' + a)), 0.0, 10.0, a == 0 ? cells : 16});
  }
  const grids::Grid grid(axes);
  LatticeLevel level{grids::FieldSet(system.field_count(), grid.size()), {}};
  for (int f = 0; f < system.field_count(); ++f) {
    for (std::size_t i = 0; i < grid.size(); ++i) {
      level.fields.field(f)[i] = size * std::sin(0.7 * static_cast<double>(i) + f);
    }
  }
  return find_short_wave_growth(system, grid, level);
}

constexpr double pi = 3.141592653589793;

}  // namespace

TEST_CASE("equations of the wrong sign are ill-posed: short waves grow without bound") {
  const double k = pi * 64 / 10;
  SECTION("wave equation, u_tt = -u_xx - sin u: the rate is sqrt(k^2 - cos u)") {
    const auto found =
        growth(make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "(v^2 + w^2)/2 + 1 - cos(u)"));
    REQUIRE(found);
    CHECK(found->rate == Approx(k).epsilon(0.01));
    CHECK(found->rate_of_half == Approx(2 * k).epsilon(0.01));
  }
  SECTION("in one direction of two") {
    const auto found = growth(
        make_system({"u", "v", "a", "b"}, {{"u", "v", -1}}, {{{"u", "a", 1}}, {{"u", "b", 1}}}, "(v^2 - a^2 + b^2)/2"));
    REQUIRE(found);
    CHECK(found->wave[0] == 0.0);
    CHECK(found->rate == Approx(pi * 1.6));
  }
  SECTION("the bad Boussinesq equation, whose rate is k sqrt(k^2 - 1 - 2u)") {
    const auto found = growth(make_system({"phi", "u", "v", "w", "p"}, {{"phi", "v", -1}},
                                          {{{"phi", "p", 1}, {"u", "w", 1}}}, "v^2/2 + w^2/2 + u^2/2 + u^3/3 - p*u"));
    REQUIRE(found);
    CHECK(found->rate == Approx(k * k).epsilon(0.02));
  }
  SECTION("heat forward and backward, u_t = u_xx, p_t = -p_xx") {
    const auto found =
        growth(make_system({"p", "u", "a", "b"}, {{"p", "u", 1}}, {{{"p", "a", 1}, {"u", "b", 1}}}, "a*b"));
    REQUIRE(found);
    CHECK(found->rate == Approx(k * k));
  }
  SECTION("a wave equation whose sign depends on the state") {
    // u_tt = W'(u_x)_x with W'' = 1 - 3 e², negative for |e| > 0.58.
    const auto elastic =
        make_system({"u", "v", "e", "p"}, {{"u", "v", -1}}, {{{"u", "p", 1}}}, "v^2/2 - p*e + e^2/2 - e^4/4");
    const auto found = growth(elastic);
    REQUIRE(found);
    CHECK_FALSE(found->state.empty());  // not about the mean, where e = 0
    CHECK(found->rate == Approx(std::sqrt(2.0) * k).epsilon(0.02));
    CHECK_FALSE(growth(elastic, 64, 0.5));
  }
  SECTION("in units in which c^2 is 9e16, and 1e-12") {
    for (const std::string c : {"9e16", "1e-12"}) {
      CHECK(growth(make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", c == "9e16" ? 9e16 : 1e-12}}},
                               "v^2/2 + " + c + "*w^2/2")));
      CHECK_FALSE(growth(make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", c == "9e16" ? 9e16 : 1e-12}}},
                                     "v^2/2 - " + c + "*w^2/2")));
    }
  }
}

TEST_CASE("instabilities that are bounded give no alarm, nor do equations without any") {
  for (const std::size_t cells : {16U, 64U, 1024U}) {
    INFO(cells << " cells");
    CHECK_FALSE(growth(sine_gordon(), cells));
    CHECK_FALSE(growth(wave_equation("(u^2 - 1)^2/4"), cells));
    CHECK_FALSE(growth(wave_equation("-50*u^2"), cells));  // waves longer than 0.6 grow
    CHECK_FALSE(growth(schroedinger(2.0), cells));
    CHECK_FALSE(growth(schroedinger(-2.0), cells));
    CHECK_FALSE(growth(schroedinger(2.0), cells, 30.0));  // a band of modulation wider than the grid's waves
    CHECK_FALSE(growth(korteweg_de_vries(6, 1), cells));
    CHECK_FALSE(growth(korteweg_de_vries(-6, 0.022), cells, 10.0));
    CHECK_FALSE(growth(benjamin_bona_mahony(1, 1, 1), cells));
    CHECK_FALSE(growth(camassa_holm(1), cells));
    CHECK_FALSE(growth(good_boussinesq(), cells));
    CHECK_FALSE(growth(dirac(1, 1), cells));
    CHECK_FALSE(growth(zakharov_kuznetsov(), cells));
    CHECK_FALSE(growth(wave_equation_2d("1 - cos(u)"), cells));
  }
}

TEST_CASE("the finite roots of a pencil are those of its polynomial") {
  // KdV about u_0 on the wave k: σ = i(γ²k³ - ηu_0 k).
  const auto system = korteweg_de_vries(6, 0.5);
  const std::vector<double> state = {0.0, 0.3, 0.0, 0.0};
  for (const double k : {1e-2, 1.0, 30.0, 4000.0}) {
    INFO("k = " << k);
    Eigen::MatrixXcd B = system.hessian(state).cast<std::complex<double>>();
    B -= std::complex<double>(0, k) * system.K(0).cast<std::complex<double>>();
    const auto roots = finite_roots(system.M(), system.structure().kernel, B);
    REQUIRE(roots.size() == 1);
    const std::complex<double> expected(0, 0.25 * k * k * k - 1.8 * k);
    CHECK(std::abs(roots.front() - expected) < 1e-9 * std::abs(expected));
  }
}

TEST_CASE("a coefficient that is a rounding error adds no root to a pencil") {
  // Camassa-Holm about u_0 as it is derived from the equation: one root, σ = -ik (3u_0 + u_0 k²)/(1 + k²).
  const auto system = make_system({"u", "p", "m", "q", "n"}, {{"u", "p", -0.5}, {"u", "q", 0.5}},
                                  {{{"u", "n", -1}, {"p", "m", -1}}}, "u*m + q*n + 0.5*u^3 + 0.5*u*q^2");
  for (const double u : {0.3, 1.0, 1.02}) {
    for (const double k : {0.15707963267948966, 0.5, 3.0}) {
      INFO("u = " << u << ", k = " << k);
      Eigen::MatrixXcd B = system.hessian(std::vector<double>{u, 0.0, 0.0, 0.0, 0.0}).cast<std::complex<double>>();
      B -= std::complex<double>(0, k) * system.K(0).cast<std::complex<double>>();
      const auto roots = finite_roots(system.M(), system.structure().kernel, B);
      REQUIRE(roots.size() == 1);
      CHECK(std::abs(roots.front()) == Approx(k * u * (3.0 + k * k) / (1.0 + k * k)).epsilon(1e-9));
    }
  }
}

TEST_CASE("a lattice says so") {
  const auto system = make_system({"u", "v", "w"}, {{"u", "v", -1}}, {{{"u", "w", 1}}}, "(v^2 + w^2)/2");
  const grids::Grid grid({{"x", 0, 2 * pi, 33}});
  const auto sine = sampled(grid, [](double x) { return std::sin(x); });
  const LatticeIntegrator lattice(system, grid, {sine, sine, std::nullopt}, {.step = 0.1, .until = 1});
  REQUIRE(lattice.cautions().size() == 1);
  CHECK_THAT(lattice.cautions().front(),
             Catch::Contains("ill-posed") && Catch::Contains("length 0.381 along x") && Catch::Contains("exp(16.5 t)"));
  const LatticeIntegrator sound(sine_gordon(), grid, {sine, sine, std::nullopt}, {.step = 0.1, .until = 1});
  CHECK(sound.cautions().empty());
}
