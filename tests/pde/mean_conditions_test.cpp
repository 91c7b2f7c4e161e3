// Equations in u_xt and their like, whose mean along x holds no derivative by t: data have to agree with it.

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <catch2/catch.hpp>

#include <rubato/pde/field_system.hpp>
#include <rubato/pde/initial_level.hpp>
#include <rubato/pde/kernel_conditions.hpp>
#include <rubato/pde/mean_conditions.hpp>

#include "equations.hpp"

using namespace rubato;
using namespace rubato::tests;

namespace {

constexpr double k = 2.0 * std::numbers::pi / 20.0;

using InPlane = std::function<double(double, double)>;

/// What the first level of u says, or nothing; by both collocations, which have to agree.
std::string refusal(const MultisymplecticSystem& system, const grids::Grid& grid, const InPlane& u) {
  InitialFields given(system.fields().size());
  std::vector<double>& values = given[static_cast<std::size_t>(system.field("u"))].emplace(grid.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto place = grid.place(i);
    values[i] = u(grid.axis(0).node(place[0]), grid.dimensions() > 1 ? grid.axis(1).node(place[1]) : 0.0);
  }
  std::string first;
  for (const Collocation collocation : {Collocation::cells, Collocation::nodes}) {
    std::string said;
    try {
      static_cast<void>(prepare_initial_level(system, grid, given, collocation));
    } catch (const std::invalid_argument& error) {
      said = error.what();
    }
    INFO("cells: " << first << "; nodes: " << said);
    CHECK((collocation == Collocation::cells || said.empty() == first.empty()));
    first = said;
  }
  return first;
}
std::string refusal(const std::string& equation, const InPlane& u, int dimensions = 1) {
  const grids::Grid line({{"x", 0, 20, 63}}), plane({{"x", 0, 20, 15}, {"y", 0, 20, 13}});
  return refusal(equation_system({"u"}, {equation}, {}, dimensions), dimensions == 1 ? line : plane, u);
}

}  // namespace

TEST_CASE("the mean of S'(u) along x vanishes where u_xt is all that moves") {
  const auto odd = [](double x, double) { return std::sin(k * x); };
  // <sin(a + sin(kx))> = sin(a) J_0(1).
  const auto shifted = [](double a) { return [a](double x, double) { return a + std::sin(k * x); }; };
  CHECK(refusal("u_xt = sin(u)", odd).empty());
  CHECK(refusal("u_xt = sin(u)", shifted(2.0 * std::numbers::pi)).empty());
  CHECK(refusal("u_xt = sin(u)", shifted(5e-4)).empty());  // as tails that are cut off
  const std::string said = refusal("u_xt = sin(u)", shifted(1.0));
  CHECK_THAT(said, Catch::Contains("the mean along x of dS/du has to be 0") &&
                       Catch::Contains(fmt::format("{:.3g}", std::sin(1.0) * std::cyl_bessel_j(0.0, 1.0))) &&
                       Catch::Contains("Change the initial u"));
  CHECK_THAT(refusal("u_xt = 1 + u^2", odd), Catch::Contains("has to be 0"));
  CHECK(refusal("u_xt = 0", shifted(1.0)).empty());
  CHECK_THAT(refusal("u_xt = 0.1 + 0*u", odd), Catch::Contains("as of any: the equation has no periodic solution"));
  // Beside a second derivative by t the mean moves.
  CHECK(refusal("u_tt + u_xt = u_xx - sin(u)", shifted(1.0)).find("has to be 0") == std::string::npos);
}

TEST_CASE("a potential that the equation holds itself does not grow along x") {
  const std::string ostrovsky = "u_xt + u_x^2 + u*u_xx + u_xxxx = u", kdv = "u_t + u*u_x + u_xxx = 0";
  const auto cosine = [](double mean) { return [mean](double x, double) { return mean + std::cos(k * x); }; };
  CHECK(refusal(ostrovsky, cosine(0.0)).empty());
  CHECK(refusal(ostrovsky, cosine(1e-4)).empty());
  CHECK_THAT(refusal(ostrovsky, cosine(0.5)),
             Catch::Contains("the mean of the initial u along x is 0.5") && Catch::Contains("subtract the mean"));
  CHECK(refusal(kdv, cosine(0.5)).empty());
}

