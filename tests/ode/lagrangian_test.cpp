// Problems stated by L(q, q̇): the Legendre transform, quadratures of the action as discrete Lagrangians, and the same
// problem stated by L and by H.

#include <catch2/catch.hpp>

#include <cmath>
#include <string>
#include <vector>

#include <rubato/ode/integrate.hpp>
#include <rubato/ode/lagrangian.hpp>
#include <rubato/ode/lagrangian_scheme.hpp>
#include <rubato/ode/legendre.hpp>
#include <rubato/variation/action_quadrature.hpp>

#include "systems.hpp"

using namespace rubato;

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

/// A problem stated both ways.
struct Pair {
  std::string name;
  Lagrangian L;
  Hamiltonian H;
  InitialMotion start;
};

/// Masses and lengths 1: H with the inverse of [[2, c], [c, 1]], c = cos(a - b).
Pair double_pendulum() {
  return {"double pendulum",
          Lagrangian({"a", "b"}, "a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b) + 2*cos(a) + cos(b)"),
          Hamiltonian({"a", "b"}, {"u", "v"},
                      "(u^2 + 2*v^2 - 2*u*v*cos(a - b))/(2*(2 - cos(a - b)^2)) - 2*cos(a) - cos(b)"),
          {.q = {0.9, 0.4}, .q_dot = {0.3, -0.2}}};
}

/// A field that is not uniform: B = 1 + x², in a quadratic well; L has the term A·q̇.
Pair magnetic() {
  return {"magnetic field",
          Lagrangian({"x", "y"}, "(x_dot^2 + y_dot^2)/2 + (x + x^3/3)*y_dot - (x^2 + 2*y^2)/4"),
          Hamiltonian({"x", "y"}, {"u", "v"}, "(u^2 + (v - x - x^3/3)^2)/2 + (x^2 + 2*y^2)/4"),
          {.q = {0.5, 0.2}, .q_dot = {0.1, 0.6}}};
}

/// On the sphere: the mass matrix depends on an angle.
Pair sphere() {
  return {"spherical pendulum",
          Lagrangian({"theta", "phi"}, "(theta_dot^2 + sin(theta)^2*phi_dot^2)/2 + cos(theta)"),
          Hamiltonian({"theta", "phi"}, {"u", "v"}, "(u^2 + v^2/sin(theta)^2)/2 - cos(theta)"),
          {.q = {1.0, 0.0}, .q_dot = {0.2, 0.9}}};
}

/// Not quadratic in velocities: the momenta are an equation to solve.
Pair relativistic() {
  return {"relativistic",
          Lagrangian({"x", "y"}, "-sqrt(1 - x_dot^2 - y_dot^2) - (x^2 + 3*y^2)/2"),
          Hamiltonian({"x", "y"}, {"u", "v"}, "sqrt(1 + u^2 + v^2) + (x^2 + 3*y^2)/2"),
          {.q = {0.8, 0.3}, .q_dot = {0.3, 0.4}}};
}

Pair henon_heiles() {
  return {"Henon-Heiles",
          Lagrangian({"x", "y"}, "(x_dot^2 + y_dot^2)/2 - (x^2 + y^2)/2 - x^2*y + y^3/3"),
          systems::henon_heiles().hamiltonian,
          {.q = {0.1, 0.2}, .q_dot = {0.3, 0.1}}};
}

std::vector<Pair> pairs() {
  return {double_pendulum(), magnetic(), sphere(), relativistic(), henon_heiles()};
}

InitialState state_of(const Pair& pair) {
  return {.q = pair.start.q, .p = momenta(pair.L, pair.start.q, pair.start.q_dot)};
}

double distance(const Orbit& a, const Orbit& b) {
  double largest = 0.0;
  REQUIRE(a.steps() == b.steps());
  for (std::size_t i = 0; i < a.q.size(); ++i) {
    largest = std::max({largest, std::abs(a.q[i] - b.q[i]), std::abs(a.p[i] - b.p[i])});
  }
  return largest;
}

std::vector<double> last_state(const Orbit& orbit) {
  REQUIRE(orbit.message.empty());
  return systems::state_at(orbit, orbit.steps());
}

}  // namespace

