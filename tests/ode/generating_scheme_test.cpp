// Schemes from generating functions: their orders, what they reproduce, their laws, and what they refuse.
#include <catch2/catch.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <rubato/formula/taylor.hpp>
#include <rubato/ode/generating_function.hpp>
#include <rubato/ode/generating_scheme.hpp>
#include <rubato/ode/integrate.hpp>
#include <rubato/ode/taylor_code.hpp>

namespace {

using namespace rubato;
using Eigen::Index;
using Eigen::MatrixXd;
using State = std::vector<double>;

constexpr double epsilon = std::numeric_limits<double>::epsilon();

Hamiltonian henon_heiles() {
  return Hamiltonian({"x", "y"}, {"u", "v"}, "(x^2 + y^2 + u^2 + v^2)/2 + x^2*y - y^3/3");
}
InitialState henon_heiles_start() {
  return {.q = {0.1, 0.2}, .p = {0.35, -0.1}};
}
Hamiltonian kepler() {
  return Hamiltonian({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2 + y^2)");
}
InitialState kepler_start(double e) {
  return {.q = {1 - e, 0}, .p = {0, std::sqrt((1 + e) / (1 - e))}};
}
/// Neither separable nor polynomial.
Hamiltonian non_separable() {
  return Hamiltonian({"q"}, {"p"}, "(1 + p^2)*(2 - cos(q))/2 + sin(q)*p/4");
}

State joined(const InitialState& start) {
  State z = start.q;
  z.insert(z.end(), start.p.begin(), start.p.end());
  return z;
}

/// By Taylor steps of order 25 and length at most 0.05: exact to rounding.
State exact_flow(const Hamiltonian& hamiltonian, State z, double time) {
  formula::TaylorFlow flow(flow_code(hamiltonian), 25);
  const int steps = static_cast<int>(std::ceil(std::abs(time) / 0.05));
  for (int k = 0; k < steps; ++k) {
    REQUIRE(flow(z) == Status::success);
    flow.evaluate(time / steps, z);
  }
  return z;
}

double distance(const State& a, const State& b) {
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    worst = std::max(worst, std::abs(a[i] - b[i]));
  }
  return worst;
}

State last_state(const Orbit& orbit) {
  State z(orbit.q_at(orbit.steps()).begin(), orbit.q_at(orbit.steps()).end());
  z.insert(z.end(), orbit.p_at(orbit.steps()).begin(), orbit.p_at(orbit.steps()).end());
  return z;
}

Orbit run(const Hamiltonian& hamiltonian, const InitialState& start, Generating generating, double step, double until,
          Levels levels = Levels::fixed) {
  // The law of the generating function's own energy: no step potential is chosen.
  return integrate(hamiltonian, start,
                   {.lagrangian = std::move(generating),
                    .step = step,
                    .until = until,
                    .levels = levels,
                    .on_singular = OnSingular::plain});
}

/// Error at the end of a run against the exact flow there.
double error_of(const Hamiltonian& hamiltonian, const InitialState& start, const Generating& generating, double step,
                double until, Levels levels = Levels::fixed) {
  const Orbit orbit = run(hamiltonian, start, generating, step, until, levels);
  REQUIRE(orbit.status == Status::success);
  return distance(last_state(orbit), exact_flow(hamiltonian, joined(start), orbit.t.back()));
}

/// Least-squares slope of log(error) over log(step).
double slope(const std::vector<double>& steps, const std::vector<double>& errors) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  const auto n = static_cast<double>(steps.size());
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const double x = std::log(steps[i]);
    const double y = std::log(errors[i]);
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

struct OrderCase {
  DarbouxType type;
  int order;
  double coarsest;  ///< its error is small, and that of a step 0.5 times as long still well above rounding
};

constexpr OrderCase order_cases[] = {
    {DarbouxType::midpoint, 2, 0.05}, {DarbouxType::midpoint, 4, 0.2},  {DarbouxType::midpoint, 6, 0.3},
    {DarbouxType::midpoint, 8, 0.4},  {DarbouxType::midpoint, 10, 0.5}, {DarbouxType::euler_a, 1, 0.01},
    {DarbouxType::euler_a, 2, 0.05},  {DarbouxType::euler_a, 3, 0.04},  {DarbouxType::euler_a, 4, 0.15},
    {DarbouxType::euler_b, 1, 0.01},  {DarbouxType::euler_b, 2, 0.05},  {DarbouxType::euler_b, 3, 0.04},
    {DarbouxType::euler_b, 4, 0.15}};

}  // namespace

