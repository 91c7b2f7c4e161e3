// The two-form ω = dθ⁺ is preserved by the two-step map on the full extended space (theory, section 2.3), and by the
// production map in its two forms; what the paper prints for it, and broken steps, are not.

#include <catch2/catch.hpp>

#include <limits>
#include <memory>

#include <rubato/ode/discrete_lagrangian.hpp>
#include <rubato/ode/tangent.hpp>
#include <rubato/variation/total_variation.hpp>

#include "pairs.hpp"

using namespace rubato;
using namespace pairs;
using systems::System;

namespace {

/// ω is preserved to this, relative, where the step condition is as small as rounding: theory asks that the tolerance
/// grow with it, since the tangent, with entries of order 1/(hΓ), does.
constexpr double preserved = 1e-9;

/// 4ε|H|/(h²|Γ|) at the middle of a segment.
double step_condition(const Hamiltonian& hamiltonian, const VectorXd& corners) {
  HamiltonianEvaluator evaluator(hamiltonian);
  const Index half = corners.size() / 2;
  const VectorXd z = 0.5 * (corners.segment(1, half - 1) + corners.tail(half - 1));
  const double h = corners[half] - corners[0];
  double energy = 0.0;
  const double gamma = evaluator.gamma(z.data(), energy);
  return 4.0 * std::numeric_limits<double>::epsilon() * std::abs(energy) / (h * h * std::abs(gamma));
}

double tolerance(const Hamiltonian& hamiltonian, const VectorXd& corners) {
  return preserved * std::max(1.0, step_condition(hamiltonian, corners) / 1e-12);
}

/// Two consecutive segments.
struct Pair {
  VectorXd first, second;
};

/// Three nodes of a midpoint orbit; `defect` in every component of the middle one.
struct Nodes {
  VectorXd exact, disturbed, guess;  // segments 01 as it is and with the defect, segment 12
};

Nodes make_nodes(const System& system, double defect) {
  constexpr std::size_t k = 3;
  const Orbit orbit = integrate(system.hamiltonian, system.initial,
                                {.step = system.step, .until = 1.0, .on_singular = OnSingular::stop});
  REQUIRE(orbit.steps() > k + 2);
  const auto z_0 = systems::state_at(orbit, k);
  auto z_1 = systems::state_at(orbit, k + 1);
  const auto z_2 = systems::state_at(orbit, k + 2);
  Nodes nodes{segment(orbit.t[k], z_0, orbit.t[k + 1], z_1), {}, segment(orbit.t[k + 1], z_1, orbit.t[k + 2], z_2)};
  double sign = 1.0;
  for (double& component : z_1) {
    component += sign * defect;  // neither along the orbit nor along J of it
    sign *= -0.7;
  }
  nodes.disturbed = segment(orbit.t[k], z_0, orbit.t[k + 1], z_1);
  return nodes;
}

/// The pair of segments whose first one is given, as an initial-value problem; z_2 by continuation in the defect, since
/// it moves by many times the defect where the step is nearly degenerate.
Pair initial_value_pair(DiscreteAction& action, const Nodes& nodes) {
  VectorXd second = nodes.guess;
  constexpr int parts = 8;
  for (int i = 0; i <= parts; ++i) {
    const double part = static_cast<double>(i) / parts;
    second = two_step(action, (1.0 - part) * nodes.exact + part * nodes.disturbed, second);
  }
  return {nodes.disturbed, second};
}

/// The pair of segments with nodes 0 and 2 given and node 1 between them, (t_1, z_1), stationary: for the forward 𝕃,
/// whose initial-value problem throws z_2 far off.
Pair boundary_value_pair(DiscreteAction& action, const Nodes& nodes) {
  const Index size = nodes.exact.size();
  const Index half = size / 2;
  Pair pair{nodes.disturbed, nodes.guess};
  pair.second.head(half) = pair.first.tail(half);
  VectorXd before(size), after(size);
  MatrixXd before_2(size, size), after_2(size, size);
  double last = INFINITY;
  for (int iteration = 0; iteration < 50; ++iteration) {
    action.gradient(as_span(pair.first), before);
    action.gradient(as_span(pair.second), after);
    action.hessian(as_span(pair.first), before_2);
    action.hessian(as_span(pair.second), after_2);
    const VectorXd correction = (before_2.bottomRightCorner(half, half) + after_2.topLeftCorner(half, half))
                                    .fullPivLu()
                                    .solve(before.tail(half) + after.head(half));
    pair.first.tail(half) -= correction;
    pair.second.head(half) -= correction;
    const double size_now = correction.norm();
    if (size_now < 1e-9 && size_now >= 0.5 * last) {
      return pair;
    }
    last = size_now;
  }
  return {pair.first, VectorXd::Constant(size, NAN)};
}

Pair make_pair(const System& system, const SegmentLagrangian& lagrangian, DiscreteAction& action, double defect) {
  const Nodes nodes = make_nodes(system, defect);
  const Pair pair = std::holds_alternative<Forward>(lagrangian) ? boundary_value_pair(action, nodes)
                                                                : initial_value_pair(action, nodes);
  REQUIRE(pair.second.allFinite());
  const Index half = pair.first.size() / 2;
  REQUIRE(pair.first[half] > pair.first[0]);
  REQUIRE(pair.second[half] > pair.second[0]);
  return pair;
}

struct Case {
  std::string name;
  System system;
  SegmentLagrangian lagrangian;
  double defect;
};

/// An 𝕃 of the user's: the midpoint one plus a term of its own, so that neither θ nor ω is that of the midpoint.
const char* const custom =
    "((p_0 + p_1)/2*(q_1 - q_0))/(t_1 - t_0) - ((p_0^2 + p_1^2)/4 - cos((q_0 + q_1)/2)) "
    "+ (t_1 - t_0)^2/10*(q_0^2 + p_0*q_1 + sin(p_1))";

std::vector<Case> cases() {
  const System henon_heiles = systems::henon_heiles();
  const System pendulum = systems::pendulum();
  return {{"midpoint, d_0 = 0", henon_heiles, Midpoint{}, 0.0},
          {"midpoint, d_0 != 0", henon_heiles, Midpoint{}, 1e-3},
          {"midpoint, pendulum, d_0 = 0", pendulum, Midpoint{}, 0.0},
          {"midpoint, pendulum, d_0 != 0", pendulum, Midpoint{}, 1e-3},
          {"forward, pendulum", pendulum, Forward{}, 0.0},
          {"forward, Henon-Heiles", henon_heiles, Forward{}, 0.0},
          {"custom, pendulum", pendulum, Custom{custom}, 0.0},
          {"custom, pendulum, disturbed", pendulum, Custom{custom}, 1e-4}};
}

/// ∂z_1/∂z_0 of the trapezoidal step z_1 = z_0 + ½h(f(z_0) + f(z_1)), which is no stationary point of an action here.
MatrixXd trapezoid_tangent(HamiltonianEvaluator& hamiltonian, const std::vector<double>& z_0, double h) {
  const auto size = static_cast<Index>(z_0.size());
  const auto step = [&](const VectorXd& from) -> VectorXd {
    const std::vector<double> start(from.data(), from.data() + size);
    std::vector<double> end = systems::runge_kutta(hamiltonian, start, h, 4);
    for (int iteration = 0; iteration < 100; ++iteration) {
      const auto f_0 = systems::velocity(hamiltonian, start);
      const auto f_1 = systems::velocity(hamiltonian, end);
      for (std::size_t i = 0; i < end.size(); ++i) {
        end[i] = start[i] + 0.5 * h * (f_0[i] + f_1[i]);
      }
    }
    return Eigen::Map<const VectorXd>(end.data(), size);
  };
  return difference_quotient(step, Eigen::Map<const VectorXd>(z_0.data(), size), 1e-3);
}

/// α∧β as an antisymmetric matrix, for one-forms as rows.
MatrixXd wedge(const VectorXd& a, const VectorXd& b) {
  return a * b.transpose() - b * a.transpose();
}

/// dp_k∧dq_{k+1} on (t_0, z_0, t_1, z_1), n = degrees of freedom.
MatrixXd mixed_form(Index n, bool later_momentum) {
  const Index size = 2 * (2 * n + 1);
  MatrixXd form = MatrixXd::Zero(size, size);
  for (Index i = 0; i < n; ++i) {
    const Index p = later_momentum ? size - n + i : 1 + n + i;
    const Index q = later_momentum ? 1 + i : 2 * n + 2 + i;
    form += wedge(VectorXd::Unit(size, p), VectorXd::Unit(size, q));
  }
  return form;
}

/// dE of a segment, E = ∂A/∂t_0, as a row of the second variation.
VectorXd energy_differential(DiscreteAction& action, const VectorXd& corners) {
  MatrixXd hessian(corners.size(), corners.size());
  action.hessian(as_span(corners), hessian);
  return hessian.row(0);
}

/// (3.18) read with dE for H: ½(dp_k∧dq_{k+1} + dp_{k+1}∧dq_k) - dE∧½(dt_k + dt_{k+1}).
MatrixXd printed_form(DiscreteAction& action, const VectorXd& corners) {
  const Index size = corners.size();
  const Index n = (size / 2 - 1) / 2;
  const VectorXd dt = 0.5 * (VectorXd::Unit(size, 0) + VectorXd::Unit(size, size / 2));
  return 0.5 * (mixed_form(n, false) + mixed_form(n, true)) - wedge(energy_differential(action, corners), dt);
}

}  // namespace