TEST_CASE("the Legendre transform of L is H, its gradient and its Gamma") {
  for (const Pair& pair : pairs()) {
    INFO(pair.name);
    const std::size_t n = pair.start.q.size();
    const InitialState state = state_of(pair);
    const std::vector<double> z = systems::joined(state);
    HamiltonianEvaluator H(pair.H);
    LegendreTransform transform(pair.L);
    std::vector<double> gradient(2 * n);
    const double energy = H.gradient(z.data(), gradient.data());
    double same = 0.0;
    const double gamma = H.gamma(z.data(), same);
    // From another velocity, in the domain of L; all numbers here are of size 1.
    std::vector<double> q_dot(n, 0.05);
    REQUIRE(transform.solve(z.data(), z.data() + n, q_dot.data()) == Status::success);
    CHECK(std::abs(transform.energy() - energy) < 8 * epsilon);
    CHECK(std::abs(transform.gamma() - gamma) < 100 * epsilon * (1.0 + std::abs(gamma)));
    for (std::size_t i = 0; i < n; ++i) {
      CHECK(std::abs(q_dot[i] - gradient[n + i]) < 16 * epsilon);
      CHECK(std::abs(q_dot[i] - pair.start.q_dot[i]) < 16 * epsilon);
    }
    CHECK(std::abs(transform.gamma() + gamma) > 1e-3);  // a twin: the sign matters
  }
}

TEST_CASE("velocities of momenta that L does not reach are not found") {
  LegendreTransform bounded(Lagrangian({"q"}, "sqrt(1 + q_dot^2)"));  // |p| < 1
  double q = 0.0, p = 1.5, q_dot = 0.1;
  CHECK(bounded.solve(&q, &p, &q_dot) != Status::success);
  p = 0.6;
  q_dot = 0.1;
  REQUIRE(bounded.solve(&q, &p, &q_dot) == Status::success);
  CHECK(std::abs(q_dot - 0.75) < 8 * epsilon);
  LegendreTransform cubic(Lagrangian({"q"}, "q_dot^3/3"));
  p = 0.04;
  q_dot = 0.0;
  CHECK(cubic.solve(&q, &p, &q_dot) == Status::undefined);
  CHECK(cubic.singular());
  for (const double sign : {1.0, -1.0}) {  // of two velocities the one on the side of the guess
    q_dot = sign;
    REQUIRE(cubic.solve(&q, &p, &q_dot) == Status::success);
    CHECK(std::abs(q_dot - sign * 0.2) < 8 * epsilon);
  }
}

TEST_CASE("velocities solve the momentum's equation to rounding, or it is said") {
  // p = v + 0.9e-10 sin(1e10 v) grows with v everywhere, and Newton's method has to find its way among its waves, where
  // what is left of p stays about 1e-10 for a while. That is not rounding: of p it is epsilon; of v, u·|v|·1.9; and the
  // phase of the sine has an error of 2u·|1e10 v|, which makes 0.9·2u·|v| of it.
  LegendreTransform wavy(Lagrangian({"q"}, "q_dot^2/2 - 0.9e-20*cos(1e10*q_dot)"));
  int solved = 0;
  for (int k = 1; k <= 200; ++k) {
    const double q = 0.0;
    const double p = 0.005 * k;
    double v = 0.4;
    if (wavy.solve(&q, &p, &v) == Status::success) {
      ++solved;
      CHECK(std::abs(p - (v + 0.9e-10 * std::sin(1e10 * v))) < 8 * epsilon);
    }
  }
  CHECK(solved > 100);
  // A sum that cancels has more rounding than its value: 1e6 v - (1e6 - 1) v. It is found all the same.
  LegendreTransform cancelling(Lagrangian({"q"}, "1e6*q_dot^2/2*cos(q) - (1e6 - 1)*q_dot^2/2*cos(q) + q_dot^4/4"));
  for (int k = 1; k <= 200; ++k) {
    const double q = 0.3;
    const double p = 0.01 * k;
    double v = 0.1;
    REQUIRE(cancelling.solve(&q, &p, &v) == Status::success);
    CHECK(std::abs(p - (v * std::cos(q) + v * v * v)) < 4e6 * epsilon);
  }
}