TEST_CASE("orders of the schemes, with fixed levels") {
  for (const auto& [hamiltonian, start] :
       {std::pair{henon_heiles(), henon_heiles_start()}, {non_separable(), InitialState{.q = {0.4}, .p = {0.6}}}}) {
    for (const OrderCase& c : order_cases) {
      std::vector<double> steps, errors;
      for (const double factor : {1.0, 0.84, 0.71, 0.6, 0.5}) {
        steps.push_back(c.coarsest * factor);
        steps.back() = 4.0 / std::round(4.0 / steps.back());  // so that all runs end at t = 4
        errors.push_back(error_of(hamiltonian, start, {.order = c.order, .darboux = c.type}, steps.back(), 4.0));
      }
      INFO("type " << int(c.type) << ", order " << c.order << ", errors from " << errors.front() << " to "
                   << errors.back());
      REQUIRE(errors.back() > 1e3 * epsilon);
      CHECK(slope(steps, errors) == Approx(c.order).margin(0.35));
    }
  }
}

TEST_CASE("orders of the schemes, with variable levels") {
  // On arcs where φ^(s+1) keeps its sign: a whole revolution for F = 0 at orders 2 to 10 and e = 0.1, and for the Euler
  // types the way out between pericentre and apocentre, at both of which φ² = -¼fᵀFf vanishes. Runs end at the first
  // level past the end of the arc, which moves by up to a step: hence the wide margin, and still narrower than half an
  // order.
  const State pericentre = joined(kepler_start(0.1));
  const State way_out = exact_flow(kepler(), joined(kepler_start(0.3)), 0.5);
  struct Case {
    DarbouxType type;
    int order;
    double coarsest;
  };
  constexpr Case cases[] = {
      {DarbouxType::midpoint, 2, 0.05}, {DarbouxType::midpoint, 4, 0.12}, {DarbouxType::midpoint, 6, 0.2},
      {DarbouxType::midpoint, 8, 0.28}, {DarbouxType::midpoint, 10, 0.4}, {DarbouxType::euler_a, 1, 0.008},
      {DarbouxType::euler_a, 2, 0.02},  {DarbouxType::euler_a, 3, 0.03},  {DarbouxType::euler_a, 4, 0.04},
      {DarbouxType::euler_b, 1, 0.008}, {DarbouxType::euler_b, 2, 0.02},  {DarbouxType::euler_b, 3, 0.03},
      {DarbouxType::euler_b, 4, 0.04}};
  for (const Case& c : cases) {
    const State& z = c.type == DarbouxType::midpoint ? pericentre : way_out;
    const InitialState start{.q = {z[0], z[1]}, .p = {z[2], z[3]}};
    const double until = c.type == DarbouxType::midpoint ? 6.0 : 1.2;
    std::vector<double> steps, errors;
    double condition = 0.0;
    for (const double factor : {1.0, 0.84, 0.71, 0.6, 0.5}) {
      steps.push_back(c.coarsest * factor);
      const Orbit orbit =
          run(kepler(), start, {.order = c.order, .darboux = c.type}, steps.back(), until, Levels::variable);
      REQUIRE(orbit.status == Status::success);
      CHECK(std::ranges::none_of(orbit.off_law, [](auto off_law) { return off_law != 0; }));
      errors.push_back(distance(last_state(orbit), exact_flow(kepler(), z, orbit.t.back())));
      condition = std::max(condition, std::ranges::max(orbit.condition));
    }
    INFO("type " << int(c.type) << ", order " << c.order << ", errors from " << errors.front() << " to "
                 << errors.back() << ", step condition " << condition);
    REQUIRE(errors.back() > 1e3 * epsilon);
    CHECK(slope(steps, errors) == Approx(c.order).margin(0.45));
    CHECK(condition < 1e-6);  // beyond, a run warns
  }
}