TEST_CASE("the two-step map preserves the two-form dtheta+ on the full extended space") {
  for (const Case& c : cases()) {
    INFO(c.name);
    const auto action = make_action(c.system.hamiltonian, c.lagrangian);
    const Pair pair = make_pair(c.system, c.lagrangian, *action, c.defect);
    const MatrixXd tangent = two_step_tangent(*action, as_span(pair.first), as_span(pair.second));
    const MatrixXd before = two_form(*action, as_span(pair.first));
    const MatrixXd after = two_form(*action, as_span(pair.second));
    const double allowed = tolerance(c.system.hamiltonian, pair.second);
    const double defect = preservation_defect(tangent, before, after);
    INFO("defect " << defect << ", step condition " << step_condition(c.system.hamiltonian, pair.second)
                   << ", largest entry of the tangent " << tangent.cwiseAbs().maxCoeff());
    CHECK(defect <= allowed);

    // Twins. The tangent of a map that lets E slip with z: E_1 = E_0 + δ(1e-4 q_1).
    MatrixXd slipped = tangent;
    MatrixXd hessian(before.rows(), before.cols());
    action->hessian(as_span(pair.second), hessian);
    const Index half = before.rows() / 2;
    const VectorXd moved = hessian.topRightCorner(half, half).fullPivLu().solve(1e-4 * VectorXd::Unit(half, 0));
    slipped.block(half, half + 1, half, 1) += moved;
    CHECK(preservation_defect(slipped, before, after) > 100.0 * allowed);
    // And the right tangent with the form of another place.
    CHECK(preservation_defect(tangent, before, 1.0001 * after) > 100.0 * allowed);
  }
}