TEST_CASE("velocities do not depend on how far away they were looked for from") {
  const Lagrangian lagrangian({"x", "y"}, "0.1*x_dot^2 + 2*y_dot^2 + x_dot*y_dot/4 - x^4");
  LegendreTransform transform(lagrangian);
  const double q[] = {1.5, 0.3}, wanted[] = {0.7, -0.2};
  const std::vector<double> p = momenta(lagrangian, q, wanted);
  for (const double guess : {0.5, 1e6, -1e20, 1e74}) {
    double v[] = {guess, -0.3 * guess};
    REQUIRE(transform.solve(q, p.data(), v) == Status::success);
    CHECK(std::abs(v[0] - wanted[0]) < 1e-11);  // by far less than the guess is rounded at
    CHECK(std::abs(v[1] - wanted[1]) < 1e-11);
    CHECK(std::abs(transform.energy() - (p[0] * wanted[0] + p[1] * wanted[1] -
                                         (0.1 * 0.49 + 2 * 0.04 - 0.7 * 0.2 / 4 - 1.5 * 1.5 * 1.5 * 1.5))) < 1e-13);
  }
}

TEST_CASE("quadratures of the action are exact where they have to be") {
  for (const auto points : {ActionQuadrature::Points::gauss, ActionQuadrature::Points::lobatto}) {
    for (int d = 1; d <= ActionQuadrature::most_degree; ++d) {
      const ActionQuadrature quadrature(points, d);
      const Eigen::VectorXd& c = quadrature.nodes;
      INFO(d);
      // Degree 2d - 1 both: d Gauss points, d + 1 Lobatto points. Sums of up to nine terms of size 1.
      for (int k = 1; k <= 2 * d; ++k) {
        CHECK(std::abs(quadrature.weights.dot(c.array().pow(k - 1).matrix()) - 1.0 / k) < 8 * epsilon);
      }
      CHECK(std::abs(quadrature.weights.dot(c.array().pow(2 * d).matrix()) - 1.0 / (2 * d + 1)) > 1e3 * epsilon);
      // Polynomials of degree d and their rates, which are sums of terms of size d².
      const Eigen::VectorXd at = quadrature.control.array().pow(d).matrix();
      CHECK((quadrature.values * at - c.array().pow(d).matrix()).norm() < 32 * epsilon);
      CHECK((quadrature.rates * at - d * c.array().pow(d - 1).matrix()).norm() < 100 * d * epsilon);
      const Eigen::VectorXd beyond = quadrature.control.array().pow(d + 2).matrix();
      CHECK((quadrature.rates * beyond - (d + 2) * c.array().pow(d + 1).matrix()).norm() > 1e-6);  // the twin
    }
  }
  CHECK_THROWS_WITH(ActionQuadrature(ActionQuadrature::Points::lobatto, 0),
                    Catch::Matchers::Contains("between 2 and 9; got 1"));
  CHECK_THROWS_WITH(ActionQuadrature(ActionQuadrature::Points::gauss, 9),
                    Catch::Matchers::Contains("between 1 and 8; got 9"));
}