TEST_CASE("where the step condition bites at order 10") {
  // It grows as h^-10: from 1.4e-8 at 0.2 to the limit of 1e-2 where a run stops, at h = 0.2·(1.4e-6)^(1/10) = 0.05.
  const auto attempt = [](double step) {
    return integrate(
        kepler(), kepler_start(0.1),
        {.lagrangian = Generating{.order = 10}, .step = step, .until = 1.0, .on_singular = OnSingular::stop});
  };
  const Orbit coarse = attempt(0.2);
  CHECK(coarse.status == Status::success);
  CHECK(std::ranges::max(coarse.condition) < 1e-6);
  CHECK(std::ranges::max(attempt(0.1).condition) > 1e-6);
  CHECK(attempt(0.04).status == Status::ill_conditioned);
}

TEST_CASE("an odd order with F = 0 is the next even one") {
  const auto at = [](int order) {
    return last_state(run(henon_heiles(), henon_heiles_start(), {.order = order}, 0.2, 2.0));
  };
  CHECK(at(3) == at(4));
  CHECK(at(4) != at(5));
}

TEST_CASE("order 2 with F = 0 is the midpoint rule") {
  for (const Levels levels : {Levels::fixed, Levels::variable}) {
    const InitialState start = kepler_start(0.3);
    const Orbit own = run(kepler(), start, {.order = 2}, 0.05, 2.0, levels);
    const Orbit midpoint =
        integrate(kepler(), start, {.step = 0.05, .until = 2.0, .levels = levels, .on_singular = OnSingular::plain});
    REQUIRE(own.steps() == midpoint.steps());
    // Rounding of 40 steps, each solved to stagnation; with variable levels its effect on h, the step condition
    // (1e-11 here), enters through the state's velocity.
    const double tolerance = levels == Levels::fixed ? 100 * epsilon : 1e-10;
    CHECK(distance(last_state(own), last_state(midpoint)) <= tolerance);
    CHECK(own.gamma.front() == Approx(midpoint.gamma.front()).epsilon(1e-13));
    CHECK(own.energy.back() == Approx(midpoint.energy.back()).epsilon(1e-13));
    CHECK(distance(last_state(run(kepler(), start, {.order = 4}, 0.05, 2.0, levels)), last_state(midpoint)) > 1e-5);
  }
}

TEST_CASE("the Euler types with one term are the symplectic Euler methods") {
  // Pendulum: euler-a is H at (q_{k+1}, p_k): q_1 = q_0 + h p_0, p_1 = p_0 - h sin q_1; euler-b at (q_k, p_{k+1}).
  const Hamiltonian pendulum({"q"}, {"p"}, "p^2/2 - cos(q)");
  const InitialState start{.q = {0.3}, .p = {0.8}};
  constexpr double h = 0.1;
  double a[] = {0.3, 0.8};
  double b[] = {0.3, 0.8};
  for (int k = 0; k < 20; ++k) {
    a[0] += h * a[1];
    a[1] -= h * std::sin(a[0]);
    b[1] -= h * std::sin(b[0]);
    b[0] += h * b[1];
  }
  const State own_a = last_state(run(pendulum, start, {.order = 1, .darboux = DarbouxType::euler_a}, h, 2.0));
  const State own_b = last_state(run(pendulum, start, {.order = 1, .darboux = DarbouxType::euler_b}, h, 2.0));
  CHECK(distance(own_a, {a[0], a[1]}) <= 20 * epsilon);
  CHECK(distance(own_b, {b[0], b[1]}) <= 20 * epsilon);
  CHECK(distance(own_a, {b[0], b[1]}) > 1e-3);
}

