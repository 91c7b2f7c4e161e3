// Boundary-value problems with constraints: Newton's matrix against differences, a pendulum against its elliptic
// integral, and a conical pendulum against its closed form.

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

#include <rubato/ode/boundary_value.hpp>
#include <rubato/ode/second_variation.hpp>

using namespace rubato;

namespace {

using Eigen::Index;
using Eigen::VectorXd;

/// A mass on a rod in the plane, from where it is lowest on by its angle.
Hamiltonian rod_in_plane() {
  const std::vector<std::string> q = {"x", "y"};
  return Hamiltonian(q, {"u", "v"}, "(u^2 + v^2)/2 + y").constrained(Constraints(q, {{"rod", "x^2 + y^2 - 1"}}));
}
Hamiltonian rod_in_space() {
  const std::vector<std::string> q = {"x", "y", "z"};
  return Hamiltonian(q, {"u", "v", "w"}, "(u^2 + v^2 + w^2)/2 + z")
      .constrained(Constraints(q, {{"rod", "x^2 + y^2 + z^2 - 1"}}));
}

/// From rest to the angle 1/2 with the energy E.
BoundaryValueSolution swing_of_rod(const SegmentLagrangian& lagrangian, Levels levels, double E, std::size_t steps) {
  const Hamiltonian H = rod_in_plane();
  const std::vector<std::string> ends = {"u_0 = 0", "v_0 = 0", "x_1 = sin(1/2)"};
  const NodesOfOrbit guess =
      guess_by_integrating(H, lagrangian, std::vector<double>{-std::sin(1.5), -std::cos(1.5), 0.0, 0.0},
                           2.2 / static_cast<double>(steps), steps);
  return solve_boundary_value(H, {H, ends}, guess, {.lagrangian = lagrangian, .levels = levels, .energy = E});
}
/// By elliptic integrals, as for the pendulum in its angle.
double time_of_rod(double E) {
  const double k = std::sqrt((1.0 + E) / 2.0);
  return std::comp_ellint_1(k) + std::ellint_1(k, std::asin(std::sin(0.25) / k));
}

double largest_off_rod(const NodesOfOrbit& orbit) {
  const std::size_t n = orbit.dimension / 2;
  double largest = 0.0;
  for (std::size_t k = 0; k <= orbit.segments(); ++k) {
    double length = -1.0, rate = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      length += orbit.node(k)[i] * orbit.node(k)[i];
      rate += 2.0 * orbit.node(k)[i] * orbit.node(k)[n + i];
    }
    largest = std::max({largest, std::abs(length), std::abs(rate)});
  }
  return largest;
}

}  // namespace

TEST_CASE("constrained ends: Newton's matrix is the derivative of the equations") {
  const std::vector<std::string> q = {"x", "y", "z"};
  const Hamiltonian H = Hamiltonian(q, {"a", "b", "c"}, "(a^2 + b^2 + 2*c^2)/2 + a^4/8 + z + x*y/3")
                            .constrained(Constraints(q, {{"rod", "x^2 + y^2 + z^2 + x*y*z/5 - 1"}}));
  const std::vector<std::string> ends = {"x_0 = 0.1", "y_0 + x_1^2 = 0.2", "a_1*b_0 = 0.1", "y_1 = sin(x_0)"};
  // Beside the constraint, as iterates may be.
  NodesOfOrbit orbit{.dimension = 6, .z = {}, .h = {0.2, 0.25, 0.3}};
  for (int k = 0; k < 4; ++k) {
    for (const double value : {0.5 - 0.1 * k, 0.3 + 0.15 * k, 0.8, 0.2 + 0.1 * k, -0.4, 0.3}) {
      orbit.z.push_back(value);
    }
  }
  for (const SegmentLagrangian& lagrangian :
       {SegmentLagrangian(Splitting{"verlet"}), SegmentLagrangian(Splitting{"suzuki-4"}),
        SegmentLagrangian(Midpoint{})}) {
    CAPTURE(method_of(lagrangian).name);
    for (const auto levels : {StationaryAction::Levels::prescribed, StationaryAction::Levels::free}) {
      const auto segments = make_segment_equation(H, lagrangian);
      StationaryAction equations(H, *segments, EndConditions(H, ends), {.duration = 1.0, .energy = 0.2}, orbit, levels,
                                 {.strength = 0.3, .length = 0.2, .exponent = 3.0});
      const VectorXd u = equations.pack(orbit);
      Eigen::SparseMatrix<double> jacobian;
      VectorXd residual, above, below;
      REQUIRE(equations.evaluate(u, residual, &jacobian) == Status::success);
      const auto largest_error = [&](double fault) {
        Eigen::MatrixXd dense = jacobian;
        dense(0, 0) += fault;
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
      };
      // Differences: width²/6 times third derivatives of about 10, and rounding over the width.
      CHECK(largest_error(0.0) < 1e-8);
      CHECK(largest_error(1e-3) > 1e-8);  // the twin
    }
  }
}

