// H has no preferred zero: a constant added to H, or to 𝕃, changes no step.

#include <catch2/catch.hpp>

#include <cmath>
#include <string>
#include <vector>

#include <rubato/ode/first_step.hpp>
#include <rubato/ode/integrate.hpp>

using namespace rubato;

namespace {

struct Problem {
  std::string H;
  std::vector<std::string> q, p;
  InitialState initial;
  double range;  ///< about how far the terms of H move along the orbit

  [[nodiscard]] Hamiltonian raised(double constant) const { return {q, p, H + " + C", {{"C", constant}}}; }
  [[nodiscard]] Hamiltonian as_written() const { return {q, p, H}; }
};

/// Along the first, and the second, Γ keeps its sign and E is 0; along the third it changes sign again and again.
const Problem pendulum = {"p^2/2 - cos(q)", {"q"}, {"p"}, {.q = {0.0}, .p = {std::sqrt(2.0)}}, 1.0};
const Problem parabola = {
    "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)", {"x", "y"}, {"u", "v"}, {.q = {1.0, 0.0}, .p = {0.3, 1.0}}, 1.0};
const Problem rotation = {"p^2/2 - cos(q)", {"q"}, {"p"}, {.q = {0.0}, .p = {2.2}}, 2.0};

bool same_orbit(const Orbit& a, const Orbit& b) {
  return a.h == b.h && a.q == b.q && a.p == b.p && a.condition == b.condition && a.off_law == b.off_law &&
         a.gamma == b.gamma && a.status == b.status;
}

/// The largest |(E_k of b) - (E_k of a) - constant|.
double shift_error(const Orbit& a, const Orbit& b, double constant) {
  double result = 0.0;
  for (std::size_t k = 0; k < a.energy.size(); ++k) {
    result = std::max(result, std::abs(b.energy[k] - a.energy[k] - constant));
  }
  return result;
}

}  // namespace

TEST_CASE("a constant added to H changes no step: every scheme, every choice of levels") {
  const std::vector<SegmentLagrangian> lagrangians = {
      Midpoint{}, Generating{.order = 2}, Generating{.order = 4},
      Generating{.order = 1, .darboux = DarbouxType::euler_a},
      Generating{.order = 3, .darboux = Eigen::MatrixXd(Eigen::MatrixXd::Identity(2, 2))}};
  for (const Problem& problem : {pendulum, rotation}) {
    for (const SegmentLagrangian& lagrangian : lagrangians) {
      for (const Levels levels : {Levels::variable, Levels::fixed}) {
        for (const OnSingular on_singular : {OnSingular::plain, OnSingular::stop}) {
          const IntegrationOptions options{.lagrangian = lagrangian,
                                           .step = 0.1,
                                           .until = 6.0,
                                           .levels = levels,
                                           .on_singular = on_singular,
                                           .max_steps = 100};
          const Orbit orbit = integrate(problem.as_written(), problem.initial, options);
          for (const double constant : {1e3 * problem.range, -1e3 * problem.range, 0.3}) {
            INFO(problem.H << ", lagrangian " << lagrangian.index() << ", constant " << constant);
            const Orbit raised = integrate(problem.raised(constant), problem.initial, options);
            CHECK((same_orbit(orbit, raised) || (levels == Levels::fixed && orbit.q == raised.q)));
            CHECK(shift_error(orbit, raised, constant) <= 2.3e-16 * std::abs(constant));
          }
        }
      }
    }
  }
}

TEST_CASE("a constant added to H changes no step of an orbit with E = 0 in space, nor the choice of the first step") {
  const IntegrationOptions options{.step = 0.05, .until = 10.0};
  const Orbit orbit = integrate(parabola.as_written(), parabola.initial, options);
  const Orbit raised = integrate(parabola.raised(1e3), parabola.initial, options);
  CHECK(same_orbit(orbit, raised));
  for (const Problem& problem : {pendulum, rotation}) {
    const IntegrationOptions search{.until = 20.0};
    const double step = choose_first_step(problem.as_written(), problem.initial, search, 1e-4);
    CHECK(choose_first_step(problem.raised(1e3), problem.initial, search, 1e-4) == step);
    // Where E is 0 as elsewhere: a deviation of 1e-4 of 3 % of the terms, or of E, is h²Γ/8 with Γ about 1.
    CHECK(step > 0.003);
    CHECK(step < 0.1);
  }
}