TEST_CASE("what the paper prints for the two-form is not preserved") {
  // (3.18) for the midpoint 𝕃 and dp_k∧dq_{k+1} after (3.24) for the forward one; theory, section 2.3.
  const System system = systems::henon_heiles();
  const auto midpoint = make_action(system.hamiltonian, Midpoint{});
  const Pair pair = make_pair(system, Midpoint{}, *midpoint, 1e-3);
  const MatrixXd tangent = two_step_tangent(*midpoint, as_span(pair.first), as_span(pair.second));
  const double of_midpoint =
      preservation_defect(tangent, printed_form(*midpoint, pair.first), printed_form(*midpoint, pair.second));
  CHECK(of_midpoint > 1e-3);

  const System pendulum = systems::pendulum();
  const auto forward = make_action(pendulum.hamiltonian, Forward{});
  const Pair forward_pair = make_pair(pendulum, Forward{}, *forward, 0.0);
  const MatrixXd forward_tangent =
      two_step_tangent(*forward, as_span(forward_pair.first), as_span(forward_pair.second));
  const double of_forward = preservation_defect(forward_tangent, mixed_form(1, false), mixed_form(1, false));
  CHECK(of_forward > 1e-3);
}

TEST_CASE("the midpoint two-form has the explicit expression of theory, section 2.3") {
  // ω = ½(dp_k∧dq_{k+1} + dp_{k+1}∧dq_k) - dE∧½(dt_k + dt_{k+1}) + ¼ d(∇Φ·dδ), Φ = -hH(z̄): exact to rounding.
  const System system = systems::henon_heiles();
  const auto action = make_action(system.hamiltonian, Midpoint{});
  const VectorXd corners = make_pair(system, Midpoint{}, *action, 1e-2).first;
  const Index size = corners.size();
  const Index half = size / 2;
  const double h = corners[half] - corners[0];
  HamiltonianEvaluator evaluator(system.hamiltonian);
  const VectorXd z = 0.5 * (corners.segment(1, half - 1) + corners.tail(half - 1));
  VectorXd gradient(half - 1);
  MatrixXd hessian(half - 1, half - 1);
  evaluator.hessian(z.data(), gradient.data(), hessian.data());
  MatrixXd last = MatrixXd::Zero(size, size);
  const VectorXd dh = VectorXd::Unit(size, half) - VectorXd::Unit(size, 0);
  const auto dz = [&](Index i, double sign) -> VectorXd {  // dδ_i for sign -1, 2 dz̄_i for +1
    return VectorXd::Unit(size, half + 1 + i) + sign * VectorXd::Unit(size, 1 + i);
  };
  for (Index i = 0; i < half - 1; ++i) {
    last -= gradient[i] * wedge(dh, dz(i, -1.0));
    for (Index j = 0; j < half - 1; ++j) {
      last -= h * hessian(i, j) * wedge(0.5 * dz(j, 1.0), dz(i, -1.0));
    }
  }
  const MatrixXd explicit_form = printed_form(*action, corners) + 0.25 * last;
  CHECK((explicit_form - two_form(*action, as_span(corners))).cwiseAbs().maxCoeff() < 1e-14);
  CHECK((printed_form(*action, corners) - two_form(*action, as_span(corners))).cwiseAbs().maxCoeff() > 1e-3);
}