TEST_CASE("constrained ends: a rod from rest to a place with an energy takes the time of the pendulum in its angle") {
  constexpr double E = -0.2;
  struct Kind {
    SegmentLagrangian lagrangian;
    double order, largest;  ///< what the last error is less than
  };
  for (const Levels levels : {Levels::fixed, Levels::variable}) {
    for (const auto& [lagrangian, order, largest] : {Kind{Splitting{"verlet"}, 2.0, 1e-3}, Kind{Midpoint{}, 2.0, 1e-3},
                                                     Kind{Splitting{"kahan-li-6"}, 6.0, 1e-9}}) {
      CAPTURE(order, method_of(lagrangian).name);
      std::vector<double> errors;
      for (const std::size_t steps : {20, 40, 80}) {
        const BoundaryValueSolution found = swing_of_rod(lagrangian, levels, E, steps);
        CAPTURE(found.message, found.worst);
        REQUIRE(found.found());
        CHECK(found.residual < 1e-12);
        CHECK(std::abs(found.mean_energy - E) < 1e-13);
        CHECK(largest_off_rod(found.orbit) < 1e-12);
        errors.push_back(std::abs(found.orbit.duration() - time_of_rod(E)));
      }
      CHECK(errors.back() < largest);
      CHECK(std::abs(std::log2(errors.front() / errors.back()) / 2.0 - order) < 0.5);
    }
  }
  // The twin: another energy.
  CHECK(std::abs(swing_of_rod(Splitting{"kahan-li-6"}, Levels::fixed, E + 1e-5, 40).orbit.duration() - time_of_rod(E)) >
        1e-7);
}

TEST_CASE("constrained ends: a conical pendulum as a periodic orbit, with its multipliers") {
  // At the angle a from below it turns with w² = 1/cos a, and about it nutates with w √(1 + 3 cos² a).
  constexpr double a = 0.7;
  const double w = 1.0 / std::sqrt(std::cos(a)), period = 2.0 * std::numbers::pi / w;
  const Hamiltonian H = rod_in_space();
  const SegmentLagrangian lagrangian = Splitting{"kahan-li-8"};
  constexpr std::size_t steps = 60;
  const std::vector<double> near = {std::sin(a + 0.05), 0.0, -std::cos(a + 0.05), 0.0, w * std::sin(a), 0.0};
  const NodesOfOrbit guess = guess_by_integrating(H, lagrangian, near, period / steps, steps);
  const BoundaryValueSolution found =
      solve_boundary_value(H, EndConditions::periodic(H), guess,
                           {.lagrangian = lagrangian, .levels = Levels::fixed, .duration = period, .tolerance = 1e-13});
  CAPTURE(found.message, found.worst);
  REQUIRE(found.found());
  CHECK(largest_off_rod(found.orbit) < 1e-13);
  for (std::size_t i = 0; i < 6; ++i) {
    CHECK(std::abs(found.orbit.node(steps)[i] - found.orbit.node(0)[i]) < 1e-12);
  }
  // Which is that of the equations to order 8.
  for (std::size_t k = 0; k <= steps; ++k) {
    CHECK(std::abs(found.orbit.node(k)[2] + std::cos(a)) < 1e-9);
  }
  // Quadratic: the logarithms of residuals double, less what the constant of convergence takes.
  bool quadratic = false;
  for (std::size_t i = 1; i < found.history.size(); ++i) {
    const double before = found.history[i - 1].residual, after = found.history[i].residual;
    if (before < 1e-2 && after > 1e-13) {
      CHECK(std::log(after) / std::log(before) > 1.6);
      quadratic = true;
    }
  }
  CHECK(quadratic);
  const auto multipliers = SecondVariation(*make_segment_equation(H, lagrangian), found.orbit).multipliers();
  REQUIRE(multipliers.size() == 6);
  // Two of what leaves the constraints.
  CHECK(std::abs(multipliers[4]) < 1e-10);
  CHECK(std::abs(multipliers[3]) > 0.9);
  const std::complex<double> nutation =
      std::polar(1.0, 2.0 * std::numbers::pi * std::sqrt(1.0 + 3.0 * std::cos(a) * std::cos(a)));
  const auto nearest = [&](std::complex<double> value) {
    double least = 1.0;
    for (std::size_t i = 0; i < 4; ++i) {
      least = std::min(least, std::abs(multipliers[i] - value));
    }
    return least;
  };
  CHECK(nearest(nutation) < 1e-7);
  CHECK(nearest(nutation * std::polar(1.0, 1e-5)) > 1e-6);  // the twin
  CHECK(nearest(1.0) < 1e-6);                               // a multiple one
}
