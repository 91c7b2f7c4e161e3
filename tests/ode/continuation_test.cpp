// Branches of solutions: a fold that is known in closed form, and families of periodic orbits.

#include <catch2/catch.hpp>

#include <cmath>
#include <numbers>

#include <rubato/ode/continuation.hpp>

using namespace rubato;

TEST_CASE("continuation: the fold of Bratu's problem, and the solution beyond it") {
  // q'' = -λ e^q, q(0) = q(1) = 0. With q = -2 ln(cosh((t - 1/2)θ/2)/cosh(θ/4)) and λ = θ²/(2 cosh²(θ/4)) the fold is
  // where (θ/4) tanh(θ/4) = 1: λ = 3.513830719125162. λ is a coordinate whose momentum does not occur.
  const Hamiltonian H({"q", "lambda"}, {"p", "mu"}, "p^2/2 + lambda*exp(q)");
  const std::vector<std::string> at_one = {"q_0 = 0", "q_1 = 0", "mu_0 = 0", "lambda_0 = 1"},
                                 open(at_one.begin(), at_one.end() - 1);
  constexpr std::size_t steps = 40;
  const BoundaryValueOptions newton{.lagrangian = Gauss{4}, .levels = Levels::fixed, .duration = 1.0};
  const NodesOfOrbit guess =
      guess_by_integrating(H, Gauss{4}, std::vector<double>{0.0, 1.0, 0.5, 0.0}, 1.0 / steps, steps);
  const BoundaryValueSolution start = solve_boundary_value(H, {H, at_one}, guess, newton);
  REQUIRE(start.found());
  // To λ = 4 there is no way but round the fold and back, to small λ: so the goal is on the upper branch.
  const Branch up = follow_branch(H, {H, open}, start,
                                  {.newton = newton, .parameter = {.component = 1}, .to = 4.0, .most_points = 60});
  CHECK_FALSE(up.complete());
  const auto fold = std::ranges::find(up.points, true, &BranchPoint::is_fold);
  REQUIRE(fold != up.points.end());
  CHECK(std::abs(fold->parameter - 3.513830719125162) < 1e-10);
  CHECK(fold->solution.residual < 1e-12);
  // Beyond it the parameter falls, and the orbit is another one.
  const BranchPoint& beyond = *(fold + 5);
  CHECK(beyond.parameter < 3.5);
  double theta = 8.0;  // the larger root of λ(θ) = λ
  for (int i = 0; i < 60; ++i) {
    const double c = std::cosh(0.25 * theta), value = theta * theta / (2.0 * c * c);
    theta -= (value - beyond.parameter) / (value * (2.0 / theta - 0.5 * std::tanh(0.25 * theta)));
  }
  CHECK(beyond.solution.orbit.node(steps / 2)[0] == Approx(2.0 * std::log(std::cosh(0.25 * theta))).epsilon(1e-9));
  CHECK(up.points.front().solution.orbit.node(steps / 2)[0] ==
        Approx(0.1405392).epsilon(1e-5));  // twin: below the fold
}

TEST_CASE("continuation: the periods of a pendulum's family, in the energy and in the period") {
  const Hamiltonian H({"q"}, {"p"}, "p^2/2 - cos(q)");
  constexpr std::size_t steps = 60;
  const NodesOfOrbit guess = guess_by_integrating(H, Gauss{5}, std::vector<double>{0.5, 0.0}, 6.4 / steps, steps);
  for (const Levels levels : {Levels::fixed, Levels::variable}) {
    BoundaryValueOptions newton{.lagrangian = Gauss{5}, .levels = levels, .energy = -0.8};
    const BoundaryValueSolution start = solve_boundary_value(H, EndConditions::periodic(H), guess, newton);
    REQUIRE(start.found());
    const Branch family =
        follow_branch(H, EndConditions::periodic(H), start,
                      {.newton = newton, .parameter = {.target = StationaryAction::Parameter::energy}, .to = 0.5});
    REQUIRE(family.complete());
    CHECK(family.points.size() > 3);
    for (const BranchPoint& point : family.points) {
      CHECK_FALSE(point.is_fold);
      const double k = std::sqrt(0.5 * (1.0 + point.parameter));
      CHECK(point.solution.orbit.duration() == Approx(4.0 * std::comp_ellint_1(k)).epsilon(1e-9));
    }
    CHECK(family.points.back().parameter == Approx(0.5).epsilon(1e-12));
    // The other way round: to a period.
    newton.duration = start.orbit.duration();
    newton.energy.reset();
    const Branch longer =
        follow_branch(H, EndConditions::periodic(H), start,
                      {.newton = newton, .parameter = {.target = StationaryAction::Parameter::duration}, .to = 8.0});
    REQUIRE(longer.complete());
    const double k = std::sqrt(0.5 * (1.0 + longer.points.back().solution.mean_energy));
    CHECK(4.0 * std::comp_ellint_1(k) == Approx(8.0).epsilon(1e-9));
  }
  CHECK_THROWS_WITH(
      follow_branch(H, EndConditions::periodic(H), {.orbit = guess}, {.newton = {.lagrangian = Gauss{2}}}),
      Catch::Contains("one parameter"));
}