TEST_CASE("the discrete energy of a quadrature is -dL_d/dh, by differences of L_d itself") {
  // L_d = h Σ b_j L at the value y of the control point between for which it is stationary: found by Newton's method
  // with differences, whose error enters L_d squared. Not separable, mass and force of size 1.
  const Lagrangian L({"q"}, "(1 + q^2/2)*q_dot^2/2 + cos(q) + sin(q)*q_dot/3");
  LagrangianEvaluator evaluator(L);
  using Points = ActionQuadrature::Points;
  for (const auto& [points, degree] :
       {std::pair(Points::gauss, 1), {Points::lobatto, 1}, {Points::lobatto, 2}, {Points::gauss, 2}}) {
    const ActionQuadrature quadrature(points, degree);
    const auto action = [&, d = degree](double q_0, double y, double q_1, double h) {
      Eigen::VectorXd control(d + 1);
      control[0] = q_0, control[d] = q_1;
      if (d == 2) {
        control[1] = y;
      }
      double sum = 0.0;
      for (Eigen::Index j = 0; j < quadrature.nodes.size(); ++j) {
        const double at[] = {quadrature.values.row(j).dot(control), quadrature.rates.row(j).dot(control) / h};
        double gradient[2];
        sum += h * quadrature.weights[j] * evaluator.gradient(at, gradient);
      }
      return sum;
    };
    const auto L_d = [&, d = degree](double q_0, double q_1, double h) {
      double y = 0.5 * (q_0 + q_1);
      for (int i = 0; i < 20 && d == 2; ++i) {
        constexpr double w = 1e-4;
        const double up = action(q_0, y + w, q_1, h), here = action(q_0, y, q_1, h), down = action(q_0, y - w, q_1, h);
        y -= 0.5 * w * (up - down) / (up - 2.0 * here + down);
      }
      return action(q_0, y, q_1, h);
    };
    const double q_0 = 0.3, q_dot = 0.8, h = 0.4;
    const auto scheme = make_lagrangian_scheme(L, quadrature, std::span(&q_0, 1), std::span(&q_dot, 1));
    const double p_0 = scheme->state()[1];
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    const double E = scheme->discrete_energy();
    scheme->accept();
    const double q_1 = scheme->state()[0], p_1 = scheme->state()[1];
    // Central differences of width 1e-4 of functions whose derivatives are of size 1 to 1/h^3: below 1e-6.
    constexpr double width = 1e-4, tolerance = 1e-6;
    INFO(degree << (points == Points::gauss ? " Gauss" : " Lobatto"));
    CHECK(std::abs(E + (L_d(q_0, q_1, h + width) - L_d(q_0, q_1, h - width)) / (2 * width)) < tolerance);
    CHECK(std::abs(p_0 + (L_d(q_0 + width, q_1, h) - L_d(q_0 - width, q_1, h)) / (2 * width)) < tolerance);
    CHECK(std::abs(p_1 - (L_d(q_0, q_1 + width, h) - L_d(q_0, q_1 - width, h)) / (2 * width)) < tolerance);
    CHECK(std::abs(E - scheme->node().energy) > 10 * tolerance);  // the twin: H at the node is another number
  }
}

TEST_CASE("the midpoint rule and Gauss's for the action of L are those for H, step by step") {
  for (const Pair& pair : pairs()) {
    INFO(pair.name);
    const InitialState state = state_of(pair);
    for (const SegmentLagrangian& scheme : {SegmentLagrangian(Midpoint{}), SegmentLagrangian(Gauss{1}),
                                            SegmentLagrangian(Gauss{2}), SegmentLagrangian(Gauss{4})}) {
      const IntegrationOptions options{.lagrangian = scheme, .step = 0.05, .until = 5.0, .levels = Levels::fixed};
      const Orbit by_L = integrate(pair.L, pair.start, options);
      const Orbit by_H = integrate(pair.H, state, options);
      // 100 steps' rounding, 1e-16 each, times what these orbits stretch differences by, less than 1e3.
      CHECK(distance(by_L, by_H) < 1e-11);
      for (std::size_t k = 0; k < by_L.steps(); ++k) {
        REQUIRE(std::abs(by_L.energy[k] - by_H.energy[k]) < 1e-12);
      }
      REQUIRE(by_L.q_dot.size() == by_L.q.size());
    }
    const IntegrationOptions options{.lagrangian = Trapezoid{}, .step = 0.05, .until = 5.0, .levels = Levels::fixed};
    CHECK(distance(integrate(pair.L, pair.start, options),
                   integrate(pair.H, state, {.step = 0.05, .until = 5.0, .levels = Levels::fixed})) >
          1e-6);  // the twin
  }
}

TEST_CASE("with variable levels, too, the midpoint rule for L is that for H, Gamma and steps off the law with it") {
  for (const Pair& pair : pairs()) {
    INFO(pair.name);
    const IntegrationOptions options{.step = 0.05, .until = 5.0, .on_singular = OnSingular::plain};
    const Orbit by_L = integrate(pair.L, pair.start, options);
    const Orbit by_H = integrate(pair.H, state_of(pair), options);
    INFO(by_L.message << by_H.message);
    REQUIRE(by_L.status == Status::success);
    // Each step's length is known to the tolerance of the level equation over |h dE/dh|/E, 1e-3 here: 1e-10.
    CHECK(distance(by_L, by_H) < 1e-7);
    CHECK(by_L.off_law == by_H.off_law);
    CHECK(by_L.discrete_energy_deviation() <= 1e-13);
    for (std::size_t k = 0; k <= by_L.steps(); ++k) {
      REQUIRE(std::abs(by_L.gamma[k] - by_H.gamma[k]) < 1e-6 * (1.0 + std::abs(by_H.gamma[k])));
    }
  }
}

