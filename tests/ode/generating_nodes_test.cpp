// What generating functions are computed with: orbits at Gauss' nodes, their continuation, tangents of the flow.
#include <catch2/catch.hpp>

#include <cmath>
#include <limits>
#include <vector>

#include <rubato/ode/flow_map.hpp>
#include <rubato/ode/generating_continuation.hpp>
#include <rubato/ode/generating_forecast.hpp>
#include <rubato/ode/generating_nodes.hpp>

namespace {

using namespace rubato;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double epsilon = std::numeric_limits<double>::epsilon();

Hamiltonian kepler() {
  return Hamiltonian({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");
}
VectorXd pericentre(double e) {
  VectorXd z(4);
  z << 1 - e, 0, 0, std::sqrt((1 + e) / (1 - e));
  return z;
}

/// δ over h by Taylor steps of order 30 from z: exact to rounding.
VectorXd exact_increment(const VectorXd& z, double h) {
  FlowMap flow(kepler(), 30);
  VectorXd delta(4);
  REQUIRE(flow.start(z, h) == Status::success);
  flow.increment(h, delta);
  return delta;
}

}  // namespace

TEST_CASE("antiderivatives at the nodes are those of polynomials up to their degree, and of no others") {
  for (const bool parity : {true, false}) {
    for (const int terms : {1, 2, 3, 7, 12, 31}) {
      const GeneratingNodes nodes(terms, parity);
      CHECK(nodes.count == (parity ? (terms + 1) / 2 : terms));
      const int degrees = parity ? 2 * nodes.count : nodes.count;
      for (int degree = 0; degree <= degrees; ++degree) {
        // f = x^degree with x = 2τ; ∫^τ f = (x^(degree+1) - c)/(2(degree+1)) where c makes the ends opposite.
        const bool even = degree % 2 == 0;
        const int kind = parity && !even ? 1 : 0;
        const double scale = 1.0 / (2.0 * (degree + 1));
        const VectorXd f = (2.0 * nodes.tau).array().pow(degree);
        const VectorXd F = scale * ((2.0 * nodes.tau).array().pow(degree + 1) - (even ? 0.0 : 1.0));
        INFO("parity " << parity << ", " << terms << " terms, degree " << degree);
        // Sums of at most 31 numbers of order 1. The first degree that is not represented misses the antiderivative of
        // a Legendre polynomial with leading coefficient 1, which at degree 32 still is 1e-11.
        CHECK(((nodes.antiderivative[kind] * f - F).cwiseAbs().maxCoeff() <= 200 * epsilon) == (degree < degrees));
        if (degree == degrees) {
          break;
        }
        CHECK(std::abs(nodes.centre_integral[kind].dot(f) + (even ? 0.0 : scale)) <= 200 * epsilon);
        if (!parity || even) {
          CHECK(std::abs(nodes.integral.dot(f) - (even ? 2 * scale : 0.0)) <= 50 * epsilon);
          CHECK(std::abs(nodes.centre_value.dot(f) - (degree == 0 ? 1.0 : 0.0)) <= 500 * epsilon);
        }
      }
    }
  }
}

TEST_CASE("the orbit of an expansion, continued, is the flow from its end") {
  // Expanded at w, the orbit is exact up to (h/2)^(N+1) within the step and (3h/2)^(N+1) at the end of the next, over a
  // radius of convergence of about 1.5 for e = 0.1.
  const VectorXd z = pericentre(0.1);
  constexpr int terms = 24;
  for (const bool plain : {true, false}) {
    MatrixXd F = MatrixXd::Zero(4, 4);
    if (!plain) {
      F.diagonal() << 0.3, -0.2, 0.4, 0.1;
    }
    GeneratingFunction generating(kepler(), F, terms);
    OrbitContinuation continuation(generating);
    const double h = 0.1;
    const VectorXd delta = exact_increment(z, h);
    const VectorXd w = z + 0.5 * (delta + symplectic_unit(2) * F * delta);
    REQUIRE(generating.expand_gradients({w.data(), 4}, terms) == Status::success);
    VectorXd found(4);
    for (const double next : {0.1, 0.05, -0.1, 1e-3}) {
      const VectorXd expected = exact_increment(z + delta, next);
      CHECK(continuation.increment(generating, h, next, found));
      CHECK((found - expected).cwiseAbs().maxCoeff() <= 1e-13);
      CHECK((found - expected).cwiseAbs().maxCoeff() > 0.0);
      CHECK((found - exact_increment(z, next)).cwiseAbs().maxCoeff() > 1e-5);
    }
    CHECK_FALSE(continuation.increment(generating, h, 2.0, found));  // far beyond convergence, and it says so
  }
}

TEST_CASE("tangents of the flow by Taylor steps of low order") {
  const VectorXd z = pericentre(0.3);
  FlowTangent tangent(kepler(), 8);
  VectorXd v(4);
  v << 0.3, -0.2, 0.5, 0.4;
  v *= 1e-5;
  VectorXd found(4);
  for (const double h : {0.05, -0.1}) {
    REQUIRE(tangent.apply(z, v, h, found) == Status::success);
    const VectorXd expected = 0.5 * (exact_increment(z + v, h) - exact_increment(z - v, h));
    // Order 8 leaves (h/0.5)^9; rounding, 1e-11 of v.
    const double allowed = (std::pow(std::abs(h) / 0.4, 9) + 1e-10) * v.norm();
    CHECK((found - expected).norm() <= allowed);
    CHECK((found + expected).norm() > allowed);
  }
  // A step of several parts, where one part does not converge.
  REQUIRE(tangent.apply(z, v, 1.5, found) == Status::success);
  const VectorXd expected = 0.5 * (exact_increment(z + v, 1.5) - exact_increment(z - v, 1.5));
  CHECK((found - expected).norm() <= 0.1 * expected.norm());
  REQUIRE(tangent.apply(VectorXd::Zero(4), v, 0.1, found) == Status::success);
  VectorXd collision = VectorXd::Zero(4);
  CHECK(tangent.apply(collision, collision, 0.1, found) == Status::undefined);
  CHECK_THAT(tangent.failure(), Catch::Contains("no Taylor expansion at 0"));
}

TEST_CASE("what predictions miss is predicted") {
  const auto size = [](const VectorXd& v) { return v.cwiseAbs().maxCoeff(); };
  const auto error_at = [](int k) { return VectorXd(VectorXd::Constant(2, 1e-8 * std::sin(0.3 * k))); };
  PredictionError memory(2);
  for (int k = 0; k < 6; ++k) {
    memory.record(0.1, error_at(k), size);
  }
  VectorXd prediction = VectorXd::Zero(2);
  memory.correct(0.1, prediction);
  // A cubic through steps of 0.3 misses 0.3^4 of the amplitude.
  CHECK(size(prediction - error_at(6)) <= 1e-8 * std::pow(0.3, 4));
  CHECK(size(error_at(6)) > 1e-8 * std::pow(0.3, 4));
  VectorXd other = VectorXd::Zero(2);
  memory.correct(0.2, other);  // steps of another size
  CHECK(size(other) == 0.0);
  StateWriter writer;
  memory.save(writer);
  PredictionError copy(2);
  StateReader reader(writer.values());
  copy.restore(reader);
  CHECK(reader.done());
  copy.correct(0.1, other);
  CHECK(other == prediction);
  // Where errors are noise, none is predicted.
  for (int k = 0; k < 9; ++k) {
    memory.record(0.1, VectorXd::Constant(2, k % 2 == 0 ? 1e-8 : -1e-8), size);
  }
  other.setZero();
  memory.correct(0.1, other);
  CHECK(size(other) == 0.0);
}
