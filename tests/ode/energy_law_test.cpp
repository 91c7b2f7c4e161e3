// The laws of a run with variable levels: the discrete energy is exact, the levels follow the step law, the node energy
// stays near it and does not drift, and quadratic invariants are kept.

#include <catch2/catch.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "systems.hpp"

using namespace rubato;
using systems::System;

namespace {

Orbit orbit(const System& system, double step, double until, Levels levels = Levels::variable) {
  return integrate(system.hamiltonian, system.initial,
                   {.step = step, .until = until, .levels = levels, .on_singular = OnSingular::stop});
}

/// max/min - 1 of h Γ(z̄)^(1/3) over the run: by the step law of theory, section 3, O(h²).
double step_law_spread(const System& system, const Orbit& run) {
  HamiltonianEvaluator evaluator(system.hamiltonian);
  double least = INFINITY;
  double most = 0.0;
  for (std::size_t k = 0; k < run.steps(); ++k) {
    const auto z = systems::middle(systems::state_at(run, k), systems::state_at(run, k + 1));
    double energy = 0.0;
    const double law = run.h[k] * std::cbrt(std::abs(evaluator.gamma(z.data(), energy)));
    least = std::min(least, law);
    most = std::max(most, law);
  }
  return most / least - 1.0;
}

/// Largest deviation of (H(z_k) - E)/(h²Γ(z_k)/8) from 1, the node law of theory, section 3. The step after the node
/// and the step before it differ by O(h), with opposite signs: their mean leaves O(h²).
double node_law_error(const Orbit& run) {
  double largest = 0.0;
  for (std::size_t k = 1; k < run.steps(); ++k) {
    const double predicted = run.h[k - 1] * run.h[k] * run.gamma[k] / 8.0;
    largest = std::max(largest, std::abs((run.node_energy[k] - run.energy[0]) / predicted - 1.0));
  }
  return largest;
}

/// Means of a quantity over each eighth of a run. What is bounded and drifts nowhere has eighths that agree as well as
/// the incomplete period at their ends allows.
class EighthMeans {
public:
  explicit EighthMeans(std::size_t count) : part_((count + 7) / 8) {}
  void add(double value) {
    sums_[seen_++ / part_] += value;
    most_ = std::max(most_, value);
    least_ = std::min(least_, value);
  }
  /// Largest difference of two eighths, relative to the range of the quantity.
  [[nodiscard]] double drift() const {
    const auto [low, high] = std::ranges::minmax(sums_);
    return (high - low) / static_cast<double>(part_) / (most_ - least_);
  }
  [[nodiscard]] double range() const { return most_ - least_; }

private:
  std::size_t part_;
  std::size_t seen_ = 0;
  std::array<double, 8> sums_{};
  double most_ = -INFINITY;
  double least_ = INFINITY;
};

/// Eighth-means of H(z_k) over `steps` steps of a scheme.
EighthMeans node_energies(std::size_t steps, const std::function<double()>& next) {
  EighthMeans means(steps);
  for (std::size_t k = 0; k < steps; ++k) {
    means.add(next());
  }
  return means;
}

/// What the issue of this law asks: E exact to this, relative to max(|E|, max |H|).
constexpr double exact = 1e-13;

struct Expected {
  System system;
  double until;
  double spread;  ///< of h Γ^(1/3) at the first step given
};

std::vector<Expected> runs() {
  // Spreads: theory, section 3 quotes 1.5e-3 (pendulum, 0.1) and 2.0e-6 (Kepler, half the step taken here, so 8.1e-6);
  // the others were measured once (2.7e-4, 7.6e-4, 2.1e-3) and all are O(h²), which is what is tested.
  return {{systems::pendulum(), 100.0, 2e-3},
          {systems::kepler(0.6), 20.0 * M_PI, 1e-5},
          {systems::henon_heiles(), 400.0, 4e-4},
          {systems::double_well(), 100.0, 1e-3},
          {systems::non_separable(), 100.0, 2.5e-3}};
}

}  // namespace