TEST_CASE("the trapezoidal rule for L = T - V is Stormer and Verlet's method") {
  const Pair pair = henon_heiles();
  const auto run = [&](SegmentLagrangian scheme) {
    const IntegrationOptions options{
        .lagrangian = std::move(scheme), .step = 0.05, .until = 5.0, .levels = Levels::fixed};
    return std::holds_alternative<Trapezoid>(options.lagrangian) ? integrate(pair.L, pair.start, options)
                                                                 : integrate(pair.H, state_of(pair), options);
  };
  const Orbit trapezoid = run(Trapezoid{});
  const Orbit drift_kick = run(Splitting{"verlet"});
  // "verlet" may begin with a drift; kick, drift, kick written out.
  HamiltonianEvaluator H(pair.H);
  std::vector<double> z = systems::joined(state_of(pair)), gradient(4);
  for (std::size_t k = 0; k < trapezoid.steps(); ++k) {
    for (const int half : {0, 1}) {
      H.gradient(z.data(), gradient.data());
      z[2] -= 0.025 * gradient[0];
      z[3] -= 0.025 * gradient[1];
      if (half == 0) {
        z[0] += 0.05 * z[2];
        z[1] += 0.05 * z[3];
      }
    }
  }
  CHECK(systems::distance(systems::state_at(trapezoid, trapezoid.steps()), z) < 1e-13);
  CHECK(distance(trapezoid, drift_kick) < 1e-2);
}

TEST_CASE("quadratures of the action have their orders on problems that are not separable") {
  for (const Pair& pair : pairs()) {
    const double until = 2.4;
    const auto end = [&](SegmentLagrangian scheme, int steps) {
      return last_state(
          integrate(pair.L, pair.start,
                    {.lagrangian = std::move(scheme), .step = until / steps, .until = until, .levels = Levels::fixed}));
    };
    // By H, with another scheme: what is converged to is the motion of H.
    const std::vector<double> exact = last_state(integrate(
        pair.H, state_of(pair), {.lagrangian = Gauss{8}, .step = until / 96, .until = until, .levels = Levels::fixed}));
    for (const int points : {2, 3, 4}) {
      const int order = 2 * points - 2;
      const int coarsest = order == 2 ? 48 : order == 4 ? 16 : 8;
      std::vector<double> errors;
      for (int steps = coarsest; steps <= 4 * coarsest; steps *= 2) {
        errors.push_back(systems::distance(end(Lobatto{points}, steps), exact));
      }
      INFO(pair.name << ", " << points << " points: " << errors[0] << ", " << errors[1] << ", " << errors[2]);
      REQUIRE(errors.back() > 1e-13);
      for (std::size_t i = 1; i < errors.size(); ++i) {
        const double slope = std::log2(errors[i - 1] / errors[i]);
        CHECK(slope > order - 0.5);
        CHECK(slope < order + 1.0);
      }
    }
  }
}

TEST_CASE("variable levels of three quadratures keep the discrete energy to rounding") {
  for (const Pair& pair : pairs()) {
    for (const SegmentLagrangian& scheme :
         {SegmentLagrangian(Trapezoid{}), SegmentLagrangian(Lobatto{3}), SegmentLagrangian(Gauss{2})}) {
      const Orbit orbit = integrate(pair.L, pair.start,
                                    {.lagrangian = scheme,
                                     .step = 0.1,
                                     .until = 20.0,
                                     .potential = {.kind = StepPotentialChoice::Kind::automatic}});
      INFO(pair.name << " " << scheme.index() << ": " << orbit.message);
      REQUIRE(orbit.status == Status::success);
      CHECK(orbit.discrete_energy_deviation() <= 1e-13);
      CHECK(orbit.node_energy_deviation() > 1e-10);  // it is another number than H(z_k)
      const auto [least, most] = std::ranges::minmax(orbit.h);
      // At higher orders steps are nearly equal; equal ones would leave E off by p f' dh/h, 16e-4 · 1e-7 of its terms.
      CHECK(most > (std::holds_alternative<Trapezoid>(scheme) ? 1.001 : 1.0 + 1e-7) * least);
    }
  }
}