TEST_CASE("the tangent of the two-step map agrees with differences of the step itself") {
  // Central differences extrapolated once: error (ε/L)⁴ with L the length over which T varies, hΓ-small near the fold,
  // and rounding 1e-16·|T|/ε. At ε = 1e-4 both are below 1e-6 of the largest entry; a wrong entry shows as 1e-3 and up.
  for (const Case& c : cases()) {
    INFO(c.name);
    const auto action = make_action(c.system.hamiltonian, c.lagrangian);
    const Pair pair = make_pair(c.system, c.lagrangian, *action, c.defect);
    const MatrixXd tangent = two_step_tangent(*action, as_span(pair.first), as_span(pair.second));
    const MatrixXd differences =
        difference_quotient([&](const VectorXd& first) { return two_step(*action, first, pair.second); }, pair.first,
                            std::holds_alternative<Forward>(c.lagrangian) ? 1e-6 : 1e-4);
    const double largest = tangent.cwiseAbs().maxCoeff();
    CHECK((tangent - differences).cwiseAbs().maxCoeff() <= 1e-5 * largest);
    MatrixXd wrong = tangent;
    wrong.col(1) += 1e-4 * largest * VectorXd::Unit(wrong.rows(), wrong.rows() - 1);
    CHECK((wrong - differences).cwiseAbs().maxCoeff() > 1e-5 * largest);
  }
}

