// What lagrangian = "lobatto" is: the Galerkin variational integrator with Lobatto's points, which is the pair of
// Lobatto IIIA and IIIB only where the kinetic term of L is a constant one.

#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Dense>
#include <catch2/catch.hpp>

#include <rubato/record/reader.hpp>
#include <rubato/run/run.hpp>

#include "defects.hpp"
#include "record/sample.hpp"

using namespace rubato;
using namespace rubato::defect_tests;
using Eigen::Vector2d;
using Eigen::Vector4d;

namespace {

constexpr double h = 0.04;

/// q and p after one step.
struct Point {
  Vector2d q, p;
};

double distance(const Point& a, const Point& b) {
  return std::max((a.q - b.q).cwiseAbs().maxCoeff(), (a.p - b.p).cwiseAbs().maxCoeff());
}

/// L = q̇²/2 + B (x ẏ - y ẋ)(1 + x²/3) - x²/2 - cos y.
struct Charge {
  double B;

  [[nodiscard]] Vector2d by_q(const Vector2d& q, const Vector2d& v) const {
    const double g = 1.0 + q[0] * q[0] / 3.0, moment = q[0] * v[1] - q[1] * v[0];
    return {B * (v[1] * g + moment * 2.0 * q[0] / 3.0) - q[0], -B * v[0] * g + std::sin(q[1])};
  }
  [[nodiscard]] Vector2d by_v(const Vector2d& q, const Vector2d& v) const {
    const double g = 1.0 + q[0] * q[0] / 3.0;
    return {v[0] - B * q[1] * g, v[1] + B * q[0] * g};
  }
  [[nodiscard]] Vector2d velocity(const Vector2d& q, const Vector2d& p) const { return p - by_v(q, Vector2d::Zero()); }
};

const Vector2d first_q(0.5, -0.3), first_v(0.3, 0.4);

/// The step of the program.
Point of_program(const std::string& magnetic) {
  const sample::Folder folder;
  const std::vector<std::string> settings = {
      "scheme.until=0.04",
      "lagrangian.L=(x_dot^2 + y_dot^2)/2 + " + magnetic + "*(x*y_dot - y*x_dot)*(1 + x^2/3) - x^2/2 - cos(y)"};
  const Problem problem = read_problem(defect_file("lobatto-is-not-IIIA-IIIB.toml"), settings);
  REQUIRE(run(problem, {.output = (folder / "record.h5").string()}).status == ExitStatus::done);
  const record::Reader reader(folder / "record.h5");
  const std::vector<double> q = reader.read("/states/q"), p = reader.read("/states/p");
  REQUIRE(q.size() == 4);
  return {{q[2], q[3]}, {p[2], p[3]}};
}

/// The extremum of h (L(0) + 4 L(1/2) + L(1))/6 over parabolas through q_0, q_m, q_1.
Point galerkin(const Charge& L) {
  const Vector2d q0 = first_q, p0 = L.by_v(first_q, first_v);
  // ∂/∂(q_0, q_m, q_1) of the action.
  const auto slopes = [&](const Vector2d& m, const Vector2d& q1) {
    const std::array<Vector2d, 3> q = {q0, m, q1};
    // Derivatives of the three Lagrange polynomials at 0, 1/2, 1, and their weights.
    constexpr std::array<std::array<double, 3>, 3> slope = {{{-3, 4, -1}, {-1, 0, 1}, {1, -4, 3}}};
    constexpr std::array<double, 3> weight = {1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0};
    std::array<Vector2d, 3> result = {Vector2d::Zero(), Vector2d::Zero(), Vector2d::Zero()};
    for (std::size_t j = 0; j < 3; ++j) {
      Vector2d v = Vector2d::Zero();
      for (std::size_t i = 0; i < 3; ++i) {
        v += slope[j][i] * q[i] / h;
      }
      result[j] += h * weight[j] * L.by_q(q[j], v);
      for (std::size_t i = 0; i < 3; ++i) {
        result[i] += weight[j] * slope[j][i] * L.by_v(q[j], v);
      }
    }
    return result;
  };
  const auto residual = [&](const Vector4d& u) {
    const auto d = slopes(u.head<2>(), u.tail<2>());
    Vector4d r;
    r << d[0] + p0, d[1];
    return r;
  };
  Vector4d u;
  u << q0 + 0.5 * h * first_v, q0 + h * first_v;
  for (int iteration = 0; iteration < 12; ++iteration) {  // Newton's method with differences for its matrix
    Eigen::Matrix4d J;
    for (int k = 0; k < 4; ++k) {
      J.col(k) = (residual(u + 1e-6 * Vector4d::Unit(k)) - residual(u - 1e-6 * Vector4d::Unit(k))) / 2e-6;
    }
    u -= J.partialPivLu().solve(residual(u));
  }
  return {u.tail<2>(), slopes(u.head<2>(), u.tail<2>())[2]};
}

/// Lobatto IIIA for q and IIIB for p, three stages, for the H of this L.
Point partitioned(const Charge& L) {
  constexpr std::array<std::array<double, 3>, 3> A = {
      {{0, 0, 0}, {5.0 / 24.0, 1.0 / 3.0, -1.0 / 24.0}, {1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0}}};
  constexpr std::array<std::array<double, 3>, 3> B = {
      {{1.0 / 6.0, -1.0 / 6.0, 0}, {1.0 / 6.0, 1.0 / 3.0, 0}, {1.0 / 6.0, 5.0 / 6.0, 0}}};
  constexpr std::array<double, 3> b = {1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0};
  const Vector2d q0 = first_q, p0 = L.by_v(first_q, first_v);
  std::array<Vector2d, 3> q = {q0, q0, q0}, p = {p0, p0, p0};
  const auto sums = [&](const std::array<double, 3>& of_q, const std::array<double, 3>& of_p) {
    Point point{q0, p0};
    for (std::size_t j = 0; j < 3; ++j) {
      const Vector2d v = L.velocity(q[j], p[j]);
      point.q += h * of_q[j] * v;
      point.p += h * of_p[j] * L.by_q(q[j], v);  // -H_q
    }
    return point;
  };
  for (int iteration = 0; iteration < 60; ++iteration) {
    std::array<Point, 3> stages;
    for (std::size_t i = 0; i < 3; ++i) {
      stages[i] = sums(A[i], B[i]);
    }
    for (std::size_t i = 0; i < 3; ++i) {
      q[i] = stages[i].q;
      p[i] = stages[i].p;
    }
  }
  return sums(b, b);
}

}  // namespace

TEST_CASE("lobatto is the Galerkin integrator, and IIIA-IIIB for a constant kinetic term only") {
  // Numbers up to 1, from a handful of sums that are solved to stagnation.
  constexpr double rounding = 1e-14;
  const Point magnetic = of_program("1");
  CHECK(distance(magnetic, galerkin({1.0})) < rounding);
  CHECK(distance(magnetic, partitioned({1.0})) > 1e-9);
  const Point plain = of_program("0");
  CHECK(distance(plain, galerkin({0.0})) < rounding);
  CHECK(distance(plain, partitioned({0.0})) < rounding);
  CHECK(distance(plain, magnetic) > 1e-3);  // the twin
}
