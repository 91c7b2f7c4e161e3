// Boundary-value problems: the stationary action against closed forms, an independent solution of Lambert's problem,
// and itself; Newton's matrix against differences; orders by slope.

#include <catch2/catch.hpp>

#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>
#include <Eigen/Geometry>

#include <rubato/ode/boundary_value.hpp>

using namespace rubato;
using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

const Hamiltonian& pendulum() {
  static const Hamiltonian H({"q"}, {"p"}, "p^2/2 - cos(q)");
  return H;
}

/// From a turning point to q = 1/2 with the energy E < 1.
BoundaryValueSolution swing(const SegmentLagrangian& lagrangian, Levels levels, double E, std::size_t steps) {
  const std::vector<std::string> ends = {"p_0 = 0", "q_1 = 0.5"};
  const NodesOfOrbit guess = guess_by_integrating(pendulum(), lagrangian, std::vector<double>{-1.5, 0.01},
                                                  2.2 / static_cast<double>(steps), steps);
  return solve_boundary_value(pendulum(), {pendulum(), ends}, guess,
                              {.lagrangian = lagrangian, .levels = levels, .energy = E});
}

/// Its time, by elliptic integrals: sin(q/2) = k sin(φ), k² = (1 + E)/2, dt = dφ/√(1 - k² sin²φ).
double time_of_swing(double E) {
  const double k = std::sqrt((1.0 + E) / 2.0);
  return std::comp_ellint_1(k) + std::ellint_1(k, std::asin(std::sin(0.25) / k));
}

/// Orders of convergence between iterations: ln r_{k+1} / ln r_k where both are small and above rounding.
std::vector<double> rates(const BoundaryValueSolution& solution, int stage) {
  std::vector<double> found;
  for (std::size_t i = 1; i < solution.history.size(); ++i) {
    const NewtonIteration &before = solution.history[i - 1], &after = solution.history[i];
    if (before.stage == stage && after.stage == stage && before.residual < 0.1 && after.residual > 1e-14) {
      found.push_back(std::log(after.residual) / std::log(before.residual));
    }
  }
  return found;
}

/// The largest ratio of neighbouring steps.
double roughness(const BoundaryValueSolution& solution) {
  double largest = 1.0;
  for (std::size_t k = 1; k < solution.orbit.segments(); ++k) {
    const double ratio = solution.orbit.h[k] / solution.orbit.h[k - 1];
    largest = std::max({largest, ratio, 1.0 / ratio});
  }
  return largest;
}