TEST_CASE("the tangent of the midpoint two-step map agrees with the formulas of theory, section 2.3") {
  const System system = systems::henon_heiles();
  const auto action = make_action(system.hamiltonian, Midpoint{});
  for (const double defect : {0.0, 1e-3}) {
    const Pair pair = make_pair(system, Midpoint{}, *action, defect);
    const Index half = pair.first.size() / 2;
    const Index n = half - 1;
    HamiltonianEvaluator evaluator(system.hamiltonian);
    struct Middle {
      double h;
      VectorXd gradient, f;
      MatrixXd jacobian;  // JH''
    };
    const auto middle = [&](const VectorXd& corners) {
      const VectorXd z = 0.5 * (corners.segment(1, n) + corners.tail(n));
      Middle m{corners[half] - corners[0], VectorXd(n), VectorXd(n), MatrixXd(n, n)};
      MatrixXd hessian(n, n);
      evaluator.hessian(z.data(), m.gradient.data(), hessian.data());
      MatrixXd J = MatrixXd::Zero(n, n);
      J.topRightCorner(n / 2, n / 2).setIdentity();
      J.bottomLeftCorner(n / 2, n / 2) = -MatrixXd::Identity(n / 2, n / 2);
      m.f = J * m.gradient;
      m.jacobian = J * hessian;
      return m;
    };
    const Middle m0 = middle(pair.first);
    const Middle m1 = middle(pair.second);
    const MatrixXd I = MatrixXd::Identity(n, n);
    MatrixXd expected = MatrixXd::Zero(2 * half, 2 * half);
    expected.topRightCorner(half, half).setIdentity();
    for (Index column = 0; column < 2 * half; ++column) {
      const VectorXd v = VectorXd::Unit(2 * half, column);
      const VectorXd dz_0 = v.segment(1, n);
      const VectorXd dz_1 = v.tail(n);
      const VectorXd dd_0 =
          (I - 0.5 * m0.h * m0.jacobian) * dz_1 - (I + 0.5 * m0.h * m0.jacobian) * dz_0 - m0.f * (v[half] - v[0]);
      const double dE = 0.5 * m0.gradient.dot(dz_0 + dz_1);
      MatrixXd left = MatrixXd::Zero(n + 1, n + 1);
      left.topLeftCorner(n, n) = I - 0.5 * m1.h * m1.jacobian;
      left.topRightCorner(n, 1) = -m1.f;
      left.bottomLeftCorner(1, n) = 0.5 * m1.gradient.transpose();
      VectorXd right(n + 1);
      right << (I + 0.5 * m1.h * m1.jacobian) * dz_1 - dd_0, dE - 0.5 * m1.gradient.dot(dz_1);
      const VectorXd solution = left.fullPivLu().solve(right);
      expected(half, column) = v[half] + solution[n];
      expected.block(half + 1, column, n, 1) = solution.head(n);
    }
    const MatrixXd tangent = two_step_tangent(*action, as_span(pair.first), as_span(pair.second));
    // Two ways to solve the same nearly degenerate system: rounding times its condition, at most 1e4 here.
    CHECK((tangent - expected).cwiseAbs().maxCoeff() <= 1e-11 * tangent.cwiseAbs().maxCoeff());
    CHECK(tangent.cwiseAbs().maxCoeff() > 1.0);
  }
}

TEST_CASE("the production map preserves dp^dq - dE^dt, and dp^dq at fixed E") {
  for (const System& system : {systems::henon_heiles(), systems::pendulum(), systems::non_separable()}) {
    INFO(system.name);
    const Orbit orbit = integrate(system.hamiltonian, system.initial,
                                  {.step = system.step, .until = 10.0, .on_singular = OnSingular::stop});
    HamiltonianEvaluator evaluator(system.hamiltonian);
    const std::size_t n = system.hamiltonian.degrees_of_freedom();
    const auto size = static_cast<Index>(2 * n);
    const MatrixXd canonical = canonical_two_form(n);
    const MatrixXd extended = extended_two_form(n);
    for (std::size_t k = 0; k < orbit.steps(); k += 7) {
      const auto z_0 = systems::state_at(orbit, k);
      const auto z_1 = systems::state_at(orbit, k + 1);
      const double allowed = preserved * std::max(1.0, orbit.condition[k] / 1e-12);
      const MatrixXd fixed = fixed_level_tangent(evaluator, z_0, z_1, orbit.h[k]);
      const MatrixXd variable = variable_level_tangent(evaluator, z_0, z_1, orbit.h[k]);
      const MatrixXd at_fixed_energy = variable.topLeftCorner(size, size);
      CHECK(preservation_defect(fixed, canonical, canonical) <= allowed);
      CHECK(preservation_defect(variable, extended, extended) <= allowed);
      CHECK(preservation_defect(at_fixed_energy, canonical, canonical) <= allowed);

      // Twins: ∂h/∂E left out; E allowed to slip with z; ∂h/∂z put in for half of z only; a trapezoidal step.
      MatrixXd rigid = variable;
      rigid(size, size + 1) = 0.0;
      rigid.block(0, size + 1, size, 1).setZero();
      CHECK(preservation_defect(rigid, extended, extended) > 100.0 * allowed);
      MatrixXd slipping = variable;
      slipping.col(0) += 1e-4 * variable.col(size + 1);
      CHECK(preservation_defect(slipping, extended, extended) > 100.0 * allowed);
      if (n > 1) {
        MatrixXd part = at_fixed_energy;
        part.col(0) = fixed.col(0);
        CHECK(preservation_defect(part, canonical, canonical) > 100.0 * allowed);
      }
      const MatrixXd trapezoid = trapezoid_tangent(evaluator, z_0, orbit.h[k]);
      CHECK(preservation_defect(trapezoid, canonical, canonical) > 100.0 * allowed);
    }
  }
}