TEST_CASE("a step is the one that short steps lead to, not another solution of its equation far away") {
  // Newton's method, begun from the last step continued, ends for these at polynomials of velocities in the thousands.
  const Lagrangian lagrangian({"a", "b"}, "1.902*a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b) + 2*cos(a) + cos(b)");
  const std::vector<double> q = {-0.636477, 0.822278}, q_dot = {0.846629, -1.58278};
  for (const double h : {0.72, 0.74, 0.76, 0.78}) {
    const auto scheme =
        make_lagrangian_scheme(lagrangian, ActionQuadrature(ActionQuadrature::Points::gauss, 4), q, q_dot);
    const auto fine =
        make_lagrangian_scheme(lagrangian, ActionQuadrature(ActionQuadrature::Points::gauss, 4), q, q_dot);
    for (int step = 0; step < 3; ++step) {
      INFO("step " << step << " of " << h);
      REQUIRE(scheme->advance(h, 0.0) == Status::success);
      scheme->accept();
      for (int part = 0; part < 10; ++part) {
        REQUIRE(fine->advance(h / 10, 0.0) == Status::success);
        fine->accept();
      }
      for (std::size_t i = 0; i < 4; ++i) {
        // These are long steps: what they are off is seen, and is nothing beside what another solution is.
        CHECK(std::abs(scheme->state()[i] - fine->state()[i]) < 0.5);
      }
    }
  }
}

TEST_CASE("steps are taken where the motion changes in one of them more than in all before") {
  // Verlet's method with a step too long for it: from the third step on each is 10³ times the last, and then 10⁹.
  const Lagrangian lagrangian({"x"}, "x_dot^2/2 - x^4/4");
  constexpr double h = 1.7;
  double q = 1.0, p = 0.5;
  const auto scheme = make_lagrangian_scheme(lagrangian, ActionQuadrature(ActionQuadrature::Points::lobatto, 1),
                                             std::vector<double>{q}, std::vector<double>{p});
  const auto force = [](double x) { return -x * x * x; };
  double longest = 0.0;
  for (int step = 0; step < 8; ++step) {
    INFO("step " << step << " from " << q << ", " << p);
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    scheme->accept();
    const double middle = p + h / 2 * force(q);
    longest = std::max(longest, std::abs(h * middle) / std::max(1.0, std::abs(q)));
    q += h * middle;
    p = middle + h / 2 * force(q);
    // A few roundings of what is added.
    CHECK(std::abs(scheme->state()[0] - q) <= 1e-12 * std::abs(q));
    CHECK(std::abs(scheme->state()[1] - p) <= 1e-12 * std::abs(p));
    q = scheme->state()[0];
    p = scheme->state()[1];
  }
  CHECK(longest > 1e6);
}

TEST_CASE("a constant in L is a constant in its energies, and nothing else") {
  const Lagrangian plain({"q"}, "q_dot^2/2 + cos(q)");
  const Lagrangian lifted({"q"}, "q_dot^2/2 + cos(q) + c", {{"c", 1000.0}});
  const IntegrationOptions options{.step = 0.1, .until = 20.0};
  const Orbit a = integrate(plain, {.q = {0.0}, .q_dot = {1.5}}, options);
  const Orbit b = integrate(lifted, {.q = {0.0}, .q_dot = {1.5}}, options);
  CHECK(a.q == b.q);
  CHECK(a.q_dot == b.q_dot);
  CHECK(std::abs(b.energy[0] - (a.energy[0] - 1000.0)) < 1e-12);
  CHECK(std::abs(b.node_energy[0] - (a.node_energy[0] - 1000.0)) < 1e-12);
}