/// The largest difference between the matrix and central differences, over its entries' size.
double matrix_error(StationaryAction& equations, const VectorXd& u, double fault = 0.0) {
  Eigen::SparseMatrix<double> jacobian;
  VectorXd residual, above, below;
  REQUIRE(equations.evaluate(u, residual, &jacobian) == Status::success);
  if (fault != 0.0) {
    jacobian.coeffRef(0, 0) += fault;
  }
  const Eigen::MatrixXd dense = jacobian;
  double largest = 0.0;
  for (Index j = 0; j < u.size(); ++j) {
    constexpr double width = 1e-5;
    VectorXd moved = u;
    moved[j] += width;
    REQUIRE(equations.evaluate(moved, above, nullptr) == Status::success);
    moved[j] -= 2.0 * width;
    REQUIRE(equations.evaluate(moved, below, nullptr) == Status::success);
    largest = std::max(largest, ((above - below) / (2.0 * width) - dense.col(j)).cwiseAbs().maxCoeff());
  }
  return largest / dense.cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("boundary values: Newton's matrix is the derivative of the equations, for every discretisation and levels") {
  const Hamiltonian H({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2*(1 + 0.1*x^2) + (x^2 + y^2)/2 + x^2*y - y^3/3");
  Eigen::MatrixXd F(4, 4);
  F << 0.3, 0.1, 0.2, 0, 0.1, -0.2, 0, 0.1, 0.2, 0, 0.1, 0, 0, 0.1, 0, 0.4;
  const std::vector<SegmentLagrangian> all = {
      Midpoint{},
      Gauss{2},
      Gauss{3},
      Generating{.order = 4},
      Generating{.order = 3, .darboux = F},
      Forward{},
      Custom{.L = "(x_1 - x_0)*(u_0 + u_1)/2/(t_1 - t_0) + (y_1 - y_0)*v_0/(t_1 - t_0) - u_0^2*(1 + y_1)/2 - v_1^2/2 - "
                  "x_0^2*y_1"}};
  const std::vector<std::string> ends = {"x_0 = 0.1", "y_0 + x_1^2 = 0.2", "u_1*v_0 = 0.1", "y_1 = sin(x_0)"};
  NodesOfOrbit orbit{.dimension = 4, .z = {}, .h = {0.2, 0.25, 0.3, 0.2}};
  for (int i = 0; i < 20; ++i) {
    orbit.z.push_back(0.3 * std::sin(1.7 * i) + 0.1);
  }
  for (const SegmentLagrangian& lagrangian : all) {
    CAPTURE(method_of(lagrangian).name);
    for (const auto levels : {StationaryAction::Levels::prescribed, StationaryAction::Levels::free}) {
      const auto segments = make_segment_equation(H, lagrangian);
      EndConditions conditions(H, ends);
      StationaryAction equations(H, *segments, conditions, {.duration = 1.0, .energy = 0.2}, orbit, levels,
                                 {.strength = 0.3, .length = 0.2, .exponent = 3.0});
      const VectorXd u = equations.pack(orbit);
      // Differences: h²/6 times third derivatives of about 10, and rounding over h.
      constexpr double allowed = 1e-8;
      CHECK(matrix_error(equations, u) < allowed);
      CHECK(matrix_error(equations, u, 1e-3) > allowed);  // twin
    }
  }
}

TEST_CASE("boundary values: a pendulum from a turning point to a place with an energy takes the elliptic integral") {
  constexpr double E = -0.2;
  for (const Levels levels : {Levels::variable, Levels::fixed}) {
    for (const int stages : {1, 2, 3}) {
      CAPTURE(stages);
      std::vector<double> errors;
      for (const std::size_t steps : {10, 20, 40}) {
        const BoundaryValueSolution found = swing(Gauss{stages}, levels, E, steps);
        REQUIRE(found.found());
        errors.push_back(std::abs(found.orbit.duration() - time_of_swing(E)));
        CHECK(std::abs(found.mean_energy - E) < 1e-13);
        for (const double energy : found.energy) {
          // Solved to the tolerance 1e-12 of terms of size 1; Newton ends at rounding.
          CHECK((levels == Levels::fixed || std::abs(energy - found.conserved) < 1e-14));
        }
      }
      for (std::size_t i = 1; i < errors.size() && errors[i] > 1e-13; ++i) {
        CHECK(std::log2(errors[i - 1] / errors[i]) == Approx(2.0 * stages).margin(0.25));
      }
    }
  }
  // Six stages, order 12: rounding is left. Twin: another energy takes another time.
  const BoundaryValueSolution found = swing(Gauss{6}, Levels::variable, E, 40);
  CHECK(std::abs(found.orbit.duration() - time_of_swing(E)) < 2e-14);
  CHECK(std::abs(found.orbit.duration() - time_of_swing(E + 1e-8)) > 1e-10);
}

TEST_CASE("boundary values: Newton's method converges quadratically") {
  const BoundaryValueSolution found = swing(Gauss{2}, Levels::variable, -0.2, 40);
  for (const int stage : {0, 2}) {
    const std::vector<double> orders = rates(found, stage);
    for (const double order : orders) {
      CHECK(order > 1.8);
    }
    CHECK((stage == 2 || orders.size() >= 2));
  }
}

TEST_CASE(
    "boundary values: the pure law of a pendulum that swings, and a step potential where Gamma changes its sign") {
  // Γ keeps its sign for |E| < 1 (theory, section 3): no potential, and h³Γ nearly constant.
  const BoundaryValueSolution swings = swing(Midpoint{}, Levels::variable, -0.2, 40);
  REQUIRE(swings.found());
  CHECK_FALSE(swings.potential.active());
  HamiltonianEvaluator evaluator(pendulum());
  double least = 1e9, most = 0.0;
  for (std::size_t k = 0; k < swings.orbit.segments(); ++k) {
    const double middle[] = {0.5 * (swings.orbit.node(k)[0] + swings.orbit.node(k + 1)[0]),
                             0.5 * (swings.orbit.node(k)[1] + swings.orbit.node(k + 1)[1])};
    double energy = 0.0;
    const double law = std::pow(swings.orbit.h[k], 3) * evaluator.gamma(middle, energy);
    least = std::min(least, law);
    most = std::max(most, law);
  }
  CHECK(most / least - 1.0 < 5e-3);  // O(h²): 1.5e-3 at h = 0.1 (theory, section 3), and nodes of both ends
  CHECK(std::abs(std::pow(swings.orbit.h[20] / swings.orbit.h[0], 3) - 1.0) >
        0.2);  // twin: of equal steps it would not be

  // It turns over: Γ changes its sign. One turn, at a given energy.
  const std::vector<std::string> ends = {"q_0 = 0", "q_1 = 2*pi"};
  const NodesOfOrbit guess = guess_by_integrating(pendulum(), Midpoint{}, std::vector<double>{0.0, 2.3}, 0.05, 80);
  const BoundaryValueSolution turns =
      solve_boundary_value(pendulum(), {pendulum(), ends}, guess, {.lagrangian = Midpoint{}, .energy = 1.5});
  REQUIRE(turns.found());
  CHECK(turns.potential.active());
  for (const double energy : turns.energy) {
    CHECK(std::abs(energy - turns.conserved) < 1e-13);
  }
  const double k = std::sqrt(2.0 / 2.5);
  CHECK(turns.orbit.duration() == Approx(2.0 * k * std::comp_ellint_1(k)).epsilon(5e-3));  // O(h²) at h = 0.05

  // Without a potential no smooth levels exist: there is no solution, or one whose steps jump where Γ vanishes.
  const BoundaryValueSolution none = solve_boundary_value(
      pendulum(), {pendulum(), ends}, guess,
      {.lagrangian = Midpoint{}, .potential = {.kind = StepPotentialChoice::Kind::none}, .energy = 1.5});
  CHECK(roughness(turns) < 1.2);
  CHECK((!none.found() || roughness(none) > 1.5));
}

namespace {

using Vector3 = Eigen::Vector3d;

/// Lambert's problem by Lagrange's equation in the form of Izzo (Celestial Mechanics and Dynamical Astronomy 121,
/// 2015), with bisection: the velocities at r_1 of all elliptic orbits with `revolutions` full ones.
std::vector<Vector3> lambert(const Vector3& r_1, const Vector3& r_2, double time, double mu, int revolutions) {
  const double c = (r_2 - r_1).norm(), a = r_1.norm(), b = r_2.norm(), s = (a + b + c) / 2.0;
  const Vector3 radial_1 = r_1 / a, normal = r_1.cross(r_2).normalized();
  double lambda = std::sqrt(1.0 - c / s);
  Vector3 across_1 = normal.cross(radial_1);
  if (normal[2] < 0.0) {
    lambda = -lambda;
    across_1 = -across_1;
  }
  const double T = std::sqrt(2.0 * mu / (s * s * s)) * time;
  const auto time_at = [&](double x) {
    const double y = std::sqrt(1.0 - lambda * lambda * (1.0 - x * x));
    const double angle = std::acos(x * y + lambda * (1.0 - x * x)) + revolutions * std::numbers::pi;
    return (angle / std::sqrt(1.0 - x * x) - x + lambda * y) / (1.0 - x * x);
  };
  // The minimum over x for full revolutions, by golden section; without them T falls from infinity to the parabola.
  double left = -0.999, right = 0.999, least = right;
  if (revolutions > 0) {
    double from = left, to = right;
    for (int i = 0; i < 200; ++i) {
      const double first = from + 0.382 * (to - from), second = from + 0.618 * (to - from);
      (time_at(first) < time_at(second) ? to : from) = time_at(first) < time_at(second) ? second : first;
    }
    least = 0.5 * (from + to);
  }
  std::vector<Vector3> found;
  for (const bool falls : {true, false}) {
    double from = falls ? left : least, to = falls ? least : right;
    if ((time_at(from) - T) * (time_at(to) - T) > 0.0 || from == to) {
      continue;
    }
    for (int i = 0; i < 200; ++i) {
      const double x = 0.5 * (from + to);
      ((time_at(x) > T) == falls ? from : to) = x;
    }
    const double x = 0.5 * (from + to), y = std::sqrt(1.0 - lambda * lambda * (1.0 - x * x));
    const double g = std::sqrt(mu * s / 2.0), rho = (a - b) / c, sigma = std::sqrt(1.0 - rho * rho);
    const double v_r = g * ((lambda * y - x) - rho * (lambda * y + x)) / a, v_t = g * sigma * (y + lambda * x) / a;
    found.push_back(v_r * radial_1 + v_t * across_1);
  }
  return found;
}

}  // namespace

TEST_CASE("boundary values: Lambert's problem, with all revolutions") {
  const double mu = 398600.0;  // km³/s²; Curtis, Orbital Mechanics for Engineering Students, example 5.2
  const Vector3 r_1(5000.0, 10000.0, 2100.0), r_2(-14600.0, 2500.0, 7000.0);
  const Hamiltonian H({"x", "y", "z"}, {"u", "v", "w"}, "(u^2 + v^2 + w^2)/2 - mu/norm(x, y, z)", {{"mu", mu}});
  std::vector<std::string> ends;
  for (int i = 0; i < 3; ++i) {
    ends.push_back(std::string(1, "xyz"[i]) + "_0 = " + std::to_string(r_1[i]));
    ends.push_back(std::string(1, "xyz"[i]) + "_1 = " + std::to_string(r_2[i]));
  }
  const auto solve_near = [&](const Vector3& v, double time, std::size_t steps) {
    // The guess is off by a thousandth in the velocity.
    const std::vector<double> z = {r_1[0], r_1[1], r_1[2], 1.001 * v[0], 1.001 * v[1], 0.999 * v[2]};
    const NodesOfOrbit guess = guess_by_integrating(H, Gauss{6}, z, time / static_cast<double>(steps), steps);
    return solve_boundary_value(H, {H, ends}, guess,
                                {.lagrangian = Gauss{6}, .levels = Levels::fixed, .duration = time});
  };
  const auto velocity = [](const BoundaryValueSolution& found) {
    return Vector3(found.orbit.node(0)[3], found.orbit.node(0)[4], found.orbit.node(0)[5]);
  };
  // The printed answer has six figures.
  const Vector3 printed(-5.99249, 1.92536, 3.24564);
  const BoundaryValueSolution hour = solve_near(printed, 3600.0, 60);
  REQUIRE(hour.found());
  CHECK((velocity(hour) - printed).norm() < 2e-5);
  CHECK((lambert(r_1, r_2, 3600.0, mu, 0).front() - velocity(hour)).norm() < 1e-11);

  // In twelve hours there is one orbit without a full revolution, and two for each number of them that has any.
  const double time = 12.0 * 3600.0;
  int found_orbits = 0, revolutions = 0;
  for (;; ++revolutions) {
    const std::vector<Vector3> velocities = lambert(r_1, r_2, time, mu, revolutions);
    if (velocities.empty()) {
      break;
    }
    CHECK(velocities.size() == (revolutions == 0 ? 1 : 2));
    for (const Vector3& v : velocities) {
      CAPTURE(revolutions, v.norm());
      const BoundaryValueSolution found = solve_near(v, time, 1000);
      CAPTURE(found.message, found.history.size());
      REQUIRE(found.found());
      // Order 12 with a hundred steps a revolution and more: rounding, grown by the length of the orbit.
      CHECK((velocity(found) - v).norm() < 1e-8 * v.norm());
      CHECK((velocity(found) - v).norm() <
            1e-3 * (velocity(found) - velocities[v == velocities[0] ? velocities.size() - 1 : 0]).norm() +
                (velocities.size() == 1 ? 1.0 : 0.0));
      ++found_orbits;
    }
  }
  CHECK(revolutions == 3);
  CHECK(found_orbits == 2 * revolutions - 1);
}

TEST_CASE("boundary values: forward with all of z at both ends is stable, and of order 2") {
  // As an initial-value problem rounding errors are multiplied by 16/h² in every step (theory, section 2.2).
  const Hamiltonian H({"q"}, {"p"}, "p^2/2 + q^2/2 + q^4/10");
  std::vector<double> q_errors, p_errors;
  for (const std::size_t steps : {40, 80, 160}) {
    const double h = 4.0 / static_cast<double>(steps);
    // Half a step at a time: the momentum of forward belongs half a step later.
    const NodesOfOrbit exact = guess_by_integrating(H, Gauss{4}, std::vector<double>{0.0, 1.0}, 0.5 * h, 2 * steps);
    NodesOfOrbit guess{.dimension = 2, .z = {}, .h = std::vector<double>(steps, h)};
    for (std::size_t k = 0; k <= steps; ++k) {
      guess.z.insert(guess.z.end(), exact.node(2 * k).begin(), exact.node(2 * k).end());
    }
    const std::span<const double> end = exact.node(2 * steps);
    const std::vector<std::string> ends = {"q_0 = 0", "p_0 = 1", fmt::format("q_1 = {:.17g}", end[0]),
                                           fmt::format("p_1 = {:.17g}", end[1])};
    const BoundaryValueSolution found =
        solve_boundary_value(H, {H, ends}, guess, {.lagrangian = Forward{}, .levels = Levels::fixed, .duration = 4.0});
    REQUIRE(found.found());
    double q_error = 0.0, p_error = 0.0;
    for (std::size_t k = 1; k < steps; ++k) {
      q_error = std::max(q_error, std::abs(found.orbit.node(k)[0] - exact.node(2 * k)[0]));
      p_error = std::max(p_error, std::abs(found.orbit.node(k)[1] - exact.node(2 * k + 1)[1]));
    }
    q_errors.push_back(q_error);
    p_errors.push_back(p_error);
  }
  for (std::size_t i = 0; i < 2; ++i) {
    CAPTURE(q_errors, p_errors);
    CHECK(std::log2(q_errors[i] / q_errors[i + 1]) == Approx(2.0).margin(0.1));
    CHECK(std::log2(p_errors[i] / p_errors[i + 1]) == Approx(2.0).margin(0.1));
  }
}

namespace {

/// Stationary nodes of the forward action of p²/2 + q²/2, with q given at both ends, and p there or its natural
/// condition ∂𝕊/∂p = 0. The action is quadratic, so that one correction from 0 solves for them.
NodesOfOrbit stationary_forward(std::size_t steps, double h, bool natural) {
  const Hamiltonian H({"q"}, {"p"}, "p^2/2 + q^2/2");
  const auto segment = make_segment_equation(H, Forward{});
  SegmentRows rows;
  const std::vector<double> zero(2, 0.0);
  REQUIRE(segment->evaluate(zero, zero, h, rows) == Status::success);
  const auto size = static_cast<Index>(2 * (steps + 1));
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size, size);
  for (Index k = 0; k < static_cast<Index>(steps); ++k) {
    matrix.block(2 * k, 2 * k, 4, 2) += rows.by_0;
    matrix.block(2 * k, 2 * k + 2, 4, 2) += rows.by_1;
  }
  VectorXd right = VectorXd::Zero(size);
  const double end = h * static_cast<double>(steps);
  const auto give = [&](Index place, double value) {
    matrix.row(place).setZero();
    matrix(place, place) = 1.0;
    right[place] = value;
  };
  give(0, 0.0);
  give(size - 2, std::sin(end));
  if (!natural) {
    give(1, std::cos(0.5 * h));
    give(size - 1, std::cos(end + 0.5 * h));
  }
  const VectorXd z = matrix.fullPivLu().solve(right);
  return {.dimension = 2, .z = {z.data(), z.data() + size}, .h = std::vector<double>(steps, h)};
}

}  // namespace

TEST_CASE("boundary values: the natural end condition of forward makes a boundary layer, and whole ends do not") {
  // ∂A/∂p_1 = -(h/2)p̄ lets p change its sign in the last step: a layer of one node there, since the parasite falls by
  // (h/4)² from node to node (theory, section 2.2).
  constexpr double end = 4.0;
  std::vector<double> whole, inside, at_end;
  for (const std::size_t steps : {20, 40, 80}) {
    const double h = end / static_cast<double>(steps);
    const auto error = [&](const NodesOfOrbit& orbit, std::size_t k) {
      return std::abs(orbit.node(k)[1] - std::cos(h * (static_cast<double>(k) + 0.5)));
    };
    const NodesOfOrbit given = stationary_forward(steps, h, false), natural = stationary_forward(steps, h, true);
    whole.push_back(0.0);
    inside.push_back(0.0);
    for (std::size_t k = 0; k < steps; ++k) {
      whole.back() = std::max(whole.back(), error(given, k));
      inside.back() = std::max(inside.back(), error(natural, k));
    }
    at_end.push_back(error(natural, steps));
    CHECK(natural.node(steps)[1] == Approx(-natural.node(steps - 1)[1]).epsilon(1e-10));
  }
  CAPTURE(whole, inside, at_end);
  for (std::size_t i = 0; i < 2; ++i) {
    CHECK(std::log2(whole[i] / whole[i + 1]) == Approx(2.0).margin(0.3));
    CHECK(std::log2(inside[i] / inside[i + 1]) > 0.9);  // the layer costs an order inside
    CHECK(std::log2(inside[i] / inside[i + 1]) < 1.7);
  }
  CHECK(at_end.back() == Approx(2.0 * std::abs(std::cos(end))).epsilon(0.1));  // twin: it does not fall
}

TEST_CASE("boundary values: what is wrong with a problem is said") {
  const std::vector<std::string> two = {"q_0 = 1 = 2"};
  CHECK_THROWS_WITH(EndConditions(pendulum(), two), Catch::Contains("one ="));
  const std::vector<std::string> unknown = {"r_0 = 1"};
  CHECK_THROWS_WITH(EndConditions(pendulum(), unknown), Catch::Contains("r_0"));
  CHECK_THROWS_WITH(EndConditions(pendulum(), std::vector<std::string>{}), Catch::Contains("no end conditions"));
  const double rest[] = {std::numbers::pi, 0.0}, bottom[] = {0.0, 0.0}, nowhere[] = {1.0, 0.0};
  CHECK_THROWS_WITH(EndConditions::connection(pendulum(), bottom, rest), Catch::Contains("imaginary axis"));
  CHECK_THROWS_WITH(EndConditions::connection(pendulum(), nowhere, rest), Catch::Contains("no equilibrium"));
  CHECK_THROWS_WITH(make_segment_equation(pendulum(), Splitting{}), Catch::Contains("splitting"));
  CHECK_THROWS_WITH(make_segment_equation(pendulum(), Custom{.L = "t_0*q_0 - p_1"}), Catch::Contains("t_1 - t_0"));
  const std::vector<std::string> ends = {"q_0 = 0", "q_1 = 1"};
  CHECK_THROWS_WITH(solve_boundary_value(pendulum(), {pendulum(), ends}, {.dimension = 2, .z = {0, 1}, .h = {}}, {}),
                    Catch::Contains("at least one step"));
  CHECK_THROWS_WITH(solve_boundary_value(pendulum(), {pendulum(), ends},
                                         {.dimension = 2, .z = {0, 1, 1, 1, 2, 1}, .h = {0.1, -0.1}}, {}),
                    Catch::Contains("all go"));
  // No pendulum comes from 0 to 1 with less energy than it has there: the equation that cannot be met is named.
  const NodesOfOrbit guess = guess_by_integrating(pendulum(), Gauss{2}, std::vector<double>{0.0, 0.5}, 0.1, 10);
  const BoundaryValueSolution none =
      solve_boundary_value(pendulum(), {pendulum(), ends}, guess, {.lagrangian = Gauss{2}, .energy = -0.9});
  CHECK_FALSE(none.found());
  CHECK_THAT(none.message, Catch::Contains("the largest in"));
}

TEST_CASE("boundary values: a connection between equilibria of a pendulum is the separatrix") {
  // q = 4 atan(e^t) - π: p = 2 sech t.
  const double from[] = {-std::numbers::pi, 0.0}, to[] = {std::numbers::pi, 0.0};
  constexpr std::size_t steps = 200;
  constexpr double T = 24.0, h = T / steps;
  NodesOfOrbit guess{.dimension = 2, .z = {}, .h = std::vector<double>(steps, h)};
  for (std::size_t k = 0; k <= steps; ++k) {
    const double t = h * static_cast<double>(k) - 0.5 * T;
    guess.z.push_back(std::numbers::pi * std::tanh(t));
    guess.z.push_back(2.2 / std::cosh(0.8 * t));
  }
  const BoundaryValueSolution found =
      solve_boundary_value(pendulum(), EndConditions::connection(pendulum(), from, to), guess,
                           {.lagrangian = Gauss{4}, .levels = Levels::fixed, .duration = T});
  REQUIRE(found.found());
  double largest = 0.0, twin = 0.0;
  for (std::size_t k = 0; k <= steps; ++k) {
    const double q = found.orbit.node(k)[0], p = found.orbit.node(k)[1];
    largest = std::max(largest, std::abs(p - 2.0 * std::cos(0.5 * q)));
    twin = std::max(twin, std::abs(guess.z[2 * k + 1] - 2.0 * std::cos(0.5 * guess.z[2 * k])));
  }
  // The projected ends leave e^(-3T/2), order 8 leaves h⁸: both below 1e-9.
  CHECK(largest < 1e-9);
  CHECK(twin > 1e-2);
}
