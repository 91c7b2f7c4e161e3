// Holonomic constraints: the constraints themselves, the energy law, orders, the two-form, and what is refused.

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <catch2/catch.hpp>

#include <rubato/ode/constraints.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/orbit_tangent.hpp>
#include <rubato/ode/tangent.hpp>

using namespace rubato;

namespace {

using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector4d;
using Eigen::VectorXd;

const std::vector<std::string> places = {"x", "y", "u", "v"};
const std::vector<std::pair<std::string, std::string>> rods = {{"first", "x^2 + y^2 - 1"},
                                                               {"second", "(u - x)^2 + (v - y)^2 - 1"}};
constexpr const char* kinetic_of_momenta = "(p_x^2 + p_y^2 + p_u^2 + p_v^2)/2";

/// Two masses on two rods, in Cartesian coordinates.
Hamiltonian double_pendulum() {
  return Hamiltonian(places, {"p_x", "p_y", "p_u", "p_v"}, std::string(kinetic_of_momenta) + " + y + v")
      .constrained(Constraints(places, rods));
}
Lagrangian double_pendulum_by_L() {
  return Lagrangian(places, "(x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2)/2 - y - v").constrained(Constraints(places, rods));
}
/// In its angles with the vertical.
Lagrangian double_pendulum_in_angles() {
  return {{"a", "b"}, "a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b) + 2*cos(a) + cos(b)"};
}

struct Place {
  std::vector<double> q, v;
};
/// Positions and velocities at angles and their rates.
Place cartesian(double a, double b, double a_dot, double b_dot) {
  const double x = std::sin(a), y = -std::cos(a), x_dot = a_dot * std::cos(a), y_dot = a_dot * std::sin(a);
  return {{x, y, x + std::sin(b), y - std::cos(b)},
          {x_dot, y_dot, x_dot + b_dot * std::cos(b), y_dot + b_dot * std::sin(b)}};
}
/// On the constraints to rounding.
const Place start = cartesian(1.0, 0.3, 0.4, -0.2);

IntegrationOptions options_of(const SegmentLagrangian& lagrangian, double step, double until,
                              Levels levels = Levels::fixed) {
  return {.lagrangian = lagrangian, .step = step, .until = until, .levels = levels};
}

/// A scheme, its order, and whether it is of the problem stated by H.
struct Method {
  SegmentLagrangian lagrangian;
  int order = 2;
  bool by_H = false;
};

Orbit orbit_of(const Method& method, double step, double until, Levels levels = Levels::fixed) {
  const IntegrationOptions options = options_of(method.lagrangian, step, until, levels);
  return method.by_H ? integrate(double_pendulum(), InitialState{start.q, start.v, 0.0}, options)
                     : integrate(double_pendulum_by_L(), InitialMotion{start.q, start.v, 0.0}, options);
}

const Method verlet{Splitting{"verlet"}, 2, true};
const std::vector<Method> methods = {verlet,
                                     {Splitting{"suzuki-4"}, 4, true},
                                     {Splitting{"kahan-li-6"}, 6, true},
                                     {Midpoint{}, 2, true},
                                     {Midpoint{}, 2},
                                     {Trapezoid{}, 2},
                                     {Gauss{2}, 4},
                                     {Gauss{3}, 6},
                                     {Lobatto{3}, 4},
                                     {Lobatto{4}, 6}};

/// The largest |g| and |dg/dt| along an orbit with masses 1.
double largest_violation(const Orbit& orbit) {
  double largest = 0.0;
  for (std::size_t k = 0; k < orbit.t.size(); ++k) {
    const auto q = orbit.q_at(k), p = orbit.p_at(k);
    const double du = q[2] - q[0], dv = q[3] - q[1];
    for (const double value : {q[0] * q[0] + q[1] * q[1] - 1.0, du * du + dv * dv - 1.0,
                               2.0 * (q[0] * p[0] + q[1] * p[1]), 2.0 * (du * (p[2] - p[0]) + dv * (p[3] - p[1]))}) {
      largest = std::isnan(value) ? value : std::max(largest, std::abs(value));
    }
  }
  return largest;
}

/// Slope of log(error) at t = 2 over steps 0.1, 0.05, 0.025, by least squares; the double pendulum in angles is the
/// reference.
double slope_of(const Method& method) {
  static const Place reference = [] {
    const Orbit orbit = integrate(double_pendulum_in_angles(), InitialMotion{{1.0, 0.3}, {0.4, -0.2}, 0.0},
                                  options_of(Gauss{6}, 0.05, 2.0));
    const std::size_t n = orbit.q_dot.size();
    const auto q = orbit.q_at(orbit.t.size() - 1);
    return cartesian(q[0], q[1], orbit.q_dot[n - 2], orbit.q_dot[n - 1]);
  }();
  std::vector<double> errors;
  for (const int steps : {20, 40, 80}) {
    const Orbit orbit = orbit_of(method, 2.0 / steps, 2.0);
    const auto q = orbit.q_at(orbit.t.size() - 1), p = orbit.p_at(orbit.t.size() - 1);
    double error = 0.0;
    for (std::size_t i = 0; i < 4; ++i) {
      error = std::max({error, std::abs(q[i] - reference.q[i]), std::abs(p[i] - reference.v[i])});
    }
    errors.push_back(error);
  }
  REQUIRE(errors.back() > 1e-13);  // above rounding
  return std::log2(errors.front() / errors.back()) / 2.0;
}

}  // namespace