TEST_CASE("a Lagrangian may be a lambda") {
  const Lagrangian by_lambda(1, [](auto q, auto v) { return v[0] * v[0] / 2 + cos(q[0]); });
  const Orbit a = integrate(by_lambda, {.q = {0.0}, .q_dot = {1.5}}, {.step = 0.1, .until = 5.0});
  const Orbit b =
      integrate(Lagrangian({"q"}, "q_dot^2/2 + cos(q)"), {.q = {0.0}, .q_dot = {1.5}}, {.step = 0.1, .until = 5.0});
  CHECK(a.q == b.q);
}

TEST_CASE("a singular Lagrangian is refused with what it leaves free, and told of where it becomes singular") {
  using Catch::Matchers::Contains;
  const auto start = [](const Lagrangian& L, std::vector<double> q, std::vector<double> q_dot) {
    return integrate(L, {.q = std::move(q), .q_dot = std::move(q_dot)},
                     {.step = 0.05, .until = 5.0, .on_singular = OnSingular::stop});
  };
  // L of no kinetic energy in y, of the sum of velocities only, of first order, and homogeneous of degree 1.
  CHECK_THROWS_WITH(start(Lagrangian({"x", "y"}, "x_dot^2/2 - x*y - y^2"), {0.1, 0.2}, {0, 0}),
                    Contains("no second derivative by y_dot"));
  CHECK_THROWS_AS(start(Lagrangian({"x", "y"}, "(x_dot + y_dot)^2/2 - x^2 - y^2"), {0.1, 0.2}, {0, 0}),
                  SingularLagrangianError);
  CHECK_THROWS_WITH(start(Lagrangian({"x", "y"}, "(x_dot + y_dot)^2/2 - x^2 - y^2"), {0.1, 0.2}, {0, 0}),
                    Contains("x_dot") && Contains("y_dot") && Contains("-1"));
  CHECK_THROWS_WITH(start(Lagrangian({"q", "p"}, "p*q_dot - (p^2 + q^2)/2"), {0.1, 0.2}, {0, 0}),
                    Contains("by q_dot, p_dot") && Contains("state H"));
  CHECK_THROWS_AS(start(Lagrangian({"x", "y"}, "sqrt(x_dot^2 + y_dot^2)"), {0.1, 0.2}, {1, 2}),
                  SingularLagrangianError);
  CHECK_THROWS_WITH(start(Lagrangian({"q"}, "log(q) + q_dot^2"), {0.0}, {0.1}), Contains("not finite"));
  // Masses of very different sizes are none of this.
  CHECK_NOTHROW(
      start(Lagrangian({"x", "y"}, "1e-20*x_dot^2/2 + 1e12*y_dot^2/2 - 1e-20*x^2 - 1e12*y^2"), {0.1, 0.2}, {0, 0}));
  // q_dot = (1 - t)^2 comes to rest at t = 1, where the second derivative, 2 q_dot, changes its sign.
  const Orbit orbit = start(Lagrangian({"q"}, "q_dot^3/3 - q"), {0.0}, {1.0});
  CHECK(orbit.status != Status::success);
  CHECK_THAT(orbit.message, Contains("singular") || Contains("no velocities were found near q_dot"));
  CHECK(orbit.t.back() < 1.1);
}

TEST_CASE("the schemes that are not quadratures say so") {
  using Catch::Matchers::Contains;
  const Pair pair = henon_heiles();
  for (const SegmentLagrangian& scheme :
       {SegmentLagrangian(Forward{}), SegmentLagrangian(Splitting{}), SegmentLagrangian(Generating{})}) {
    CHECK_THROWS_WITH(integrate(pair.L, pair.start, {.lagrangian = scheme, .step = 0.1, .until = 1.0}),
                      Contains("midpoint, trapezoid, lobatto and gauss"));
  }
  for (const SegmentLagrangian& scheme : {SegmentLagrangian(Trapezoid{}), SegmentLagrangian(Lobatto{})}) {
    CHECK_THROWS_WITH(integrate(pair.H, state_of(pair), {.lagrangian = scheme, .step = 0.1, .until = 1.0}),
                      Contains("state the problem by its Lagrangian"));
  }
  CHECK_THROWS_WITH(integrate(pair.L, {.q = {0.1}, .q_dot = {0.1, 0.2}}, {.step = 0.1, .until = 1.0}),
                    Contains("1 coordinates and 2 velocities"));
}