TEST_CASE("with variable levels the discrete energy is exact and the levels follow the step law") {
  for (const auto& [system, until, spread] : runs()) {
    INFO(system.name);
    std::array<double, 3> spreads{};
    std::array<double, 3> node_errors{};
    for (std::size_t i = 0; i < spreads.size(); ++i) {
      const Orbit run = orbit(system, system.step / static_cast<double>(1 << i), until);
      REQUIRE(run.status == Status::success);
      CHECK(run.discrete_energy_deviation() <= exact);
      spreads[i] = step_law_spread(system, run);
      node_errors[i] = node_law_error(run);
    }
    CHECK(spreads[0] <= spread);
    // O(h²): each halving divides by 4, up to a relative O(h²) of the next term; 3.5 and 4.5 exclude h and h³.
    for (std::size_t i = 0; i + 1 < spreads.size(); ++i) {
      CHECK(spreads[i] / spreads[i + 1] == Approx(4.0).margin(0.5));
      CHECK(node_errors[i] / node_errors[i + 1] == Approx(4.0).margin(0.5));
    }
  }
}

TEST_CASE("with fixed levels the discrete energy is not exact and the step law does not hold") {
  // The twin: each predicate above fails by orders of magnitude for the same schemes at fixed levels.
  for (const auto& [system, until, spread] : runs()) {
    INFO(system.name);
    const Orbit run = orbit(system, system.step, until, Levels::fixed);
    REQUIRE(run.status == Status::success);
    CHECK(run.discrete_energy_deviation() > 1e3 * exact);
    CHECK(step_law_spread(system, run) > 10.0 * spread);
  }
}

TEST_CASE("the oscillator's variable levels are uniform") {
  // Γ is constant, so h is. Rounding in H of size ε moves h by the step condition 4ε|H|/(h²Γ), and what is left of the
  // level equation, at most 1e-14 relative (a tenth of the tolerance), by 4·1e-14 H/(h²Γ): with H = 1/2 and Γ = 1,
  // 2e-14/h².
  const System system = systems::oscillator();
  for (const double step : {0.1, 0.05, 0.025}) {
    const Orbit run = orbit(system, step, 100.0);
    REQUIRE(run.status == Status::success);
    CHECK(run.discrete_energy_deviation() <= exact);
    const auto [least, most] = std::ranges::minmax(run.h);
    CHECK(most / least - 1.0 <= 3.0 * 2e-14 / (step * step));
  }
  const Orbit pendulum = orbit(systems::pendulum(), 0.1, 100.0);
  const auto [least, most] = std::ranges::minmax(pendulum.h);
  CHECK(most / least - 1.0 > 1.0);  // not uniform where Γ varies
}

TEST_CASE("node energy of the pendulum is bounded") {
  // H(z_k) - E = h²Γ/8 with h³Γ = const: from h = 0.1, Γ = 3.6 at the bottom to Γ = 0.36 at the turning points,
  // 4.5e-3 and 2.1e-3. So H(z_k) - H(z_0), which a run reports, stays within 2.4e-3; H(z_k) - E within 4.5e-3.
  const Orbit run = orbit(systems::pendulum(), 0.1, 100.0);
  CHECK(run.node_energy_deviation() <= 2.5e-3);
  const auto [least, most] = std::ranges::minmax(run.node_energy);
  CHECK(most - run.energy[0] <= 4.6e-3);
  CHECK(least - run.energy[0] >= 2.0e-3);
  CHECK(run.node_energy_deviation() > 1e-3);  // and it does move: node and discrete energy are not the same
}

