// A step allocates nothing.

#include <catch2/catch.hpp>

#include "allocations.hpp"

#ifdef RUBATO_COUNTS_ALLOCATIONS

#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include <Eigen/Core>

#include <rubato/ode/hamiltonian.hpp>
#include <rubato/ode/lagrangian_scheme.hpp>
#include <rubato/ode/midpoint_scheme.hpp>
#include <rubato/ode/splitting_lanes.hpp>
#include <rubato/ode/splitting_scheme.hpp>
#include <rubato/variation/time_levels.hpp>

#include "systems.hpp"

namespace {

using namespace rubato;

/// A chain of n anharmonic oscillators. H is convex, so that Γ = fᵀ H_zz f has no zero but at equilibria and no step
/// is off the law.
Hamiltonian chain(std::size_t n) {
  return Hamiltonian(n, [n](auto q, auto p) {
    auto H = p[0] * p[0] / 2;
    for (std::size_t i = 0; i < n; ++i) {
      H = H + (i > 0 ? p[i] * p[i] / 2 + pow(q[i] - q[i - 1], 2) / 2 : pow(q[i], 2) / 2) + pow(q[i], 4) / 4;
    }
    return H;
  });
}

std::vector<double> start(std::size_t n) {
  std::vector<double> z(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    z[i] = 0.3 + 0.1 * static_cast<double>(i % 3);
    z[n + i] = 0.5 - 0.2 * static_cast<double>(i % 2);
  }
  return z;
}

/// Allocations during `counted` steps that come after the first few, each followed by `extra`.
template <typename Extra>
std::size_t allocations_in_steps(SegmentScheme& scheme, Levels kind, Extra extra) {
  constexpr int first = 5;
  constexpr int counted = 100;
  TimeLevels levels(scheme, {.levels = kind}, 0.0, 0.05);
  std::size_t before = 0;
  bool made = true;
  for (int k = 0; k < first + counted; ++k) {
    if (k == first) {
      before = allocations;
    }
    const StepReport report = levels.step();
    made = made && report.status == Status::success && !report.off_law;
    made = made && std::isfinite(scheme.node().energy);
    extra(scheme);
  }
  const std::size_t after = allocations;
  REQUIRE(made);
  return after - before;
}

template <typename Extra>
std::size_t allocations_in_steps(std::size_t n, Levels kind, Extra extra) {
  return allocations_in_steps(*make_midpoint_scheme(chain(n), start(n)), kind, extra);
}

std::size_t allocations_in_steps(std::size_t n, Levels kind) {
  return allocations_in_steps(n, kind, [](const SegmentScheme&) {});
}

/// The chain by its Lagrangian.
Lagrangian chain_lagrangian(std::size_t n) {
  return Lagrangian(n, [n](auto q, auto v) {
    auto L = v[0] * v[0] / 2;
    for (std::size_t i = 0; i < n; ++i) {
      L = L + (i > 0 ? v[i] * v[i] / 2 - pow(q[i] - q[i - 1], 2) / 2 : -pow(q[i], 2) / 2) - pow(q[i], 4) / 4;
    }
    return L;
  });
}

}  // namespace

TEST_CASE("a step of the midpoint scheme allocates nothing") {
  const std::size_t n = GENERATE(1, 2, 3, 10);
  const Levels kind = GENERATE(Levels::variable, Levels::fixed);
  CAPTURE(n);
  CHECK(allocations_in_steps(n, kind) == 0);
}

TEST_CASE("a step of a quadrature of the action allocates nothing") {
  const std::size_t n = GENERATE(1, 2, 10);
  const std::vector<double> z = start(n);
  CAPTURE(n);
  for (const auto& [points, degree, kind] : {std::tuple(ActionQuadrature::Points::gauss, 1, Levels::variable),
                                             std::tuple(ActionQuadrature::Points::gauss, 3, Levels::fixed),
                                             std::tuple(ActionQuadrature::Points::lobatto, 1, Levels::fixed),
                                             std::tuple(ActionQuadrature::Points::lobatto, 3, Levels::fixed)}) {
    const auto scheme = make_lagrangian_scheme(chain_lagrangian(n), ActionQuadrature(points, degree),
                                               std::span(z).first(n), std::span(z).last(n));
    CHECK(allocations_in_steps(*scheme, kind, [](const SegmentScheme&) {}) == 0);
  }
}

TEST_CASE("a step of a splitting with a step potential allocates nothing") {
  const systems::System system = systems::henon_heiles();
  std::vector<double> z = system.initial.q;
  z.insert(z.end(), system.initial.p.begin(), system.initial.p.end());
  const auto scheme = make_splitting_scheme(system.hamiltonian, composition("blanes-moan-rkn-6"), z);
  const LevelOptions options{.on_singular = OnSingular::plain,
                             .potential = {.kind = StepPotentialChoice::Kind::automatic}};
  TimeLevels levels(*scheme, options, 0.0, 0.83);
  std::size_t allocated = 0;
  for (int k = 0; k < 105; ++k) {
    const std::size_t before = allocations;
    const StepReport report = levels.step();
    allocated += k < 5 ? 0 : allocations - before;
    REQUIRE(report.status == Status::success);
  }
  CHECK(allocated == 0);
}

TEST_CASE("a step with constraints allocates nothing") {
  const std::vector<std::string> q = {"x", "y", "z"};
  const Hamiltonian H = Hamiltonian(q, {"u", "v", "w"}, "(u^2 + v^2 + w^2)/2 + z")
                            .constrained(Constraints(q, {{"rod", "x^2 + y^2 + z^2 - 1"}}));
  const std::vector<double> z = {0.6, 0.0, -0.8, 0.0, 0.9, 0.0};
  for (const Levels kind : {Levels::variable, Levels::fixed}) {
    for (OneStepScheme* const scheme :
         {make_splitting_scheme(H, composition("suzuki-4"), z).release(), make_midpoint_scheme(H, z).release()}) {
      const std::unique_ptr<OneStepScheme> owned(scheme);
      CHECK(allocations_in_steps(*owned, kind, [](const SegmentScheme&) {}) == 0);
    }
  }
}

TEST_CASE("an allocation in a step would be counted") {
  const auto by_new = [](const SegmentScheme& scheme) {
    StateWriter state;
    scheme.save(state);
  };
  const auto by_eigen = [](const SegmentScheme& scheme) {
    Eigen::VectorXd copy = Eigen::Map<const Eigen::VectorXd>(scheme.state().data(), 2);
    CHECK(copy.allFinite());
  };
  CHECK(allocations_in_steps(2, Levels::variable, by_new) >= 100);
  CHECK(allocations_in_steps(2, Levels::variable, by_eigen) >= 100);
}

TEST_CASE("orbits side by side take their steps without allocations") {
  const systems::System system = systems::henon_heiles();
  std::vector<double> z = system.initial.q;
  z.insert(z.end(), system.initial.p.begin(), system.initial.p.end());
  const auto lanes = SplittingLanes::make(system.hamiltonian, composition("golden"), {}, 16);
  std::vector<SplittingLanes::End> ends(16);
  const auto allocations_until = [&](double until) {
    const std::vector<SplittingLanes::Start> starts(16, {.z = z, .t = 0.0, .step = 0.1, .until = until});
    const std::size_t before = allocations;
    CHECK(lanes->run(starts, 1'000'000, ends));
    return allocations - before;
  };
  CHECK(allocations_until(10.0) == allocations_until(500.0));
  // The twin: what is reported on each orbit at its end is allocated.
  CHECK(allocations_until(10.0) > 0);
}

#endif