TEST_CASE("the discrete energy is one constant, at every order") {
  for (const auto& [hamiltonian, start] :
       {std::pair{henon_heiles(), henon_heiles_start()}, {kepler(), kepler_start(0.3)}}) {
    for (const auto& [order, step] : {std::pair{2, 0.05}, {4, 0.1}, {6, 0.2}, {8, 0.3}}) {
      const Orbit orbit = run(hamiltonian, start, {.order = order}, step, 20.0, Levels::variable);
      INFO("order " << order << ": " << orbit.message);
      REQUIRE(orbit.status == Status::success);
      CHECK(orbit.discrete_energy_deviation() <= 1e-12);
      CHECK(orbit.node_energy_deviation() > 1e-12);  // the twin: another energy, which is not
    }
  }
}

TEST_CASE("step law h^(2m+1) φ^(2m+1) and node law, where φ^(2m+1) keeps its sign") {
  // Both to O(h²): halving the first step quarters the misfits. Γ in the orbit stands for -24 φ^(2m+1).
  for (const auto& [order, coarse] : {std::pair{2, 0.06}, {4, 0.1}, {6, 0.3}}) {
    std::vector<double> spreads, misfits;
    const double s = order;
    for (const double step : {coarse, 0.5 * coarse}) {
      const Orbit orbit = run(kepler(), kepler_start(0.3), {.order = order}, step, 13.0, Levels::variable);
      REQUIRE(orbit.status == Status::success);
      REQUIRE(std::ranges::count(orbit.off_law, 0) == static_cast<long>(orbit.steps()));
      GeneratingFunction generating(kepler(), MatrixXd::Zero(4, 4), order);
      std::vector<double> laws;
      for (std::size_t k = 0; k < orbit.steps(); ++k) {
        State middle;
        for (const std::vector<double>* half : {&orbit.q, &orbit.p}) {
          for (std::size_t i = 2 * k; i < 2 * k + 2; ++i) {
            middle.push_back(0.5 * ((*half)[i] + (*half)[i + 2]));
          }
        }
        REQUIRE(generating.expand(middle) == Status::success);
        laws.push_back(std::pow(orbit.h[k], order + 1) * generating.coefficient(order + 1));
      }
      const auto [low, high] = std::ranges::minmax(laws);
      spreads.push_back(std::max(std::abs(low), std::abs(high)) / std::min(std::abs(low), std::abs(high)) - 1.0);
      // H(z_k) - E = -(s+1) |h^(s+1) φ|^(s/(s+1)) |φ(z_k)|^(1/(s+1)), with the sign of φ.
      double misfit = 0.0;
      for (std::size_t k = 0; k < orbit.steps(); ++k) {
        const double gamma = orbit.gamma[k] / 24.0;
        const double expected = std::copysign(
            (s + 1) * std::pow(std::abs(laws.front()), s / (s + 1)) * std::pow(std::abs(gamma), 1 / (s + 1)), gamma);
        misfit = std::max(misfit, std::abs((orbit.node_energy[k] - orbit.energy[k]) / expected - 1.0));
      }
      misfits.push_back(misfit);
      const auto [shortest, longest] = std::ranges::minmax(orbit.h);
      CHECK(longest / shortest > 1.5);  // there is something to adapt to
    }
    INFO("order " << order << ", spreads " << spreads[0] << ", " << spreads[1] << ", misfits " << misfits[0] << ", "
                  << misfits[1]);
    CHECK(spreads[0] / spreads[1] > 2.8);  // 2 would be O(h)
    CHECK(misfits[0] / misfits[1] > 2.8);
    CHECK(misfits[0] < 0.5);
  }
}