TEST_CASE("node energy does not drift") {
  // 40,000 steps, each eighth of them 80 or more periods (100 at h = 0.1): an incomplete period at the ends of an
  // eighth moves its mean by at most the range divided by their number, about 1/80; twice that for a difference.
  constexpr std::size_t steps = 40000;
  constexpr double no_drift = 2.0 / 80.0;
  const System system = systems::pendulum();
  OrbitIntegrator integrator(system.hamiltonian, system.initial,
                             {.step = system.step, .until = 1e9, .on_singular = OnSingular::stop});
  std::size_t failed = 0;
  const EighthMeans means = node_energies(steps, [&] {
    failed += integrator.step().status != Status::success;
    return integrator.node().energy;
  });
  CHECK(failed == 0);
  CHECK(means.drift() <= no_drift);
  CHECK(means.range() <= 2.5e-3);

  SECTION("an explicit Runge-Kutta step drifts") {
    HamiltonianEvaluator evaluator(system.hamiltonian);
    auto z = systems::joined(system.initial);
    const EighthMeans explicit_means = node_energies(steps, [&] {
      z = systems::runge_kutta(evaluator, z, 0.02, 4);
      return evaluator.value(z.data());
    });
    CHECK(explicit_means.drift() > no_drift);
  }
}

TEST_CASE("a million steps of the pendulum: discrete energy exact, node energy without drift", "[long]") {
  constexpr std::size_t steps = 1'000'000;
  const System system = systems::pendulum();
  OrbitIntegrator integrator(system.hamiltonian, system.initial,
                             {.step = system.step, .until = 1e9, .on_singular = OnSingular::stop});
  double energy = 0.0;
  double deviation = 0.0;
  double node_deviation = 0.0;
  const double initial = integrator.node().energy;
  std::size_t failed = 0;
  const EighthMeans means = node_energies(steps, [&] {
    const StepReport report = integrator.step();
    failed += report.status != Status::success;
    energy = integrator.levels().steps() == 1 ? report.energy : energy;
    deviation = std::max(deviation, std::abs(report.energy - energy));
    node_deviation = std::max(node_deviation, std::abs(integrator.node().energy - initial));
    return integrator.node().energy;
  });
  CHECK(failed == 0);
  CHECK(deviation / integrator.levels().energy_scale() <= exact);
  CHECK(node_deviation <= 2.5e-3);
  // 2000 periods and more to an eighth: as above, 2/2000.
  CHECK(means.drift() <= 1e-3);
  WARN("10^6 steps: discrete energy " << deviation / integrator.levels().energy_scale() << ", max |H(z_k) - H(z_0)| "
                                      << node_deviation << ", drift of eighth-means / range " << means.drift());
}

TEST_CASE("angular momentum of the Kepler problem is kept to rounding over 10^5 steps") {
  // The midpoint rule keeps quadratic invariants exactly, whatever h is. Each solved step leaves a relative error of a
  // few ε in δ, which is about |z|/100; 10^5 of them, adding up as a random walk: 300·ε/10, far below 1e-12.
  constexpr std::size_t steps = 100'000;
  constexpr double rounding = 1e-12;
  const auto deviation = [](const System& system) {
    OrbitIntegrator integrator(system.hamiltonian, system.initial,
                               {.step = system.step, .until = 1e9, .on_singular = OnSingular::stop});
    const auto momentum = [&] { return integrator.q()[0] * integrator.p()[1] - integrator.q()[1] * integrator.p()[0]; };
    const double initial = momentum();
    double largest = 0.0;
    for (std::size_t k = 0; k < steps; ++k) {
      if (integrator.step().status != Status::success) {
        return std::numeric_limits<double>::infinity();
      }
      largest = std::max(largest, std::abs(momentum() / initial - 1.0));
    }
    return largest;
  };
  System system = systems::kepler(0.6);
  const double held = deviation(system);
  INFO("angular momentum: " << held);
  CHECK(held <= rounding);
  // The twin: a potential that is round to nine digits only.
  system.hamiltonian = Hamiltonian({"x", "y"}, {"u", "v"}, "(u^2 + v^2)/2 - 1/sqrt(x^2*(1 + 1e-9) + y^2)");
  CHECK(deviation(system) > 100.0 * rounding);
}