TEST_CASE("the tangents of the production map agree with differences of the step itself") {
  const System system = systems::henon_heiles();
  HamiltonianEvaluator evaluator(system.hamiltonian);
  const auto action = make_action(system.hamiltonian, Midpoint{});
  const Orbit orbit = integrate(system.hamiltonian, system.initial,
                                {.step = system.step, .until = 2.0, .on_singular = OnSingular::stop});
  const auto z_0 = systems::state_at(orbit, 5);
  const auto z_1 = systems::state_at(orbit, 6);
  const auto size = static_cast<Index>(z_0.size());
  VectorXd start(size + 2);
  start << Eigen::Map<const VectorXd>(z_0.data(), size), orbit.t[5], orbit.energy[5];
  // (z, t, E) ↦ (z_1, t + h, E), by Newton on h with the fixed-level step, by fixed-point iteration, inside.
  const auto step = [&](const VectorXd& from) -> VectorXd {
    const std::vector<double> z(from.data(), from.data() + size);
    double h = orbit.h[5];
    std::vector<double> end = z_1;
    std::vector<double> centre;
    for (int newton = 0; newton < 20; ++newton) {
      for (int iteration = 0; iteration < 60; ++iteration) {
        centre = systems::middle(z, end);
        const auto f = systems::velocity(evaluator, centre);
        for (std::size_t i = 0; i < end.size(); ++i) {
          end[i] = z[i] + h * f[i];
        }
      }
      double energy = 0.0;
      const double gamma = evaluator.gamma(centre.data(), energy);
      h += (energy - from[size + 1]) / (0.25 * h * gamma);  // dE/dh = -(h/4)Γ to leading order
    }
    VectorXd image(size + 2);
    image << Eigen::Map<const VectorXd>(end.data(), size), from[size] + h, from[size + 1];
    return image;
  };
  const MatrixXd differences = difference_quotient(step, start, 1e-5);
  const MatrixXd tangent = variable_level_tangent(evaluator, z_0, z_1, orbit.h[5]);
  const double largest = tangent.cwiseAbs().maxCoeff();
  CHECK((tangent - differences).cwiseAbs().maxCoeff() <= 1e-5 * largest);
  CHECK(
      (tangent.topLeftCorner(size, size) - fixed_level_tangent(evaluator, z_0, z_1, orbit.h[5])).cwiseAbs().maxCoeff() >
      1e-5 * largest);
}

TEST_CASE("tangents refuse what is no step") {
  const System system = systems::pendulum();
  HamiltonianEvaluator evaluator(system.hamiltonian);
  const std::vector<double> z = {0.0, 1.9};
  const std::vector<double> short_z = {0.0};
  CHECK_THROWS_AS(fixed_level_tangent(evaluator, z, short_z, 0.1), std::invalid_argument);
  CHECK_THROWS_AS(variable_level_tangent(evaluator, z, z, 0.0), std::invalid_argument);
  CHECK_THROWS_AS(variable_level_tangent(evaluator, z, z, NAN), std::invalid_argument);
  const std::vector<double> nowhere = {INFINITY, 0.0};
  CHECK_THROWS_AS(fixed_level_tangent(evaluator, nowhere, z, 0.1), std::invalid_argument);
  CHECK_NOTHROW(fixed_level_tangent(evaluator, z, z, 0.1));
}