TEST_CASE("a run continued from its saved state is the same run") {
  const State z = joined(henon_heiles_start());
  const MatrixXd zero = MatrixXd::Zero(4, 4);
  const auto first = make_generating_scheme(henon_heiles(), zero, 6, z);
  const auto second = make_generating_scheme(henon_heiles(), zero, 6, State(4, 0.1));
  const auto walk = [](SegmentScheme& scheme) {
    for (int k = 0; k < 5; ++k) {
      REQUIRE(scheme.advance(0.2, 0.0) == Status::success);
      scheme.accept();
    }
  };
  walk(*first);
  StateWriter writer;
  first->save(writer);
  StateReader reader(writer.values());
  second->restore(reader);
  CHECK(reader.done());
  walk(*first);
  walk(*second);
  CHECK(std::ranges::equal(first->state(), second->state()));
}

TEST_CASE("the slope of the discrete energy is its derivative to leading order") {
  const auto scheme = make_generating_scheme(kepler(), MatrixXd::Zero(4, 4), 4, joined(kepler_start(0.3)));
  const auto energy = [&](double h) {
    REQUIRE(scheme->advance(h, 0.0) == Status::success);
    return scheme->discrete_energy();
  };
  for (const double h : {0.1, 0.05}) {
    const double difference = (energy(1.001 * h) - energy(0.999 * h)) / (0.002 * h);
    static_cast<void>(energy(h));
    // Relative error O(h²), with constants of order 10 at the pericentre.
    CHECK(scheme->discrete_energy_slope() == Approx(difference).epsilon(20 * h * h));
    CHECK(difference != 0.0);
  }
}

TEST_CASE("what generating functions refuse") {
  const IntegrationOptions options{.lagrangian = Generating{.order = 0}, .step = 0.1, .until = 1.0};
  const auto with = [&](Generating generating) {
    IntegrationOptions changed = options;
    changed.lagrangian = std::move(generating);
    return changed;
  };
  const InitialState start = henon_heiles_start();
  CHECK_THROWS_WITH(integrate(henon_heiles(), start, options), Catch::Contains("got 0"));
  CHECK_THROWS_WITH(integrate(henon_heiles(), start, with({.order = 2, .darboux = MatrixXd(MatrixXd::Zero(2, 2))})),
                    Catch::Contains("got 2×2"));
  MatrixXd skew = MatrixXd::Zero(4, 4);
  skew(0, 1) = 1.0;
  CHECK_THROWS_WITH(integrate(henon_heiles(), start, with({.order = 2, .darboux = skew})),
                    Catch::Contains("symmetric"));
  CHECK_NOTHROW(integrate(henon_heiles(), start, with({.order = 3})));
  // At a kink there is no Taylor expansion, and the message says so.
  const Hamiltonian kink({"q"}, {"p"}, "p^2/2 + max(q, 0)");
  CHECK_THROWS_WITH(integrate(kink, {.q = {0.0}, .p = {0.0}}, with({.order = 4})), Catch::Contains("max"));
  const Hamiltonian pole({"q"}, {"p"}, "p^2/2 - 1/q");
  CHECK_THROWS_WITH(integrate(pole, {.q = {0.0}, .p = {0.0}}, with({.order = 4})), Catch::Contains("Taylor"));
}

TEST_CASE("a run that meets a kink ends there, says so, and keeps its levels") {
  // q grows by exactly 1/4 a step until a midpoint falls on the kink at q = 1 + 1/8.
  const Hamiltonian kink({"q"}, {"p"}, "p + 0*q + abs(q - 1.125)*0.5");
  const Orbit orbit =
      integrate(kink, {.q = {0.0}, .p = {0.0}},
                {.lagrangian = Generating{.order = 4}, .step = 0.25, .until = 3.0, .levels = Levels::fixed});
  CHECK(orbit.status == Status::undefined);
  CHECK(orbit.steps() == 4);
  CHECK_THAT(orbit.message, Catch::Contains("no Taylor expansion at 0"));
}