TEST_CASE("constraints hold to rounding along 100,000 steps, and energy does not drift") {
  // |g| rounds at a few units of Σ|G q| = 4 here: 1e-14 is twelve of them.
  for (const Method& method : {verlet, Method{Midpoint{}, 2, true}, Method{Midpoint{}, 2}}) {
    const Orbit orbit = orbit_of(method, 0.02, 2000.0);
    REQUIRE(orbit.status == Status::success);
    REQUIRE(orbit.steps() == 100'000);
    CHECK(largest_violation(orbit) < 1e-14);
    // Of a symplectic map of order 2 the energy oscillates in a band of width O(h²); the last tenth is in that of the
    // first.
    const auto band = [&](std::size_t from, std::size_t to) {
      const auto [least, greatest] = std::minmax_element(orbit.node_energy.begin() + static_cast<std::ptrdiff_t>(from),
                                                         orbit.node_energy.begin() + static_cast<std::ptrdiff_t>(to));
      return std::pair(*least, *greatest);
    };
    const auto first = band(0, 10'000), last = band(90'000, 100'000);
    const double width = first.second - first.first;
    CHECK(std::abs(0.5 * (last.first + last.second - first.first - first.second)) < 0.5 * width);
    CHECK(width < 1e-2);
  }
  // The twin: without constraints the masses fall.
  const Orbit falling =
      integrate(Hamiltonian(places, {"p_x", "p_y", "p_u", "p_v"}, std::string(kinetic_of_momenta) + " + y + v"),
                InitialState{start.q, start.v, 0.0}, options_of(Splitting{"verlet"}, 0.02, 1.0));
  CHECK(largest_violation(falling) > 1e-2);
}

TEST_CASE("with variable levels every step with constraints keeps the discrete energy") {
  for (const Method& method : methods) {
    const Orbit orbit = orbit_of(method, 0.05, 20.0, Levels::variable);
    REQUIRE(orbit.status == Status::success);
    CHECK(std::ranges::count(orbit.off_law, 1) == 0);
    CHECK(orbit.discrete_energy_deviation() < 1e-13);
    CHECK(largest_violation(orbit) < 1e-14);
    const auto [least, greatest] = std::ranges::minmax(orbit.h);
    CHECK(greatest > least);
  }
  // The twin: with equal steps it is not constant.
  CHECK(orbit_of(verlet, 0.05, 20.0).discrete_energy_deviation() > 1e-6);
}

TEST_CASE("with constraints schemes have the orders that they have without") {
  for (const Method& method : methods) {
    CAPTURE(method.order, method.lagrangian.index(), method.by_H);
    // At these steps the next term, by h², leaves a tenth or two.
    CHECK(std::abs(slope_of(method) - method.order) < 0.35);
  }
  // The twin: order 2 is not taken for order 4.
  CHECK(slope_of(verlet) < 2.5);
}

TEST_CASE("the step with constraints is symplectic on the tangent bundle of the constraints") {
  // In angles and their momenta, p_a = 2 a_dot + b_dot cos(a-b) and p_b = b_dot + a_dot cos(a-b), through Cartesian
  // coordinates and back.
  const auto step = [](const Method& method, double factor, const Vector4d& from) {
    const double c = std::cos(from[0] - from[1]), determinant = 2.0 - c * c;
    const Place at =
        cartesian(from[0], from[1], (from[2] - c * from[3]) / determinant, (2.0 * from[3] - c * from[2]) / determinant);
    const IntegrationOptions options = options_of(method.lagrangian, 0.1, 0.1);
    const Orbit orbit = method.by_H ? integrate(double_pendulum(), InitialState{at.q, at.v, 0.0}, options)
                                    : integrate(double_pendulum_by_L(), InitialMotion{at.q, at.v, 0.0}, options);
    const auto q = orbit.q_at(1), p = orbit.p_at(1);
    const double a = std::atan2(q[0], -q[1]), b = std::atan2(q[2] - q[0], q[1] - q[3]);
    const double a_dot = factor * (p[0] * std::cos(a) + p[1] * std::sin(a));
    const double b_dot = factor * ((p[2] - p[0]) * std::cos(b) + (p[3] - p[1]) * std::sin(b));
    return Vector4d(a, b, 2.0 * a_dot + b_dot * std::cos(a - b), b_dot + a_dot * std::cos(a - b));
  };
  const auto defect = [&](const Method& method, double factor) {
    const Vector4d z(1.0, 0.3, 0.5, -0.1);
    Matrix4d D, J;
    J << 0, 0, 1, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0, -1, 0, 0;
    for (int i = 0; i < 4; ++i) {
      const double by = 1e-3;
      const auto at = [&](double shift) {
        Vector4d moved = z;
        moved[i] += shift * by;
        return step(method, factor, moved);
      };
      D.col(i) = (8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12.0 * by);
    }
    return (D.transpose() * J * D - J).cwiseAbs().maxCoeff();
  };
  for (const Method& method : methods) {
    CAPTURE(method.order, method.lagrangian.index(), method.by_H);
    // Differences of order 4: (1e-3)⁴/30 of a fifth derivative of order 10, and rounding over 1e-3.
    CHECK(defect(method, 1.0) < 1e-11);
    CHECK(defect(method, 1.0 + 1e-6) > 1e-7);  // the twin
  }
}

namespace {

/// A scheme at the start, and its tangent.
struct Mapped {
  std::unique_ptr<OneStepScheme> scheme;
  std::unique_ptr<OrbitTangent> tangent;
};
Mapped map_of(const Method& method) {
  const auto make = [&]() {
    std::vector<double> z = start.q;
    z.insert(z.end(), start.v.begin(), start.v.end());
    return method.by_H ? make_one_step_scheme(double_pendulum(), method.lagrangian, z)
                       : make_one_step_scheme(double_pendulum_by_L(), method.lagrangian, start.q, start.v);
  };
  return {make(), make_orbit_tangent(make())};
}

VectorXd stepped(OneStepScheme& scheme, const VectorXd& z, double h) {
  scheme.restart({z.data(), static_cast<std::size_t>(z.size())});
  REQUIRE(scheme.advance(h, 0.0) == Status::success);
  scheme.accept();
  return Eigen::Map<const VectorXd>(scheme.state().data(), z.size());
}
MatrixXd carried(OrbitTangent& tangent, const VectorXd& z_0, const VectorXd& z_1, double h, MatrixXd columns) {
  const auto span = [](const VectorXd& z) { return std::span(z.data(), static_cast<std::size_t>(z.size())); };
  REQUIRE(tangent.step(span(z_0), span(z_1), 0.0, h, {columns.data(), static_cast<std::size_t>(columns.size())}) ==
          Status::success);
  return columns;
}

/// (q, p) of masses 1 at angles and rates.
VectorXd chart(const Vector4d& s) {
  const Place at = cartesian(s[0], s[1], s[2], s[3]);
  VectorXd z(8);
  std::ranges::copy(at.v, std::ranges::copy(at.q, z.begin()).out);
  return z;
}
/// Its derivatives, by differences of order 4: (1e-3)⁴/30 of fifth derivatives of order 1, and rounding over 1e-3.
MatrixXd chart_derivatives(const Vector4d& s) {
  MatrixXd result(8, 4);
  for (int i = 0; i < 4; ++i) {
    constexpr double by = 1e-3;
    const auto at = [&](double shift) { return chart(s + shift * by * Vector4d::Unit(i)); };
    result.col(i) = (8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12.0 * by);
  }
  return result;
}

double two_form_change(const MatrixXd& before, const MatrixXd& after) {
  const MatrixXd W = canonical_two_form(4);
  return (after.transpose() * W * after - before.transpose() * W * before).cwiseAbs().maxCoeff();
}

/// The largest |δg| and |δ(dg/dt)| of variations of masses 1.
double largest_off_tangent(const VectorXd& z, const MatrixXd& columns) {
  const auto rates = [](const VectorXd& q, const VectorXd& v) {
    return Eigen::Vector2d(2.0 * (q[0] * v[0] + q[1] * v[1]),
                           2.0 * ((q[2] - q[0]) * (v[2] - v[0]) + (q[3] - q[1]) * (v[3] - v[1])));
  };
  double largest = 0.0;
  for (const auto& column : columns.colwise()) {
    const VectorXd q = column.head(4), p = column.tail(4);
    largest = std::max({largest, rates(z.head(4), q).cwiseAbs().maxCoeff(),
                        (rates(q, z.tail(4)) + rates(z.head(4), p)).cwiseAbs().maxCoeff()});
  }
  return largest;
}

}  // namespace

TEST_CASE("the tangent of a step with constraints is its derivative, on the constraints, and symplectic") {
  const Vector4d at(1.0, 0.3, 0.4, -0.2);
  const VectorXd z = chart(at);
  for (const Method& method : methods) {
    CAPTURE(method.order, method.lagrangian.index(), method.by_H);
    Mapped map = map_of(method);
    for (const double h : {0.1, -0.2}) {
      const VectorXd z_1 = stepped(*map.scheme, z, h);
      MatrixXd differences(8, 4);
      for (int i = 0; i < 4; ++i) {
        constexpr double by = 1e-3;
        const auto to = [&](double shift) {
          return stepped(*map.scheme, chart(at + shift * by * Vector4d::Unit(i)), h);
        };
        differences.col(i) = (8.0 * (to(1) - to(-1)) - (to(2) - to(-2))) / (12.0 * by);
      }
      const MatrixXd along = chart_derivatives(at), T = carried(*map.tangent, z, z_1, h, along);
      CHECK((T - differences).cwiseAbs().maxCoeff() < 1e-10);
      const VectorXd other = stepped(*map.scheme, z, 1.01 * h);  // the twin
      CHECK((carried(*map.tangent, z, other, 1.01 * h, along) - differences).cwiseAbs().maxCoeff() > 1e-4);

      // All directions, projected: sums of some tens of terms of order 1.
      MatrixXd projected(8, 8);
      const MatrixXd all = MatrixXd::Identity(8, 8);
      REQUIRE(map.tangent->lift({z.data(), 8}, {z_1.data(), 8}, 0.0, h, {all.data(), 64}, {projected.data(), 64}) ==
              Status::success);
      CHECK(largest_off_tangent(z, projected) < 1e-14);
      CHECK(largest_off_tangent(z, all) > 0.1);
      MatrixXd again = projected;
      REQUIRE(map.tangent->lift({z.data(), 8}, {z_1.data(), 8}, 0.0, h, {projected.data(), 64}, {again.data(), 64}) ==
              Status::success);
      CHECK((again - projected).cwiseAbs().maxCoeff() < 1e-14);
      MatrixXd after = carried(*map.tangent, z, z_1, h, projected);
      CHECK(largest_off_tangent(z_1, after) < 1e-14);
      CHECK(two_form_change(projected, after) < 2e-14);
      after(1, 3) += 1e-10;  // the twins
      CHECK(largest_off_tangent(z_1, after) > 1e-11);
      CHECK(two_form_change(projected, after) > 1e-11);
    }
  }
}

TEST_CASE("the tangent of the midpoint rule with constraints is that of an H that is not separable") {
  const std::vector<std::string> q = {"x", "y", "z"};
  const Hamiltonian H = Hamiltonian(q, {"a", "b", "c"}, "(a^2 + b^2 + c^2)/2 + z + 0.3*x - 0.7*(x*b - y*a)")
                            .constrained(Constraints(q, {{"rod", "x^2 + y^2 + z^2 - 1"}}));
  const std::vector<double> begin = {0.6, 0.0, -0.8, 0.8, 0.5, 0.6};
  const auto scheme = make_one_step_scheme(H, Midpoint{}, begin);
  const auto tangent = make_orbit_tangent(H, Midpoint{}, false, begin);
  const VectorXd z = Eigen::Map<const VectorXd>(begin.data(), 6), z_1 = stepped(*scheme, z, 0.1);
  const MatrixXd T = carried(*tangent, z, z_1, 0.1, MatrixXd::Identity(6, 6));
  for (int i = 0; i < 6; ++i) {
    // The equations of the step lead to the constraint from beside it, too.
    constexpr double by = 1e-3;
    const auto to = [&](double shift) { return stepped(*scheme, z + shift * by * VectorXd::Unit(6, i), 0.1); };
    CHECK((T.col(i) - (8.0 * (to(1) - to(-1)) - (to(2) - to(-2))) / (12.0 * by)).cwiseAbs().maxCoeff() < 1e-10);
  }
}

TEST_CASE("variations of the double pendulum with constraints are those in its angles") {
  // To t = 3, by schemes of order 8 and 12: what is left is of order h⁸.
  constexpr double h = 0.02;
  constexpr int steps = 150;
  const std::vector<double> angles = {1.0, 0.3}, rates = {0.4, -0.2};
  const auto reference = make_one_step_scheme(double_pendulum_in_angles(), Gauss{6}, angles, rates);
  const auto reference_tangent =
      make_orbit_tangent(make_one_step_scheme(double_pendulum_in_angles(), Gauss{6}, angles, rates));
  const auto rate_of = [](const VectorXd& s) {  // from momenta
    const double c = std::cos(s[0] - s[1]), determinant = 2.0 - c * c;
    return Vector4d(s[0], s[1], (s[2] - c * s[3]) / determinant, (2.0 * s[3] - c * s[2]) / determinant);
  };
  const auto derivatives = [&](const VectorXd& s) {  // of Cartesian coordinates by angles and their momenta
    MatrixXd result(4, 4);
    for (int i = 0; i < 4; ++i) {
      constexpr double by = 1e-3;
      const auto at = [&](double shift) { return rate_of(s + shift * by * VectorXd::Unit(4, i)); };
      result.col(i) = (8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12.0 * by);
    }
    return MatrixXd(chart_derivatives(rate_of(s)) * result);
  };
  VectorXd s = Eigen::Map<const VectorXd>(reference->state().data(), 4);
  MatrixXd of_angles = MatrixXd::Identity(4, 4);
  const MatrixXd begin = derivatives(s);
  for (int k = 0; k < steps; ++k) {
    const VectorXd next = stepped(*reference, s, h);
    of_angles = carried(*reference_tangent, s, next, h, of_angles);
    s = next;
  }
  const MatrixXd expected = derivatives(s) * of_angles;
  REQUIRE(expected.cwiseAbs().maxCoeff() > 1.5);
  const auto distance = [&](const Method& method) {
    Mapped map = map_of(method);
    VectorXd z = chart(Vector4d(1.0, 0.3, 0.4, -0.2));
    MatrixXd columns = begin;
    for (int k = 0; k < steps; ++k) {
      const VectorXd next = stepped(*map.scheme, z, h);
      columns = carried(*map.tangent, z, next, h, columns);
      z = next;
    }
    return (columns - expected).cwiseAbs().maxCoeff();
  };
  CHECK(distance({Splitting{"kahan-li-8"}, 8, true}) < 1e-9);
  CHECK(distance({Gauss{4}, 8}) < 1e-9);
  CHECK(distance({Lobatto{5}, 8}) < 1e-9);
  // The twin: of order 2 there is its error.
  CHECK(distance(verlet) > 1e-5);
}

TEST_CASE("a scheme with constraints continues from what it saved to the same bits") {
  for (const Method& method : methods) {
    const IntegrationOptions options = options_of(method.lagrangian, 0.05, 10.0, Levels::variable);
    const auto make = [&]() {
      return method.by_H ? OrbitIntegrator(double_pendulum(), InitialState{start.q, start.v, 0.0}, options)
                         : OrbitIntegrator(double_pendulum_by_L(), InitialMotion{start.q, start.v, 0.0}, options);
    };
    OrbitIntegrator whole = make(), other = make();
    for (int k = 0; k < 7; ++k) {
      REQUIRE(whole.step().status == Status::success);
    }
    StateWriter writer;
    whole.save(writer);
    StateReader reader(writer.values());
    other.restore(reader);
    for (int k = 0; k < 7; ++k) {
      REQUIRE(whole.step().status == Status::success);
      REQUIRE(other.step().status == Status::success);
    }
    CHECK(std::ranges::equal(whole.scheme().state(), other.scheme().state()));
    CHECK(whole.t() == other.t());
  }
}

namespace {

/// What is wrong with a start of two coordinates, both ways of stating it.
std::string complaint(const std::vector<std::pair<std::string, std::string>>& constraints, const Place& from, bool by_L,
                      const SegmentLagrangian& lagrangian) {
  const std::vector<std::string> q = {"x", "y"};
  try {
    const IntegrationOptions options = options_of(lagrangian, 0.1, 1.0);
    if (by_L) {
      static_cast<void>(
          OrbitIntegrator(Lagrangian(q, "(x_dot^2 + y_dot^2)/2 - y").constrained(Constraints(q, constraints)),
                          InitialMotion{from.q, from.v, 0.0}, options));
    } else {
      static_cast<void>(
          OrbitIntegrator(Hamiltonian(q, {"a", "b"}, "(a^2 + b^2)/2 + y").constrained(Constraints(q, constraints)),
                          InitialState{from.q, from.v, 0.0}, options));
    }
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return {};
}
bool names(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("starts off the constraints and dependent constraints are refused with a remedy") {
  const std::vector<std::pair<std::string, std::string>> rod = {{"rod", "x^2 + y^2 - 1"}};
  for (const bool by_L : {false, true}) {
    const SegmentLagrangian lagrangian = by_L ? SegmentLagrangian(Midpoint{}) : SegmentLagrangian(Splitting{"verlet"});
    const auto why = [&](const auto& constraints, const Place& from) {
      return complaint(constraints, from, by_L, lagrangian);
    };
    CHECK(why(rod, {{0.6, 0.8}, {-0.8, 0.6}}).empty());
    CHECK(names(why(rod, {{0.6, 0.9}, {-0.8, 0.6}}), "start from x = 0.55"));
    CHECK(names(why(rod, {{0.6, 0.9}, {-0.8, 0.6}}), "rod = 0.1"));
    CHECK(names(why(rod, {{1.0, 0.0}, {0.5, 0.25}}), "rod = 1"));
    CHECK(names(why(rod, {{1.0, 0.0}, {0.5, 0.25}}), by_L ? "x_dot = 0, y_dot = 0.25" : "a = 0, b = 0.25"));
    CHECK(why(rod, {{1.0, 0.0}, {0.0, 0.25}}).empty());  // which is what it says
    CHECK(names(
        why(std::vector<std::pair<std::string, std::string>>{{"rod", "(x^2 + y^2 - 1)^2"}}, {{1.0, 0.0}, {0.0, 0.25}}),
        "without a power"));
    CHECK(names(why(std::vector<std::pair<std::string, std::string>>{{"rod", "x^2 + y^2 - 1"}, {"bar", "x - 1"}},
                    {{1.0, 0.0}, {0.0, 0.0}}),
                "depends on those of the others"));
  }
  CHECK(names(complaint(rod, {{1.0, 0.0}, {0.0, 0.25}}, false, Splitting{"golden"}), "verlet, suzuki-4, kahan-li-6"));
  CHECK(complaint(rod, {{1.0, 0.0}, {0.0, 0.25}}, false, Midpoint{}).empty());
  CHECK(names(complaint(rod, {{1.0, 0.0}, {0.5, 0.25}}, false, Midpoint{}), "a = 0, b = 0.25"));
  CHECK(names(complaint(rod, {{1.0, 0.0}, {0.0, 0.25}}, false, Gauss{2}), "use \"midpoint\" or \"splitting\""));
}

TEST_CASE("long steps with constraints stay on their branch") {
  // Of so long a step Newton's method may find another solution, whose energy is none of the motion's.
  const auto strays = [](const SegmentLagrangian& lagrangian) {
    const Place level = cartesian(1.5707963267948966, 0.0, 0.0, 0.0);
    const Orbit orbit =
        integrate(double_pendulum_by_L(), InitialMotion{level.q, level.v, 0.0}, options_of(lagrangian, 0.5, 100.0));
    REQUIRE(orbit.status == Status::success);
    return orbit.node_energy_deviation();
  };
  CHECK(strays(Gauss{8}) < 1e-3);
  CHECK(strays(Gauss{3}) > 1e-2);  // the twin: order 6 is not enough
}

TEST_CASE("the midpoint rule takes an H that is not separable with constraints") {
  // The rod in a frame that turns about the vertical, by H + w (b x - a y) in the horizontal plane of x and y.
  const std::vector<std::string> q = {"x", "y", "z"};
  const Hamiltonian H = Hamiltonian(q, {"a", "b", "c"}, "(a^2 + b^2 + c^2)/2 + z + 0.3*x - 0.7*(x*b - y*a)")
                            .constrained(Constraints(q, {{"rod", "x^2 + y^2 + z^2 - 1"}}));
  // H_p = (a + 0.7 y, b - 0.7 x, c) along the rod: x a + y b + z c = 0.
  const Orbit orbit = integrate(H, InitialState{{0.6, 0.0, -0.8}, {0.8, 0.5, 0.6}, 0.0},
                                options_of(Midpoint{}, 0.1, 50.0, Levels::variable));
  REQUIRE(orbit.status == Status::success);
  CHECK(orbit.discrete_energy_deviation() < 1e-13);
  for (std::size_t k = 0; k < orbit.t.size(); ++k) {
    const auto at = orbit.q_at(k), p = orbit.p_at(k);
    CHECK(std::abs(at[0] * at[0] + at[1] * at[1] + at[2] * at[2] - 1.0) < 1e-14);
    CHECK(std::abs(at[0] * p[0] + at[1] * p[1] + at[2] * p[2]) < 1e-14);
  }
}

TEST_CASE("the midpoint rule with constraints does not depend on units, nor on how short a step is") {
  const auto rod = [](double mass, double length, double gravity, double step, int steps) {
    const std::vector<std::string> q = {"x", "y"};
    const Hamiltonian H =
        Hamiltonian(q, {"u", "v"}, "(u^2 + v^2)/(2*m) + m*g*y", {{"m", mass}, {"g", gravity * length}})
            .constrained(Constraints(q, {{"rod", "x^2 + y^2 - l^2"}}, {{"l", length}}));
    Orbit orbit =
        integrate(H, InitialState{{0.6 * length, -0.8 * length}, {0.8 * mass * length, 0.6 * mass * length}, 0.0},
                  options_of(Midpoint{}, step, step * steps));
    REQUIRE(orbit.status == Status::success);
    return orbit;
  };
  // In units of its square.
  const auto largest_off = [](const Orbit& orbit, double length) {
    double largest = 0.0;
    for (std::size_t k = 0; k < orbit.t.size(); ++k) {
      const auto q = orbit.q_at(k);
      largest = std::max(largest, std::abs(std::hypot(q[0], q[1]) / length - 1.0));
    }
    return largest;
  };
  constexpr double rounding = 1e-15;  // of q, and of its length
  const Orbit orbit = rod(1.0, 1.0, 9.81, 0.02, 200);
  CHECK(largest_off(orbit, 1.0) < rounding);
  const auto distance = [&orbit](const Orbit& other, double length) {
    double largest = 0.0;
    for (std::size_t k = 0; k < orbit.t.size(); ++k) {
      largest = std::max(largest, std::abs(other.q_at(k)[0] / length - orbit.q_at(k)[0]));
    }
    return largest;
  };
  for (const auto& [mass, length] : {std::pair(0x1p40, 1.0), {0x1p-90, 1.0}, {0x1p20, 0x1p-30}, {1.0, 0x1p40}}) {
    CAPTURE(mass, length);
    const Orbit other = rod(mass, length, 9.81, 0.02, 200);
    CHECK(largest_off(other, length) < rounding);
    // Elimination may choose other pivots: a rounding error in each step, carried along like the number of steps.
    CHECK(distance(other, length) < 200 * 200 * rounding);
  }
  // The twins: a motion that is not the same, and a rod that is longer by little.
  CHECK(distance(rod(1.0, 1.0, 9.8101, 0.02, 200), 1.0) > 1e-6);
  CHECK(largest_off(orbit, 1.0 + 1e-14) > rounding);
  for (const double step : {1e-6, 1e-8}) {
    CHECK(largest_off(rod(1.0, 1.0, 9.81, step, 1000), 1.0) < rounding);
  }
}

TEST_CASE("a small rod beside a large one is solved for as well as alone") {
  // In units of their lengths the small one turns eight times as fast, so that it takes more iterations.
  constexpr double length = 0x1p-30, step = 0.02;
  constexpr int steps = 200;
  const std::string large = "(a^2 + b^2)/2 + 9.81*y", small = "(c^2 + d^2)/2 + g*v";
  const double gravity = 64.0 * 9.81 * length;
  const auto orbit_of_small = [&](bool alone, double g) {
    const std::vector<std::string> q = alone ? std::vector<std::string>{"u", "v"}
                                             : std::vector<std::string>{"x", "y", "u", "v"},
                                   p = alone ? std::vector<std::string>{"c", "d"}
                                             : std::vector<std::string>{"a", "b", "c", "d"};
    std::vector<std::pair<std::string, std::string>> rods_of = {{"small", "u^2 + v^2 - l^2"}};
    std::vector<double> begin = {0.6 * length, -0.8 * length}, momenta = {6.4 * length, 4.8 * length};
    if (!alone) {
      rods_of.emplace_back("large", "x^2 + y^2 - 1");
      begin.insert(begin.begin(), {0.6, -0.8});
      momenta.insert(momenta.begin(), {0.8, 0.6});
    }
    const Hamiltonian H = Hamiltonian(q, p, alone ? small : small + " + " + large, {{"g", g}})
                              .constrained(Constraints(q, rods_of, {{"l", length}}));
    const Orbit orbit = integrate(H, InitialState{begin, momenta, 0.0}, options_of(Midpoint{}, step, step * steps));
    REQUIRE(orbit.status == Status::success);
    std::vector<double> places_of;
    for (std::size_t k = 0; k < orbit.t.size(); ++k) {
      const auto at = orbit.q_at(k);
      places_of.push_back(at[at.size() - 2] / length);
    }
    return places_of;
  };
  const auto distance = [](const std::vector<double>& a, const std::vector<double>& b) {
    double largest = 0.0;
    for (std::size_t k = 0; k < a.size(); ++k) {
      largest = std::max(largest, std::abs(a[k] - b[k]));
    }
    return largest;
  };
  const std::vector<double> alone = orbit_of_small(true, gravity);
  // A rounding error in each step, carried along like the number of steps.
  constexpr double rounding = 1e-15;
  CHECK(distance(orbit_of_small(false, gravity), alone) < steps * steps * rounding);
  CHECK(distance(orbit_of_small(false, gravity * (1.0 + 1e-9)), alone) > steps * steps * rounding);  // the twin
}

TEST_CASE("constraints of which one is linear in a coordinate that does not move hold exactly") {
  const std::vector<std::string> q = {"x", "y", "z"};
  const Hamiltonian H = Hamiltonian(q, {"a", "b", "c"}, "(a^2 + b^2 + c^2)/2 + y + 3*z")
                            .constrained(Constraints(q, {{"rod", "x^2 + y^2 + z^2 - 1"}, {"plane", "z"}}));
  const Orbit orbit = integrate(H, InitialState{{1.0, 0.0, 0.0}, {0.0, 0.5, 0.0}, 0.0},
                                options_of(Splitting{"suzuki-4"}, 0.05, 20.0, Levels::variable));
  REQUIRE(orbit.status == Status::success);
  CHECK(orbit.discrete_energy_deviation() < 1e-13);
  for (std::size_t k = 0; k < orbit.t.size(); ++k) {
    CHECK(std::abs(orbit.q_at(k)[2]) < 1e-15);
  }
}