TEST_CASE("a constant added to a discrete Lagrangian changes no step") {
  const std::string L = "(p_0 + p_1)/2*(q_1 - q_0)/(t_1 - t_0) - ((p_0 + p_1)/2)^2/2 + cos((q_0 + q_1)/2)";
  const IntegrationOptions options{.lagrangian = Custom{.L = L}, .step = 0.1, .until = 6.0};
  const Orbit orbit = integrate(pendulum.as_written(), pendulum.initial, options);
  REQUIRE(orbit.status == Status::success);
  for (const double constant : {1e3, -7.0}) {
    IntegrationOptions raised_options = options;
    raised_options.lagrangian = Custom{.L = L + " + C", .parameters = {{"C", constant}}};
    const Orbit raised = integrate(pendulum.as_written(), pendulum.initial, raised_options);
    CHECK(orbit.h == raised.h);
    CHECK(orbit.q == raised.q);
    CHECK(shift_error(orbit, raised, -constant) <= 2.3e-16 * std::abs(constant));
  }
}

TEST_CASE("the twin: a constant that H hides in its terms is felt, as the rounding it makes") {
  const IntegrationOptions options{.step = 0.1, .until = 6.0};
  const Orbit orbit = integrate(pendulum.as_written(), pendulum.initial, options);
  const Hamiltonian hidden(pendulum.q, pendulum.p, "p^2/2 - cos(q) + 1000*(sin(q)^2 + cos(q)^2)");
  const Orbit felt = integrate(hidden, pendulum.initial, options);
  REQUIRE(felt.status == Status::success);
  CHECK(felt.h != orbit.h);
  // And the step condition says so: a thousand times the rounding.
  CHECK(felt.condition[10] > 100.0 * orbit.condition[10]);
}

TEST_CASE("the step condition is what is left of the level equation, and rounding, by |h dE/dh|") {
  const IntegrationOptions options{.step = 0.1, .until = 50.0};
  OrbitIntegrator integrator(pendulum.as_written(), pendulum.initial, options);
  while (!integrator.finished()) {
    const StepReport report = integrator.step();
    REQUIRE(report.status == Status::success);
    const double left = std::abs(report.energy - report.target) + integrator.levels().energy_rounding();
    REQUIRE(report.condition == Approx(left / std::abs(report.h * report.slope)).epsilon(1e-12));
    // cos(q) and p²/2 are of size 1: some ten roundings of 1e-16.
    REQUIRE(integrator.levels().energy_rounding() < 1e-14);
    REQUIRE(integrator.levels().energy_rounding() > 1e-17);
  }
}

TEST_CASE("the error of h is no more than the step condition, and not far less") {
  // The same step in long double: E(h) = H at the middle of the midpoint rule's step, from the state that was stored.
  const IntegrationOptions options{.step = 0.05, .until = 100.0, .on_singular = OnSingular::plain};
  OrbitIntegrator integrator(rotation.as_written(), rotation.initial, options);
  std::vector<double> ratios;
  double E = std::nan("");
  while (!integrator.finished()) {
    const long double q = integrator.q()[0], p = integrator.p()[0];
    const StepReport report = integrator.step();
    REQUIRE(report.status == Status::success);
    if (report.off_law) {
      continue;
    }
    if (std::isnan(E)) {
      E = report.energy;  // the first step: its h was given
      continue;
    }
    const auto energy_of = [&](long double h) {
      long double Q = q + h * p / 2, P = p;
      for (int i = 0; i < 200; ++i) {
        P = p - h / 2 * std::sin(Q);
        Q = q + h / 2 * P;
      }
      return P * P / 2 - std::cos(Q);
    };
    long double h = report.h;
    for (int i = 0; i < 4; ++i) {
      const long double d = 1e-5L * h;
      h -= (energy_of(h) - E) * 2 * d / (energy_of(h + d) - energy_of(h - d));
    }
    const double error = static_cast<double>(std::abs((h - report.h) / h));
    REQUIRE(error <= report.condition);
    ratios.push_back(error / report.condition);
  }
  std::ranges::sort(ratios);
  REQUIRE(ratios.size() > 500);
  CHECK(ratios[ratios.size() / 2] > 0.01);
}