TEST_CASE("the mean along x is the same for every y where derivatives by y see the potential") {
  const std::string kp = "u_xt + 6*u_x^2 + 6*u*u_xx + u_xxxx + 3*u_yy = 0", zk = "u_t + u*u_x + u_xxx + u_xyy = 0",
                    wave = "u_xt = u_yy";
  const auto wavy = [](double mean, double size) {
    return [=](double x, double y) { return mean + 0.2 * std::cos(k * (x + y)) + size * std::cos(k * y); };
  };
  CHECK(refusal(kp, wavy(0.3, 0.0), 2).empty());
  CHECK(refusal(
            kp, [](double, double) { return 0.4; }, 2)
            .empty());
  CHECK_THAT(refusal(kp, wavy(0.3, 0.1), 2),
             Catch::Contains("along x varies with y, by -0.197 at y = ") && Catch::Contains("potential_u"));
  CHECK(refusal(zk, wavy(0.3, 0.1), 2).empty());
  CHECK(refusal(wave, wavy(0.3, 0.0), 2).empty());
  // 0.1 (cos(ky) - 1), at the node next to 10.
  CHECK_THAT(refusal(wave, wavy(0.3, 0.1), 2), Catch::Contains("less the derivatives across x") &&
                                                   Catch::Contains(fmt::format("{:.3g} at y = ", 0.1 * k * k)));
}

TEST_CASE("equations whose means move, or say nothing, have no conditions on them") {
  const auto has_any = [](const MultisymplecticSystem& system) {
    std::vector<bool> given(system.fields().size());
    given[0] = true;
    return MeanConditions(system).any(given);
  };
  const auto of = [](const std::string& equation, int dimensions = 1) {
    return equation_system({"u"}, {equation}, {}, dimensions);
  };
  CHECK_FALSE(has_any(sine_gordon()));
  CHECK_FALSE(has_any(of("u_t + u*u_x + u_xxx = 0")));
  CHECK_FALSE(has_any(of("u_t + u*u_x + u_xxx + u_xyy = 0", 2)));
  CHECK_FALSE(has_any(of("u_tt = u_xx + 2*u*u_xx + 2*u_x^2 - u_xxxx")));
  CHECK(has_any(of("u_xt = sin(u)")));
  CHECK(has_any(of("u_xt + u_x^2 + u*u_xx + u_xxxx = u")));
  CHECK(has_any(of("u_xt + 6*u_x^2 + 6*u*u_xx + u_xxxx + 3*u_yy = 0", 2)));
}

TEST_CASE("a kernel that varies with z is held by as many means as it has vectors") {
  // The potential form of Korteweg and de Vries, with S = … + φ f(t). Of θM - S'' the row of t is θ de - f' dφ - f'' φ
  // dt and that of e is -θ dt: with dφ, and its dw = θ/2 dφ, there goes de = f'/θ dφ, at every z.
  const auto system = [](const std::string& S) {
    return make_system({"phi", "u", "v", "w", "t", "e"}, {{"phi", "u", 0.5}, {"t", "e", -1}},
                       {{{"phi", "w", 1}, {"u", "v", -1}}}, "e + v^2/2 - u*w + u^3 + " + S);
  };
  constexpr double h = 0.1;
  Eigen::MatrixXd L = Eigen::MatrixXd::Zero(6, 6);  // S'' at φ = u = t = 0
  L(1, 3) = L(3, 1) = -1.0;
  L(2, 2) = 1.0;
  const MultisymplecticSystem driven = system("phi*t^2");
  CHECK(step_conditions(driven, h).count() == 0);
  const KernelConditions conditions = wave_conditions(driven, L, h);
  REQUIRE(conditions.count() == 1);
  Eigen::RowVectorXd of_phi = Eigen::RowVectorXd::Zero(6);
  of_phi[0] = 1.0;
  CHECK(conditions.pins.row(0) == of_phi);
  CHECK(((2.0 / h * driven.M() - L) * conditions.kernel).norm() < 1e-13);
  // The twin: S'' that is singular at φ = t = 0 alone.
  CHECK(wave_conditions(system("phi^2*(1 + t^2)*t^2"), L, h).count() == 0);
}
